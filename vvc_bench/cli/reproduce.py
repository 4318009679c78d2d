"""``vvc-bench reproduce``: make tables of the paper again, beside its figures."""

import argparse
import json
from pathlib import Path

from vvc_bench.cli.train import count, require_extra
from vvc_bench.datasets.progress import progress_line
from vvc_bench.reproduction.rendering import as_markdown
from vvc_bench.reproduction.reproduce import reproduce
from vvc_bench.reproduction.trials import BUDGETS, TABLES, TABLES_OF_LEARNERS

_ALL = "all"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    budgets = "; ".join(f"{name}: {budget.says}" for name, budget in BUDGETS.items())
    seeds = ", ".join(f"{len(budget.seeds)} for {name}" for name, budget in BUDGETS.items())
    parser.add_argument("tables", nargs="+", choices=(*TABLES, _ALL), metavar="TABLE", help=f"{', '.join(TABLES)}, all")
    parser.add_argument(
        "--budget", choices=list(BUDGETS), default=next(iter(BUDGETS)), help=f"(default: %(default)s) {budgets}"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("results"), metavar="FOLDER", help="of results (default: %(default)s)"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="of trainings (default: %(default)s)"
    )
    parser.add_argument("--seeds", type=count, metavar="COUNT", help=f"of each learner (default: {seeds})")
    parser.add_argument("--threads", type=count, default=1, help="at most so many (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Do it.

    Returns:
        0, whatever the verdicts are.

    Raises:
        ValueError: for a folder that holds another training.
        ImportError: for tables of learners without the extra ``train``.
        OSError: if a folder cannot be written.
    """
    chosen = TABLES if _ALL in options.tables else tuple(dict.fromkeys(options.tables))
    if any(table in TABLES_OF_LEARNERS for table in chosen):
        require_extra()
    budget = BUDGETS[options.budget]
    if options.seeds is not None:
        budget = budget.with_seeds(options.seeds)
    documents = []
    for table in chosen:
        documents.append(
            reproduce(
                table,
                budget,
                options.output,
                options.runs,
                threads=options.threads,
                progress=progress_line,
            )
        )
        if not options.json:
            print(as_markdown(documents[-1]), flush=True)
    if options.json:
        print(json.dumps(documents[0] if len(documents) == 1 else documents, indent=2))
    return 0
