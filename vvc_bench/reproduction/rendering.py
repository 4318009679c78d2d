"""A table that was run, as Markdown: what is printed, and what lies beside the document."""

from collections.abc import Mapping, Sequence
from typing import Any

from vvc_bench.metrics import CRITERIA, Spread
from vvc_bench.page import UNKNOWN, number, significant
from vvc_bench.reproduction.trials import TABLES_OF_LEARNERS
from vvc_bench.reproduction.verdicts import TABLE_1, Measure, Verdict

NOT_AT_HAND = "not at hand"

_GROUPS = {"observations": "seen", "unwrapped": "seen, unwrapped", "actions": "commanded"}

_CRITERIA = {name: Measure(title, "%", 2) for name, title in zip(CRITERIA, ("10/1/1", "10/1", "10/3"), strict=True)}
_SETS_NOTE = (
    "Sets hold what was flown to every goal of the grid: their figures have no interval. Errors are means over the "
    "last second, mean ± standard deviation over the flights. Coverage by other criteria, of the flights' last second: "
    + "; ".join(f"{_CRITERIA[name].title}, {text}" for name, text in CRITERIA.items())
    + "."
)
_SMOOTHNESS_NOTE = (
    "Mean ± standard deviation over the flights: s1 (eq. 23) in the variable's unit, s2 (eq. 24) in the unit for each "
    "step. Angles are taken as they are seen, as in the paper, and those that jump once more followed past ±180°, "
    "unwrapped."
)
_LEARNERS_NOTE = (
    "Goals reached by the policy that did best on the validation goals, with the 95 % interval: Wilson's for one "
    "policy, that of the interquartile mean over several. Paper and verdict are about the first protocol."
)


def as_markdown(document: Mapping[str, Any]) -> str:
    """The table of a document that `vvc_bench.reproduction.reproduce.reproduce` made."""
    budget, rows = document["budget"], document["rows"]
    match document["table"]:
        case "table1":
            header, cells, note = _table_1(rows)
        case "table12":
            header, cells, note = _table_12(rows)
        case _:
            header, cells, note = _learners(rows, budget["protocols"])
    title = f"# Table {document['table'].removeprefix('table')}: {document['title']}"
    said = f"Budget {budget['name']}: {budget['says']}."
    seeds = f" --seeds {len(budget['seeds'])}" if document["table"] in TABLES_OF_LEARNERS else ""
    made = f"Made by `vvc-bench reproduce {document['table']} --budget {budget['name']}{seeds}`."
    return "\n\n".join([title, f"{said} {made}", _grid(header, cells), note]) + "\n"


def _grid(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells in columns that stand below each other in plain text too."""
    widths = [max(3, *map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join(
        f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |" for line in lines
    )


def _verdict(row: Mapping[str, Any]) -> str:
    """One line that holds no mark of a table."""
    return " ".join(str(Verdict(**row["verdict"])).split()).replace("|", "/")


def _table_1(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]], str]:
    """A line for ours, and one for the paper's where there is something."""
    shown = {**TABLE_1, **_CRITERIA}
    header = ["set", "", *(", ".join(filter(None, each[:2])) for each in shown.values()), "verdict"]
    cells = []
    for row in rows:
        ours = [_figure((row["ours"] or {}).get(column), each.decimals) for column, each in shown.items()]
        cells.append([row["used"], "ours", *ours, _verdict(row)])
        if row["paper"]:
            paper = [_figure(row["paper"].get(column), each.decimals, NOT_AT_HAND) for column, each in TABLE_1.items()]
            cells.append(["", "paper", *paper, *("" for _ in CRITERIA), ""])
    return header, cells, _SETS_NOTE


def _figure(value: Any, decimals: int, missing: str = UNKNOWN) -> str:
    if value is None:
        return missing
    return number(_spread(value) if isinstance(value, Mapping) else value, decimals)


def _spread(value: Mapping[str, float | None]) -> Spread:
    mean, std = (float("nan") if part is None else part for part in (value["mean"], value["std"]))
    return Spread(mean, std)


def _table_12(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]], str]:
    header = ["set", "", "variable", "s1", "s2", "s1, paper", "s2, paper", "verdict"]
    cells = []
    for row in rows:
        group = _GROUPS[row["group"]] if row["ours"] else ""
        ours = [_smooth(row["ours"][name]) for name in ("s1", "s2")] if row["ours"] else [UNKNOWN] * 2
        paper = [NOT_AT_HAND if each is None else significant(each) for each in row["paper"] or (None, None)]
        cells.append([row["used"], group, row.get("variable", ""), *ours, *paper, _verdict(row)])
    return header, cells, _SMOOTHNESS_NOTE


def _smooth(value: Mapping[str, float | None]) -> str:
    mean, std = _spread(value)
    return f"{significant(mean)} ± {significant(std)}"


def _learners(rows: Sequence[Mapping[str, Any]], protocols: Sequence[str]) -> tuple[list[str], list[list[str]], str]:
    header = ["", "paper, %", *(f"{name}, %" for name in protocols), "budget", "verdict"]
    cells = [
        [
            row["label"],
            NOT_AT_HAND if row["paper"] is None else number(row["paper"], 2),
            *(_share(row["ours"][name]) if row["ours"] else UNKNOWN for name in protocols),
            _spent(row),
            _verdict(row),
        ]
        for row in rows
    ]
    return header, cells, _LEARNERS_NOTE


def _share(ours: Mapping[str, Any]) -> str:
    percent, low, high = (number(ours[name], 1) for name in ("percent", "low", "high"))
    return f"{percent} ({low} to {high})"


def _spent(row: Mapping[str, Any]) -> str:
    """Epochs and steps of each run, wall time of all together, threads."""
    trainings = row.get("trainings", ())
    if not trainings:
        return "none" if row["ours"] else UNKNOWN
    runs = sorted({each["seed"] for each in trainings})
    amounts = " + ".join(f"{number(each['done'])} {each['unit']}" for each in trainings if each["seed"] == runs[0])
    threads = max(each["threads"] for each in trainings)
    parts = [
        amounts,
        f"{len(runs)} seed" + "s" * (len(runs) > 1),
        _duration(sum(each["wall_s"] for each in trainings)),
        f"{threads} thread" + "s" * (threads > 1),
    ]
    return ", ".join(parts)


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
