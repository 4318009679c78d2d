"""Rows of Tables 1 and 12: sets of demonstrations, measured."""

from collections.abc import Callable, Mapping
from typing import Any

from vvc_bench.datasets.catalogue import CATALOGUE, goals_flown
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.metrics import PUBLISHED, PublishedFigures, coverage_by_criterion
from vvc_bench.metrics.documents import plain
from vvc_bench.metrics.published import PAPER
from vvc_bench.reproduction.trials import SETS, Budget
from vvc_bench.reproduction.verdicts import NOT_RUN, Verdict, judge_set, judge_smoothness

_UNPUBLISHED = PublishedFigures({})


class NotThereError(Exception):
    """What a row is about cannot be had; says why."""


def find_set(name: str) -> Dataset:
    """A set of the catalogue, made or fetched if need be.

    Raises:
        NotThereError: if there is none of that name, or it cannot be had.
    """
    if name not in CATALOGUE:
        raise NotThereError(f"there is no set {name}")
    try:
        return load_dataset(name)
    except (ValueError, ImportError, OSError) as error:
        raise NotThereError(str(error)) from error


def rows(table: str, budget: Budget, progress: Callable[[int, int], object]) -> list[dict[str, Any]]:
    """Rows of ``table1`` or ``table12``, as documents; a set that cannot be had has a row that says why.

    Args:
        table: which.
        budget: whether samples stand for the sets.
        progress: told how many sets are measured, and of how many.
    """
    measure = {"table1": _row_of_table_1, "table12": _rows_of_table_12}[table]
    made: list[dict[str, Any]] = []
    for k, name in enumerate(SETS):
        progress(k, len(SETS))
        known = PUBLISHED.get(name, _UNPUBLISHED)
        label = {"set": name, "used": budget.set_name(name)}
        try:
            measured = measure(find_set(budget.set_name(name)), known, budget)
        except NotThereError as reason:
            measured = [_missing(table, known, str(reason))]
        made += [plain(label | row) for row in measured]
    progress(len(SETS), len(SETS))
    return made


def _missing(table: str, known: PublishedFigures, reason: str) -> dict[str, Any]:
    paper = known.table_1.get(PAPER, {}) if table == "table1" else known.table_12
    return {"hash": None, "ours": None, "paper": paper or None, "verdict": Verdict(NOT_RUN, reason)}


def _row_of_table_1(dataset: Dataset, known: PublishedFigures, budget: Budget) -> list[dict[str, Any]]:
    paper = known.table_1.get(PAPER, {})
    measured: dict[str, Any] = dataset.manifest["metrics"]["table_1"]
    criteria = coverage_by_criterion(dataset.read(), goals_flown(dataset.name))
    verdict = judge_set(measured, paper, run=budget.judges_sets)
    return [{"hash": dataset.hash, "ours": measured | criteria, "paper": paper or None, "verdict": verdict}]


def _rows_of_table_12(dataset: Dataset, known: PublishedFigures, budget: Budget) -> list[dict[str, Any]]:
    """One for each variable; the paper's are of what is seen, angles as they are."""
    groups: Mapping[str, Mapping[str, Any]] = dataset.manifest["metrics"]["table_12"]
    return [
        {
            "hash": dataset.hash,
            "group": group,
            "variable": variable,
            "ours": ours,
            "paper": paper,
            "verdict": judge_smoothness([ours[name]["mean"] for name in ours], paper, run=budget.judges_sets),
        }
        for group, variables in groups.items()
        for variable, ours in variables.items()
        for paper in (known.table_12.get(variable) if group == "observations" else None,)
    ]
