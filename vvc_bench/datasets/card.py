"""The data card: what a set is, how it was made and what it is worth, as one page that needs nothing else.

The page carries its pictures within itself and reads on a phone as on a desk, in light and in dark. Takes the extra
``plot`` (matplotlib).
"""

import html
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from vvc_bench.datasets.catalogue import goals_flown
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.pictures import PICTURES, prepare
from vvc_bench.drawing import column_text, draw
from vvc_bench.metrics import PUBLISHED, PublishedFigures, Summary, Table1, VariableSmoothness, summary
from vvc_bench.page import (
    Shown,
    beside,
    figure,
    hash_cell,
    header,
    note,
    number,
    page,
    section,
    significant,
    table,
    text_cell,
    write_bytes,
)
from vvc_bench.rollout import Episodes, Scenario
from vvc_bench.sim.task import Event, Rules, Task
from vvc_bench.sim.units import DEGREES_PER_RADIAN

CARD = "card.html"

LICENCE = "MIT, as the code. The aerodynamic tables behind the flights are NASA TP-1538 (public domain)."

_FLIGHTS = ("paths", "approaches", "durations", "accuracy")
_THIS_SET = "this set"


class _Measure(NamedTuple):
    """A row of Table 1: what it is called, and how many decimals its figures get."""

    title: str
    decimals: int


_TABLE_1 = {
    "trajectories": _Measure("trajectories", 0),
    "coverage_percent": _Measure("goals reached, %", 2),
    "length_steps": _Measure("length, steps", 0),
    "transitions": _Measure("transitions", 0),
    "speed_error_mps": _Measure("speed error, m/s", 2),
    "path_angle_error_deg": _Measure("path angle error, °", 2),
    "azimuth_error_deg": _Measure("azimuth error, °", 2),
}


def write_card(
    folder: Path | str,
    episodes: Episodes,
    goals_flown: ArrayLike,
    description: Mapping[str, Any],
    paper: PublishedFigures | None = None,
) -> Path:
    """Write the data card of a set, and its pictures as PNG files beside it.

    Each file appears under its name only when it is whole. The same set gives the same page, whenever and wherever.

    Args:
        folder: where to write ``card.html`` and the pictures; made if need be.
        episodes: the set's flights.
        goals_flown: shape (G, 3), all goals that were tried, in outside units.
        description: the set's manifest, or as much of it as is known (``name``, ``specification``, ``seed``,
            ``last_events``, ``versions``, ``parents``, ``files``, ``columns``); ``hash``, of the manifest itself, may
            be added.
        paper: published figures to stand beside the set's own.

    Returns:
        The page.

    Raises:
        ValueError: for a set without episodes, or goals reached that are not among those flown.
        ImportError: without matplotlib; says what to install.
        OSError: if the folder cannot be written to.
    """
    measured = summary(episodes, goals_flown)
    material = prepare(episodes, measured.coverage, paper.reached if paper else {})
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)  # what cannot be written to is said before everything is drawn
    shown = [draw(picture, material) for picture in PICTURES]
    text = card_page(measured, episodes.scenario, shown, description, paper)
    for picture in shown:
        write_bytes(folder / f"{picture.name}.png", picture.light)
    write_bytes(folder / CARD, text.encode())
    return folder / CARD


def write_dataset_card(dataset: Dataset, folder: Path | str) -> Path:
    """The same for a dataset of the catalogue, with the paper's figures where there are some.

    Raises:
        ValueError: for a name that the catalogue does not have: it is not known then which goals were flown.
        ImportError: without matplotlib; says what to install.
        OSError: if the folder cannot be written to.
    """
    description = {**dataset.manifest, "hash": dataset.hash}
    return write_card(folder, dataset.read(), goals_flown(dataset.name), description, PUBLISHED.get(dataset.name))


# The page


def card_page(
    measured: Summary,
    scenario: Scenario,
    shown: Sequence[Shown],
    description: Mapping[str, Any],
    paper: PublishedFigures | None = None,
) -> str:
    """The page as text, from what has been measured and drawn; see `write_card`."""
    figures = {drawn.name: figure(drawn) for drawn in shown}
    name = str(description.get("name", "unnamed"))
    what = str(description.get("specification", {}).get("summary", ""))
    parts = [
        _header(name, what, measured, scenario),
        section("How it is made", _made(name, scenario, description)),
        section("Table 1", _table_1(measured.table_1, paper)),
        section("Goals", beside(*(figures[key] for key in figures if key.startswith(("coverage", "reached-by"))))),
        section("Flights", beside(*(figures[key] for key in _FLIGHTS), _responses(measured))),
        section("Smoothness: Table 12", beside(figures["smoothness"], _table_12(measured, paper))),
        section("Wear", _wear(measured)),
        section("Checks", _checks(measured)),
        section("Columns", _schema(description)),
        section("Where it is from", _provenance(description)),
    ]
    return page(f"{name} – data card", parts)


