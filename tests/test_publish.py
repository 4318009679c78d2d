"""What is published is whole, serves as a mirror, and is described in words that OpenML takes."""

import json
from pathlib import Path

import numpy as np
import pytest
from loopback_server import serving

from vvc_bench.datasets.catalogue import PID
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.publish import OPENML_ENTRY, openml_entry, openml_table, publish
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.datasets.store import CorruptDataset, Description, open_dataset, write_dataset
from vvc_bench.experts import APPENDIX_C
from vvc_bench.goals import grid
from vvc_bench.rollout import fly_law

NAME = "small-v0"


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    flown = fly_law(PID, grid([180, 200], [0, 10], [-30, 0, 45]).goals, APPENDIX_C)
    return open_dataset(write_dataset(tmp_path / "made" / NAME, flown.episodes, Description(NAME, seed=7)))


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VVC_BENCH_HOME", str(tmp_path / "home"))


def test_a_published_directory_is_a_mirror(dataset: Dataset, tmp_path: Path) -> None:
    place = publish(dataset, tmp_path / "public")
    files = {"manifest.json", "episodes.parquet", "transitions-00000.parquet"}
    assert {path.name for path in place.iterdir()} == files | {OPENML_ENTRY}
    with serving(tmp_path / "public") as server:
        assert load_dataset(NAME, source=server.url).hash == dataset.hash


def test_publishing_again_is_allowed_and_another_set_is_not(dataset: Dataset, tmp_path: Path) -> None:
    place = publish(dataset, tmp_path)
    before = {path.name: path.read_bytes() for path in place.iterdir()}
    assert publish(dataset, tmp_path) == place
    assert {path.name: path.read_bytes() for path in place.iterdir()} == before
    other = write_dataset(tmp_path / "other" / NAME, dataset.read(), Description(NAME, seed=8))
    with pytest.raises(FileExistsError, match="another dataset of that name"):
        publish(open_dataset(other), tmp_path)
    assert {path.name: path.read_bytes() for path in place.iterdir()} == before


def test_a_damaged_set_is_not_published(dataset: Dataset, tmp_path: Path) -> None:
    path = dataset.folder / "transitions-00000.parquet"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(CorruptDataset, match="differs from its checksum"):
        publish(dataset, tmp_path / "public")
    assert list((tmp_path / "public").iterdir()) == []


def test_a_choice_of_episodes_is_no_set_yet(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="write them as one, under a name of its own"):
        publish(dataset.select([0]), tmp_path)


def test_the_entry_is_plain_and_complete(dataset: Dataset) -> None:
    entry = openml_entry(dataset)
    assert entry["description"].isascii()
    assert entry["citation"].isascii()
    assert dataset.hash in entry["description"]
    assert json.loads(entry["description"].partition("\n\n{")[2].join("{\n")[:-1])["seed"] == 7
    table = openml_table(dataset)
    assert set(entry["default_target_attribute"].split(",")) <= set(table.column_names)
    assert set(entry["ignore_attribute"]) <= set(table.column_names)


def test_the_table_has_every_transition(dataset: Dataset) -> None:
    table, episodes = openml_table(dataset), dataset.read()
    assert table.num_rows == len(episodes.rewards)
    np.testing.assert_array_equal(table["episode"], episodes.transition_episodes())
    np.testing.assert_array_equal(table["goal_azimuth_deg"], np.repeat(episodes.goals[:, 2], episodes.lengths))
    np.testing.assert_array_equal(table["action_load_factor_g"], episodes.actions[:, 1])
    np.testing.assert_array_equal(table["roll_deg"], episodes.observations[:, 0])
    np.testing.assert_array_equal(table["terminated"], episodes.ends[0])
    assert all(table[name].null_count == 0 for name in table.column_names)
