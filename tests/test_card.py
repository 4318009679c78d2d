"""Data cards: whole, self-contained, the same every time, and right."""

import base64
import html
import importlib.util
import io
import math
from pathlib import Path

import numpy as np
import pytest

if importlib.util.find_spec("matplotlib") is None:
    pytest.skip("cards take matplotlib", allow_module_level=True)

from html_page import Page, assert_self_contained
from PIL import Image

from vvc_bench import sim
from vvc_bench.datasets.card import CARD, card_page, write_card
from vvc_bench.datasets.catalogue import CATALOGUE
from vvc_bench.datasets.pictures import PICTURES, flight_path, prepare
from vvc_bench.drawing import LIGHT, png
from vvc_bench.goals import grid
from vvc_bench.metrics import PUBLISHED, coverage, reached_goals, summary
from vvc_bench.page import Shown
from vvc_bench.rollout import Episodes, fly_law
from vvc_bench.sim.fields import GuidanceCommand, field_array

GOALS = grid([140, 200, 260], [-20, 0, 15], [-120, -10, 0, 60]).goals
SPECIFICATION = CATALOGUE["pid-v0"]
PAPER = PUBLISHED["pid-v0"]._replace(table_12={"pitch_deg": (0.25, math.nan)})
DESCRIPTION = {
    "name": "pid-v0",
    "specification": SPECIFICATION.to_json(),
    "seed": 0,
    "last_events": {"crash": 3, "reach_target": 1234},
    "versions": {"vvc_bench": "0.1.0"},
    "parents": {"another-v0": "12" * 32},
    "files": {"episodes.parquet": {"sha256": "ab" * 32, "bytes": 5, "rows": 5}},
    "columns": {"transitions": {"roll_deg": {"type": "float32", "unit": "deg", "meaning": "bank angle", "mean": 0.25}}},
}


@pytest.fixture(scope="module")
def episodes() -> Episodes:
    return fly_law(SPECIFICATION.scenario, GOALS).episodes


@pytest.fixture(scope="module")
def card(episodes: Episodes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("card") / "made"
    return write_card(folder, episodes, GOALS, DESCRIPTION, PAPER)


@pytest.fixture(scope="module")
def page(card: Path) -> Page:
    return Page(card.read_text(encoding="utf-8"))


def test_the_page_needs_nothing_else(card: Path, page: Page) -> None:
    assert_self_contained(card.read_text(encoding="utf-8"), page)


def test_it_reads_on_a_phone_and_in_the_dark(card: Path, page: Page) -> None:
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in page.all("meta")
    text = card.read_text(encoding="utf-8")
    assert "img { display: block; width: 100%; height: auto; }" in text
    assert "@media (prefers-color-scheme: dark)" in text
    assert {source["media"] for source in page.all("source")} == {"(prefers-color-scheme: dark)"}


def test_every_picture_is_there_twice_and_described(page: Page) -> None:
    light, dark = page.all("img"), page.all("source")
    assert len(light) == len(dark) == len(PICTURES)
    assert all(len(picture["alt"]) > 20 for picture in light)
    backgrounds = []
    for picture in [*(image["src"] for image in light), *(image["srcset"] for image in dark)]:
        image = Image.open(io.BytesIO(base64.b64decode(picture.removeprefix("data:image/png;base64,"))))
        pixels = np.asarray(image.convert("RGB"))
        assert pixels.std() > 5
        backgrounds.append(pixels[0, -1].mean())
    assert min(backgrounds[: len(light)]) > 240
    assert max(backgrounds[len(light) :]) < 40


def test_pictures_lie_beside_the_page(card: Path, page: Page) -> None:
    embedded = {image["src"].split(",")[1] for image in page.all("img")}
    files = {path.name: base64.b64encode(path.read_bytes()).decode() for path in card.parent.glob("*.png")}
    assert set(files) == {f"{picture.name}.png" for picture in PICTURES}
    assert set(files.values()) == embedded
    assert {path.name for path in card.parent.iterdir()} == {CARD, *files}


def test_it_says_what_the_set_is_and_what_it_is_worth(episodes: Episodes, page: Page) -> None:
    row = summary(episodes, GOALS).table_1
    for figure in (
        "vvc-bench datasets build pid-v0",
        f"{row.coverage_percent:.2f}",
        f"{row.transitions:,}",
        f"{row.speed_error_mps.mean:.2f} ± {row.speed_error_mps.std:.2f}",
        "6.56 ± 3.25",
        "2,872,051",
        "1,234",
        "reach target",
        "mean errors over the last 10 steps are below 10 m/s in speed, 1° in path angle",
        "ab" * 32,
        "12" * 32,
        "bank angle",
        "0.250",
        "MIT",
    ):
        assert figure in page.text, figure


def test_the_same_set_gives_the_same_bytes(card: Path, episodes: Episodes, tmp_path: Path) -> None:
    again = write_card(tmp_path, episodes, GOALS, DESCRIPTION, PAPER)
    assert again.read_bytes() == card.read_bytes()


def test_names_are_text_and_little_need_be_known(card: Path, episodes: Episodes) -> None:
    drawn = [
        Shown(picture.name, picture.title, picture.caption, *[(card.parent / f"{picture.name}.png").read_bytes()] * 2)
        for picture in PICTURES
    ]
    hostile = "<script>alert(1)</script>&amp;"
    text = card_page(summary(episodes, GOALS), episodes.scenario, drawn, {"name": hostile})
    assert "<script" not in text
    assert html.escape(hostile) in text
    assert Page(text).open == []


def test_a_failure_leaves_the_older_card(card: Path, episodes: Episodes) -> None:
    before = {path: path.read_bytes() for path in card.parent.iterdir()}
    with pytest.raises(ValueError, match="without episodes"):
        write_card(card.parent, episodes.select(np.zeros(0, dtype=int)), GOALS, DESCRIPTION)
    with pytest.raises(ValueError, match="not among the 1 goals flown"):
        write_card(card.parent, episodes, GOALS[:1], DESCRIPTION)
    assert {path: path.read_bytes() for path in card.parent.iterdir()} == before


def test_nothing_is_left_where_nothing_can_be_written(card: Path, episodes: Episodes) -> None:
    with pytest.raises(NotADirectoryError, match=CARD):
        write_card(card / "below-a-file", episodes, GOALS, DESCRIPTION)


def test_one_flight_is_enough(episodes: Episodes) -> None:
    one = episodes.select([0])
    material = prepare(one, coverage(*reached_goals(one, one.goals)), {})
    for picture in PICTURES:
        assert png(picture, material, LIGHT).startswith(b"\x89PNG")


def test_paths_are_where_the_aircraft_flew(episodes: Episodes) -> None:
    """Against the simulator's own position, flown again step by step."""
    scenario = episodes.scenario
    for e in (0, len(episodes) // 2, len(episodes) - 1):
        state, places = episodes.starts[e], []
        for action in episodes.actions[episodes.offsets[e] : episodes.offsets[e + 1]].astype(float):
            state = sim.step(state, action / field_array(GuidanceCommand, "scale"), scenario.settings)
            places.append([getattr(sim.State(*state), name) for name in ("east", "north", "altitude")])
        flown = flight_path(episodes, e)
        distance = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        assert np.abs(flown[1:, 2] - np.array(places)[:, 2]).max() < 0.01
        assert np.abs(flown[1:] - places).max() < 0.003 * distance