def _header(name: str, what: str, measured: Summary, scenario: Scenario) -> str:
    row = measured.table_1
    hours = row.transitions * scenario.settings.time_step / 3600.0
    tiles = [
        (number(measured.coverage.flown.sum()), "goals flown"),
        (number(row.trajectories), "flights"),
        (number(row.transitions), "transitions"),
        (number(row.coverage_percent, 2) + " %", "of the goals reached"),
        (number(row.length_steps.mean * scenario.settings.time_step, 1) + " s", "mean duration"),
        (number(hours, 1 if hours < 100 else 0) + " h", "in the air"),
    ]
    sentence = f"{what[:1].upper()}{what[1:]}".rstrip(".") + "." if what else ""
    return header("vvc-bench data card", name, sentence, tiles)


# Its parts


def _made(name: str, scenario: Scenario, description: Mapping[str, Any]) -> str:
    command = f"vvc-bench datasets build {name}"
    load = f'import vvc_bench\ndata = vvc_bench.load_dataset("{name}")'
    task, settings = scenario.task, scenario.settings
    flown = (
        f"Flights start in trim at {scenario.altitude_m:g} m and {scenario.speed_mps:g} m/s, heading "
        f"{scenario.heading_deg:g}°, under {settings.control_mode.replace('_', '-')} control with {settings.dynamics} "
        f"dynamics at {settings.frequency_hz:g} Hz, and have {task.step_limit / settings.frequency_hz:g} s to reach "
        f"their goals. {_criterion(task)}"
    )
    tried = description.get("last_events", {})
    events = (
        "<p>How the flights to all goals ended:</p>" + table(["ended by", "flights"], _event_rows(tried))
        if tried
        else ""
    )
    documents = {"specification": description.get("specification"), "scenario": scenario.to_json()}
    text = json.dumps({key: part for key, part in documents.items() if part}, indent=2, ensure_ascii=False)
    return (
        f"<p>{html.escape(flown)}</p><pre><code>{html.escape(command)}</code></pre>{events}"
        f"<p>To load it:</p><pre><code>{html.escape(load)}</code></pre>"
        f"<details><summary>Specification and scenario in full</summary><pre><code>{html.escape(text)}</code></pre>"
        "</details>"
    )


def _criterion(task: Task) -> str:
    """When a goal counts as reached."""
    speed, direction = f"{task.speed_band:g} m/s", f"{task.direction_band * DEGREES_PER_RADIAN:g}°"
    steps = f"{task.reach_steps:g}"
    match Rules(int(task.rules)):
        case Rules.DEMONSTRATION:
            return (
                f"A goal is reached when the mean errors over the last {steps} steps are below {speed} in speed, "
                f"{direction} in path angle and {direction} in azimuth."
            )
        case Rules.PUBLIC_CODE:
            return (
                f"A goal is reached when the mean errors over the last {steps} steps are below {speed} in speed and "
                f"{direction} in direction."
            )
    return (
        f"A goal is reached when the errors are below {speed} in speed and {direction} in direction for {steps} steps "
        "in a row."
    )


def _event_rows(last_events: Mapping[str, int]) -> list[tuple[str, str]]:
    order = [*(str(event.name).lower() for event in Event), "none"]
    known = sorted(last_events.items(), key=lambda entry: order.index(entry[0]) if entry[0] in order else len(order))
    return [(html.escape(name.replace("_", " ")), number(count)) for name, count in known]


def _table_1(row: Table1, paper: PublishedFigures | None) -> str:
    ours: Mapping[str, Any] = row._asdict()
    sets = {_THIS_SET: ours} | (dict(paper.table_1) if paper else {})
    rows = [
        (measure.title, *(number(figures.get(key), measure.decimals) for figures in sets.values()))
        for key, measure in _TABLE_1.items()
    ]
    remark = "Mean ± standard deviation over the flights; errors are means over each flight's last second."
    return table(["", *map(html.escape, sets)], rows) + note(remark)


def _table_12(measured: Summary, paper: PublishedFigures | None) -> str:
    ours, theirs = measured.table_12, paper.table_12 if paper else {}
    groups = {
        "seen": ours.observations,
        "seen, followed past ±180°": ours.unwrapped,
        "commanded": ours.actions,
    }
    rows: list[Sequence[str]] = []
    for title, entries in groups.items():
        rows += [(title,), *((column_text(name), *_smooth(entry)) for name, entry in entries.items())]
    if theirs:
        known = ((column_text(name), *(significant(figure) for figure in figures)) for name, figures in theirs.items())
        rows += [("seen, in the paper",), *known]
    remark = (
        "Mean ± standard deviation over the flights; smaller is smoother. s₁ (eq. 23): amplitude times "
        "frequency, the mean over the spectrum: the first ⌊N/2⌋ bins, the one at zero among them, amplitude "
        "2/N·|FFT|, frequency as a share of half the sampling rate. s₂ (eq. 24): mean absolute change from step to "
        "step. Angles are taken as they are reported, as in the paper, unless said otherwise."
    )
    return table(["", "s₁", "s₂"], rows) + note(remark)


