"""The data card: what a set is, how it was made and what it is worth, as one page that needs nothing else.

The page carries its pictures within itself and reads on a phone as on a desk, in light and in dark. Takes the extra
``plot`` (matplotlib).
"""

import base64
import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vvc_bench.datasets.catalogue import goals_flown
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.pictures import DARK, LIGHT, PICTURES, Picture, column_text, png, prepare
from vvc_bench.flight.files import write_whole
from vvc_bench.metrics import PUBLISHED, PublishedFigures, Spread, Summary, Table1, VariableSmoothness, summary
from vvc_bench.rollout import Episodes, Scenario
from vvc_bench.sim.task import Event, Rules, Task
from vvc_bench.sim.units import DEGREES_PER_RADIAN

CARD = "card.html"

LICENCE = "MIT, as the code. The aerodynamic tables behind the flights are NASA TP-1538 (public domain)."

_FLIGHTS = ("paths", "approaches", "durations", "accuracy")
_THIS_SET = "this set"
_UNKNOWN = "–"


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
    shown = [Shown(picture, png(picture, material, LIGHT), png(picture, material, DARK)) for picture in PICTURES]
    page = card_page(measured, episodes.scenario, shown, description, paper)
    for picture in shown:
        _write(folder / f"{picture.picture.name}.png", picture.light)
    _write(folder / CARD, page.encode())
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


def _write(path: Path, content: bytes) -> None:
    def write(place: Path) -> None:
        place.write_bytes(content)

    write_whole(path, write, lambda place: place.read_bytes() == content)


class Shown(NamedTuple):
    """A picture as PNG files, for light and for dark pages."""

    picture: Picture
    light: bytes
    dark: bytes


# The page


def card_page(
    measured: Summary,
    scenario: Scenario,
    shown: Sequence[Shown],
    description: Mapping[str, Any],
    paper: PublishedFigures | None = None,
) -> str:
    """The page as text, from what has been measured and drawn; see `write_card`."""
    figures = {drawn.picture.name: _figure(drawn) for drawn in shown}
    name = str(description.get("name", "unnamed"))
    what = str(description.get("specification", {}).get("summary", ""))
    parts = [
        _header(name, what, measured, scenario),
        _section("How it is made", _made(name, scenario, description)),
        _section("Table 1", _table_1(measured.table_1, paper)),
        _section("Goals", _beside(*(figures[key] for key in figures if key.startswith(("coverage", "reached-by"))))),
        _section("Flights", _beside(*(figures[key] for key in _FLIGHTS), _responses(measured))),
        _section("Smoothness: Table 12", _beside(figures["smoothness"], _table_12(measured, paper))),
        _section("Wear", _wear(measured)),
        _section("Checks", _checks(measured)),
        _section("Columns", _schema(description)),
        _section("Where it is from", _provenance(description)),
    ]
    return _PAGE.replace("{title}", html.escape(name)).replace("{body}", "\n".join(filter(None, parts)))


def _header(name: str, what: str, measured: Summary, scenario: Scenario) -> str:
    row = measured.table_1
    hours = row.transitions * scenario.settings.time_step / 3600.0
    tiles = [
        (_number(measured.coverage.flown.sum()), "goals flown"),
        (_number(row.trajectories), "flights"),
        (_number(row.transitions), "transitions"),
        (_number(row.coverage_percent, 2) + " %", "of the goals reached"),
        (_number(row.length_steps.mean * scenario.settings.time_step, 1) + " s", "mean duration"),
        (_number(hours, 1 if hours < 100 else 0) + " h", "in the air"),
    ]
    items = "".join(f"<li><b>{value}</b><span>{text}</span></li>" for value, text in tiles)
    sentence = html.escape(what[:1].upper() + what[1:]).rstrip(".")
    lead = f"<p class=lead>{sentence}.</p>" if what else ""
    heading = f"<p class=kind>vvc-bench data card</p><h1>{html.escape(name)}</h1>"
    return f"<header>{heading}{lead}<ul class=tiles>{items}</ul></header>"


