"""``vvc-bench best``: the shortest known flight to each goal, and shorter ones handed in."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vvc_bench.datasets.best import (
    CONTESTS,
    DEFAULT_CONTEST,
    BestKnown,
    Contest,
    Judged,
    improved,
    judge,
    named_contest,
    nearest_goals,
    read_submission,
    read_table,
    table_path,
    write_table,
)
from vvc_bench.goals import GOAL_COLUMNS, checked_goals

FAILED = 1
"""Exit code where flights do not do what they should."""
_SHOWN = 5
_SOURCE_HELP = "a set's name or folder, or a flight that vvc-bench fly wrote, as .csv or .parquet"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", title="actions")
    show = actions.add_parser("show", help="show the table, or what is known of a goal", allow_abbrev=False)
    show.add_argument("--goal", type=_goal, metavar="SPEED,PATH_ANGLE,AZIMUTH", help=f"{', '.join(GOAL_COLUMNS)}")
    verify = actions.add_parser("verify", help="fly again and compare with the table", allow_abbrev=False)
    verify.add_argument("source", help=_SOURCE_HELP)
    submit = actions.add_parser("submit", help="fly again and enter what is shorter, or first", allow_abbrev=False)
    submit.add_argument("source", help=_SOURCE_HELP)
    submit.add_argument("--as", dest="name", required=True, help="who flew it, as it will stand in the table")
    for action in (show, verify, submit):
        action.add_argument(
            "--table", default=DEFAULT_CONTEST, help=f"one of {', '.join(CONTESTS)} (default: %(default)s)"
        )
        action.add_argument("--file", type=Path, help="the table's file (default: the one of the package)")
        action.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Do it.

    Returns:
        0, or 1 where a flight that was to be verified does not reach its goal, or nothing that was submitted is better.

    Raises:
        ValueError: for an unknown table or set, or a file that is none.
        OSError: if something cannot be read or written.
    """
    contest = named_contest(options.table)
    path = options.file or table_path(options.table)
    best = read_table(path)
    if options.action == "show":
        return _show(options, contest, best)
    judged = judge(read_submission(options.source), contest, best)
    if options.action == "verify":
        _print(options, *_compared(options.source, judged))
        return 0 if judged.reached.all() else FAILED
    return _submit(options, path, best, judged)


def _goal(text: str) -> list[float]:
    try:
        goal: list[float] = checked_goals([float(part) for part in text.split(",")]).tolist()
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return goal


def _print(options: argparse.Namespace, document: dict[str, Any], lines: Sequence[str]) -> None:
    print(json.dumps(document, indent=2) if options.json else "\n".join(lines))


def _show(options: argparse.Namespace, contest: Contest, best: BestKnown) -> int:
    if options.goal is not None:
        rows = [_row(best, int(k)) for k in nearest_goals(best, options.goal, _SHOWN)]
        lines = [f"{_named(row)}: {row['steps']} steps, {row['source']}" for row in rows]
        _print(options, {"nearest": rows}, lines)
        return 0
    sources, counts = np.unique(best.sources, return_counts=True)
    goals = len(contest.grid.goals)
    by_source = dict(zip(sources.tolist(), counts.tolist(), strict=True))
    mean = float(best.steps.mean()) if len(best.steps) else None
    document = {"table": options.table, "goals": goals, "known": len(best.steps), "mean_steps": mean}
    lines = [
        f"{options.table}: a flight is known to {len(best.steps):,} of {goals:,} goals"
        + (f", {mean:.1f} steps on average" if mean is not None else ""),
        *(f"{count:>8,} by {source}" for source, count in by_source.items()),
    ]
    _print(options, document | {"sources": by_source}, lines)
    return 0


def _row(best: BestKnown, k: int) -> dict[str, Any]:
    goal = dict(zip(GOAL_COLUMNS, best.goals[k].tolist(), strict=True))
    return {**goal, "steps": int(best.steps[k]), "source": str(best.sources[k])}


def _named(row: dict[str, Any]) -> str:
    return ", ".join(f"{row[name]:g}" for name in GOAL_COLUMNS)


def _compared(source: str, judged: Judged) -> tuple[dict[str, Any], list[str]]:
    ratios, better = judged.ratios, int(judged.better.sum())
    document = {
        "flights": len(judged.goals),
        "reached": int(judged.reached.sum()),
        "better": better,
        "as_short": int((ratios <= 1.0).sum()),
        "mean_time_ratio": float(ratios.mean()) if ratios.size else None,
        "off_grid": int(np.isnan(judged.known_steps).sum()),
    }
    lines = [
        f"{source}: {document['reached']:,} of {document['flights']:,} flights reach their goals, flown again",
        f"{better:,} are shorter than what is known, or first; {document['as_short']:,} are as short or shorter",
    ]
    if ratios.size:
        lines.append(f"time ratio {ratios.mean():.3f} on average over {ratios.size:,} goals")
    if document["off_grid"]:
        lines.append(f"{document['off_grid']:,} goals are not on the grid")
    return document, lines


def _submit(options: argparse.Namespace, path: Path, best: BestKnown, judged: Judged) -> int:
    document, lines = _compared(options.source, judged)
    if not judged.better.any():
        _print(options, document | {"accepted": 0}, [*lines, "nothing is better than what is known"])
        return FAILED
    after = improved(best, judged, options.name)
    changed = len(after.steps) - len(best.steps)
    write_table(after, path)
    accepted = {"accepted": int(judged.better.sum()), "new_goals": changed, "file": str(path)}
    _print(options, document | accepted, [*lines, f"{path} is written: {changed:,} goals are new"])
    return 0