def _smooth(entry: VariableSmoothness) -> tuple[str, str]:
    first, second = (f"{significant(part.mean)} ± {significant(part.std)}" for part in entry)
    return first, second


def _responses(measured: Summary) -> str:
    speed, direction = measured.speed_response, measured.direction_response
    rows = [
        ("band", f"{speed.band:g} m/s", f"{direction.band:g}°"),
        *(
            (title, *(number(getattr(part, name), decimals) for part in (speed, direction)))
            for title, name, decimals in (
                ("first inside after, s", "arrival_s", 1),
                ("inside for good after, s", "settling_s", 1),
                ("inside at the end, % of flights", "settled_percent", 1),
                ("outside again in between, %", "overshooting_percent", 1),
                ("how far outside, m/s and °", "overshoot", 2),
            )
        ),
    ]
    return table(["settling", "speed", "direction"], rows)


def _wear(measured: Summary) -> str:
    commands = [
        (
            column_text(name),
            number(part.at_low_percent, 1),
            number(part.at_high_percent, 1),
            number(part.bang_bang_percent, 1),
            number(part.switches_per_s, 3),
        )
        for name, part in measured.wear.commands.items()
    ]
    deflections = [
        (column_text(name), number(part.travel_per_s, 2), number(part.saturated_percent, 1))
        for name, part in measured.wear.deflections.items()
    ]
    load = measured.wear.load
    loads = (
        f"<p>The normal load factor lies between {number(load.least_g, 2)} and {number(load.largest_g, 2)} g. It is "
        f"below {number(load.low_limit_g)} g in {number(load.below_percent, 3)} % of the steps and above "
        f"{number(load.high_limit_g)} g in {number(load.above_percent, 3)} %; "
        f"{number(load.episodes_beyond_percent, 2)} % of the flights are beyond either at least once.</p>"
    )
    remark = (
        "Share of the steps with a command at its lower, its upper or either bound, and jumps from one "
        "to the other; travel: the sum of all changes, in degrees or shares of full throttle."
    )
    return (
        beside(
            table(["commanded", "low, %", "high, %", "either, %", "jumps, 1/s"], commands),
            table(["flown", "travel, each second", "at its limits, %"], deflections),
        )
        + note(remark)
        + loads
    )


def _checks(measured: Summary) -> str:
    found = measured.integrity
    constant = "; ".join(f"{array}: {', '.join(names)}" for array, names in found.constant_columns.items())
    rows = [
        ("goals that occur again", number(found.repeated_goals)),
        ("flights that occur again, bit for bit", number(found.repeated_flights)),
        ("columns that never change", html.escape(constant) or "none"),
        ("return", number(measured.returns, 1)),
    ]
    return table(["", ""], rows)


def _schema(description: Mapping[str, Any]) -> str:
    tables = description.get("columns", {})
    return "".join(
        f"<details><summary>{html.escape(table)}: {len(known)} columns</summary>" + _columns(known) + "</details>"
        for table, known in tables.items()
    )


def _columns(known: Mapping[str, Mapping[str, Any]]) -> str:
    measured = any("mean" in entry for entry in known.values())
    statistics = ("mean", "std", "min", "max") if measured else ()
    rows = [
        (
            f"<code>{html.escape(name)}</code>",
            *(text_cell(str(entry.get(key, ""))) for key in ("unit", "type", "meaning")),
            *(significant(entry[key]) if key in entry else "" for key in statistics),
        )
        for name, entry in known.items()
    ]
    return table(["column", text_cell("unit"), text_cell("type"), text_cell("meaning"), *statistics], rows)


def _provenance(description: Mapping[str, Any]) -> str:
    rows = [("seed", text_cell(str(description["seed"])))] if "seed" in description else []
    rows += [(name.replace("_", "-"), text_cell(str(version))) for name, version in _entries(description, "versions")]
    rows += [(f"made from {name}", hash_cell(digest)) for name, digest in _entries(description, "parents")]
    rows += [("manifest.json", hash_cell(description["hash"]))] if "hash" in description else []
    rows += [(name, hash_cell(entry["sha256"])) for name, entry in _entries(description, "files")]
    known = table(["", ""], [(html.escape(name), value) for name, value in rows]) if rows else ""
    return known + f"<p>Licence: {html.escape(LICENCE)}</p>"


def _entries(description: Mapping[str, Any], key: str) -> Iterable[tuple[str, Any]]:
    entries: Mapping[str, Any] = description.get(key, {})
    return entries.items()