def _section(title: str, content: str) -> str:
    return f"<section><h2>{html.escape(title)}</h2>\n{content}</section>" if content else ""


def _beside(*parts: str) -> str:
    """Parts in two columns, where the page is wide enough."""
    return "<div class=columns>" + "".join(f"<div>{part}</div>" for part in parts) + "</div>"


def _figure(drawn: Shown) -> str:
    light, dark = (base64.b64encode(content).decode() for content in (drawn.light, drawn.dark))
    width, height = (int.from_bytes(drawn.light[at : at + 4]) for at in (16, 20))  # IHDR
    title, caption = html.escape(drawn.picture.title), html.escape(drawn.picture.caption)
    return (
        f"<figure><h3>{title}</h3><picture>"
        f'<source media="(prefers-color-scheme: dark)" srcset="data:image/png;base64,{dark}">'
        f'<img src="data:image/png;base64,{light}" width={width} height={height} alt="{title}. {caption}">'
        f"</picture><figcaption>{caption}</figcaption></figure>\n"
    )


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of ready-made cells; the first column names the rows, and a row of one cell what follows."""
    head = "".join(f"<th>{cell}</th>" for cell in header)
    body = "".join(
        f"<tr><th scope=row>{first}</th>" + "".join(f"<td>{cell}</td>" for cell in rest) + "</tr>"
        if rest
        else f"<tr><th colspan={len(header)}><b>{first}</b></th></tr>"
        for first, *rest in rows
    )
    return f"<div class=wide><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n"


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
        "<p>How the flights to all goals ended:</p>" + _table(["ended by", "flights"], _event_rows(tried))
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
    return [(html.escape(name.replace("_", " ")), _number(count)) for name, count in known]


def _table_1(row: Table1, paper: PublishedFigures | None) -> str:
    ours: Mapping[str, Any] = row._asdict()
    sets = {_THIS_SET: ours} | (dict(paper.table_1) if paper else {})
    rows = [
        (measure.title, *(_number(figures.get(key), measure.decimals) for figures in sets.values()))
        for key, measure in _TABLE_1.items()
    ]
    note = (
        "<p class=note>Mean ± standard deviation over the flights; errors are means over each flight's last second.</p>"
    )
    return _table(["", *map(html.escape, sets)], rows) + note


def _table_12(measured: Summary, paper: PublishedFigures | None) -> str:
    table, theirs = measured.table_12, paper.table_12 if paper else {}
    groups = {
        "seen": table.observations,
        "seen, followed past ±180°": table.unwrapped,
        "commanded": table.actions,
    }
    rows: list[Sequence[str]] = []
    for title, entries in groups.items():
        rows += [(title,), *((column_text(name), *_smooth(entry)) for name, entry in entries.items())]
    if theirs:
        known = ((column_text(name), *(_significant(figure) for figure in figures)) for name, figures in theirs.items())
        rows += [("seen, in the paper",), *known]
    note = (
        "<p class=note>Mean ± standard deviation over the flights; smaller is smoother. s₁ (eq. 23): amplitude times "
        "frequency, the mean over the spectrum: the first ⌊N/2⌋ bins, the one at zero among them, amplitude "
        "2/N·|FFT|, frequency as a share of half the sampling rate. s₂ (eq. 24): mean absolute change from step to "
        "step. Angles are taken as they are reported, as in the paper, unless said otherwise.</p>"
    )
    return _table(["", "s₁", "s₂"], rows) + note


def _smooth(entry: VariableSmoothness) -> tuple[str, str]:
    first, second = (f"{_significant(part.mean)} ± {_significant(part.std)}" for part in entry)
    return first, second


def _responses(measured: Summary) -> str:
    speed, direction = measured.speed_response, measured.direction_response
    rows = [
        ("band", f"{speed.band:g} m/s", f"{direction.band:g}°"),
        *(
            (title, *(_number(getattr(part, name), decimals) for part in (speed, direction)))
            for title, name, decimals in (
                ("first inside after, s", "arrival_s", 1),
                ("inside for good after, s", "settling_s", 1),
                ("inside at the end, % of flights", "settled_percent", 1),
                ("outside again in between, %", "overshooting_percent", 1),
                ("how far outside, m/s and °", "overshoot", 2),
            )
        ),
    ]
    return _table(["settling", "speed", "direction"], rows)


def _wear(measured: Summary) -> str:
    commands = [
        (
            column_text(name),
            _number(part.at_low_percent, 1),
            _number(part.at_high_percent, 1),
            _number(part.bang_bang_percent, 1),
            _number(part.switches_per_s, 3),
        )
        for name, part in measured.wear.commands.items()
    ]
    deflections = [
        (column_text(name), _number(part.travel_per_s, 2), _number(part.saturated_percent, 1))
        for name, part in measured.wear.deflections.items()
    ]
    load = measured.wear.load
    loads = (
        f"<p>The normal load factor lies between {_number(load.least_g, 2)} and {_number(load.largest_g, 2)} g. It is "
        f"below {_number(load.low_limit_g)} g in {_number(load.below_percent, 3)} % of the steps and above "
        f"{_number(load.high_limit_g)} g in {_number(load.above_percent, 3)} %; "
        f"{_number(load.episodes_beyond_percent, 2)} % of the flights are beyond either at least once.</p>"
    )
    note = (
        "<p class=note>Share of the steps with a command at its lower, its upper or either bound, and jumps from one "
        "to the other; travel: the sum of all changes, in degrees or shares of full throttle.</p>"
    )
    return (
        _beside(
            _table(["commanded", "low, %", "high, %", "either, %", "jumps, 1/s"], commands),
            _table(["flown", "travel, each second", "at its limits, %"], deflections),
        )
        + note
        + loads
    )


def _checks(measured: Summary) -> str:
    found = measured.integrity
    constant = "; ".join(f"{array}: {', '.join(names)}" for array, names in found.constant_columns.items())
    rows = [
        ("goals that occur again", _number(found.repeated_goals)),
        ("flights that occur again, bit for bit", _number(found.repeated_flights)),
        ("columns that never change", html.escape(constant) or "none"),
        ("return", _number(measured.returns, 1)),
    ]
    return _table(["", ""], rows)


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
            *(_text(str(entry.get(key, ""))) for key in ("unit", "type", "meaning")),
            *(_significant(entry[key]) if key in entry else "" for key in statistics),
        )
        for name, entry in known.items()
    ]
    return _table(["column", _text("unit"), _text("type"), _text("meaning"), *statistics], rows)


def _provenance(description: Mapping[str, Any]) -> str:
    rows = [("seed", _text(str(description["seed"])))] if "seed" in description else []
    rows += [(name.replace("_", "-"), _text(str(version))) for name, version in _entries(description, "versions")]
    rows += [(f"made from {name}", _hash(digest)) for name, digest in _entries(description, "parents")]
    rows += [("manifest.json", _hash(description["hash"]))] if "hash" in description else []
    rows += [(name, _hash(entry["sha256"])) for name, entry in _entries(description, "files")]
    table = _table(["", ""], [(html.escape(name), value) for name, value in rows]) if rows else ""
    return table + f"<p>Licence: {html.escape(LICENCE)}</p>"


def _entries(description: Mapping[str, Any], key: str) -> Iterable[tuple[str, Any]]:
    entries: Mapping[str, Any] = description.get(key, {})
    return entries.items()


def _text(content: str) -> str:
    """A cell that is set to the left."""
    return f"<span class=text>{html.escape(content)}</span>"


def _hash(digest: object) -> str:
    return f"<code class=text>{html.escape(str(digest))}</code>"


# Numbers


def _number(value: object, decimals: int = 0) -> str:
    """A figure for people: thousands set apart, a true minus sign, – for what is not known."""
    if isinstance(value, Spread):
        mean, std = _number(value.mean, decimals), _number(value.std, decimals)
        return mean if std == _UNKNOWN else f"{mean} ± {std}"
    if not isinstance(value, int | float | np.number) or not math.isfinite(value):
        return _UNKNOWN
    return f"{value:,.{decimals}f}".replace("-", "−")


def _significant(value: float, digits: int = 3) -> str:
    if not math.isfinite(value):
        return _UNKNOWN
    if value == 0.0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{decimals}f}" if decimals <= 2 * digits else f"{value:.{digits - 1}e}"
    return text.replace("-", "−")


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title} – data card</title>
<style>
:root {
  --page: #f5f6f8; --sheet: #ffffff; --ink: #1c2230; --faint: #5d6675; --line: #e3e7ec; --accent: #0072b2;
  --code: #f0f2f5;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #0e1116; --sheet: #171b22; --ink: #e8ebf0; --faint: #a3adbb; --line: #2c333d; --accent: #56b4e9;
    --code: #10141a;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif;
}
main { max-width: 68rem; margin: 0 auto; padding: clamp(1rem, 4vw, 3rem) clamp(0.75rem, 3vw, 2rem); }
header { padding: 0 0.25rem 0.5rem; }
.kind { margin: 0; color: var(--accent); font-weight: 600; font-size: 0.85rem; letter-spacing: 0.02em; }
h1 { margin: 0.1rem 0 0.3rem; font-size: clamp(1.9rem, 6vw, 2.8rem); line-height: 1.15; overflow-wrap: anywhere; }
.lead { margin: 0 0 1.2rem; font-size: 1.1rem; color: var(--faint); }
.tiles {
  list-style: none; margin: 0; padding: 0; display: grid; gap: 0.6rem;
  grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr));
}
.tiles li { background: var(--sheet); border: 1px solid var(--line); border-radius: 0.7rem; padding: 0.7rem 0.9rem; }
.tiles b { display: block; font-size: 1.3rem; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tiles span { color: var(--faint); font-size: 0.85rem; }
section {
  background: var(--sheet); border: 1px solid var(--line); border-radius: 0.9rem;
  margin: 1rem 0; padding: clamp(1rem, 3vw, 1.6rem);
}
h2 { margin: 0 0 0.8rem; font-size: 1.25rem; line-height: 1.3; }
h3 { margin: 0 0 0.3rem; font-size: 0.95rem; }
p { margin: 0 0 0.8rem; max-width: 46rem; }
section > p:last-child, section > .wide:last-child { margin-bottom: 0; }
.columns { columns: 20rem 2; column-gap: 2rem; margin-bottom: -1.6rem; }
.columns + p { margin-top: 1.6rem; }
.columns > div { break-inside: avoid; padding-bottom: 1.6rem; }
figure { margin: 0; max-width: 32rem; }
figure img { display: block; width: 100%; height: auto; }
figcaption, .note { color: var(--faint); font-size: 0.85rem; line-height: 1.45; }
figcaption { margin-top: 0.4rem; }
.wide { overflow-x: auto; margin-bottom: 0.8rem; }
table {
  border-collapse: collapse; font-size: clamp(0.8rem, 0.7rem + 0.4vw, 0.9rem); font-variant-numeric: tabular-nums;
}
th, td {
  padding: 0.35rem clamp(0.5rem, 2vw, 1.2rem) 0.35rem 0; border-bottom: 1px solid var(--line);
  text-align: right; white-space: nowrap;
}
tr > :last-child { padding-right: 0; }
th:first-child, th:has(.text), td:has(.text) { text-align: left; }
td:has(code) { white-space: normal; overflow-wrap: anywhere; }
thead th { color: var(--faint); font-weight: 600; vertical-align: bottom; white-space: normal; }
thead:not(:has(th:not(:empty))) { display: none; }
tbody th { font-weight: 400; white-space: normal; }
tbody b { font-weight: 600; color: var(--faint); }
pre {
  overflow-x: auto; margin: 0 0 0.9rem; padding: 0.7rem 0.9rem; background: var(--code); border-radius: 0.5rem;
  line-height: 1.45;
}
code { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace; font-size: 0.78rem; }
details { margin: 0 0 0.7rem; }
summary { cursor: pointer; color: var(--accent); padding: 0.2rem 0; }
@media print { body { background: none; } section, .tiles li { break-inside: avoid; } }
</style>
</head>
<body>
<main>
{body}
</main>
</body>
</html>
"""
