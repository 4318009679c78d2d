"""Run a table and keep what came of it: a document, the table, and what each training says of itself."""

import importlib.metadata
import json
import platform
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from vvc_bench.page import write_bytes
from vvc_bench.reproduction import sets
from vvc_bench.reproduction.rendering import as_markdown
from vvc_bench.reproduction.trials import TABLES, TABLES_OF_LEARNERS, TABLES_OF_SETS, Budget
from vvc_bench.version import __version__

TRAININGS = "trainings"
"""Folder of the copies of ``training.json``, in one for each budget."""

_PACKAGES = ("numba", "numpy")
_PACKAGES_OF_LEARNERS = ("imitation", "onnxruntime", "stable_baselines3", "torch")

Progress = Callable[[str, str], AbstractContextManager[Callable[[int, int], None]]]


def reproduce(
    table: str, budget: Budget, output: Path, runs: Path, *, threads: int = 1, progress: Progress
) -> dict[str, Any]:
    """Run what a table holds, as far as that is not done, and write it.

    Written are ``<table>-<budget>.json``, the same table as ``.md``, and for learners
    ``trainings/<budget>/<trial>-seed<k>.json``, each in one move. Equal results give equal bytes, wall times and the
    hashes of files that hold them aside.

    Args:
        table: one of `TABLES`.
        budget: what is spent.
        output: folder of what is kept.
        runs: folder of the trainings.
        threads: of trainings and evaluations.
        progress: makes a line of a label and a unit.

    Returns:
        What the document holds.

    Raises:
        ValueError: for an unknown table, or a folder that holds another training.
        OSError: if a folder cannot be written.
    """
    if table not in TABLES:
        raise ValueError(f"unknown table {table!r}; known are {', '.join(TABLES)}")
    if table in TABLES_OF_SETS:
        with progress(f"{table}, {budget.name}", " sets") as show:
            rows = sets.rows(table, budget, show)
        document = _document(table, TABLES_OF_SETS[table], budget, rows, _PACKAGES)
        document["sets"] = {row["used"]: row["hash"] for row in rows if row["hash"]}
    else:
        title, entries = TABLES_OF_LEARNERS[table]
        rows = _learner_rows(entries(budget), budget, output, runs, threads, progress)
        document = _document(table, title, budget, rows, (*_PACKAGES, *_PACKAGES_OF_LEARNERS))
        document["sets"] = {
            known["name"]: known["hash"]
            for row in rows
            for training in row.get("trainings", ())
            if (known := training["demonstrations"])
        }
    name = f"{table}-{budget.name}"
    text = json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"
    write_bytes(output / f"{name}.json", text.encode())
    write_bytes(output / f"{name}.md", as_markdown(document).encode())
    return document


def _learner_rows(
    entries: Sequence[Any], budget: Budget, output: Path, runs: Path, threads: int, progress: Progress
) -> list[dict[str, Any]]:
    from vvc_bench.baselines.training import TRAINING  # takes the extra
    from vvc_bench.reproduction import learners

    place = learners.Workplace(budget, runs, threads, progress)
    rows = []
    for entry in entries:
        rows.append(learners.row(entry, place))
        for training in rows[-1].get("trainings", ()):
            kept = runs / budget.name / training["run"] / TRAINING
            write_bytes(output / TRAININGS / budget.name / f"{training['run']}.json", kept.read_bytes())
    return rows


def _document(
    table: str, title: str, budget: Budget, rows: list[dict[str, Any]], packages: Sequence[str]
) -> dict[str, Any]:
    versions = {"vvc_bench": __version__, "python": platform.python_version()}
    return {
        "table": table,
        "title": title,
        "budget": _described(budget),
        "versions": versions | {name: importlib.metadata.version(name) for name in packages},
        "rows": rows,
    }


def _described(budget: Budget) -> Mapping[str, Any]:
    return {
        "name": budget.name,
        "says": budget.says,
        "task": budget.task,
        "seeds": list(budget.seeds),
        "protocols": list(budget.protocols),
        "samples": budget.samples,
    }
