"""``vvc-bench compare``: who reaches more of the same goals, and whether that is more than chance."""

import argparse
import json
from pathlib import Path

import numpy as np

from vvc_bench.cli.report import FOLDERS_HELP, add_policy_option, write_page
from vvc_bench.evaluation.comparison import Comparison, Contender, compare
from vvc_bench.evaluation.methods import read_methods
from vvc_bench.metrics import Estimate


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    parser.add_argument("evaluations", nargs="+", metavar="FOLDER", help=FOLDERS_HELP)
    parser.add_argument("--seed", type=int, default=0, help="of the bootstrap over runs (default: %(default)s)")
    parser.add_argument("--output", type=Path, metavar="PAGE", help="write the report as well, an HTML page")
    add_policy_option(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Compare, print, and write the page if one is wanted.

    Raises:
        ValueError: for evaluations that cannot be compared.
        ImportError: for a page without matplotlib.
        OSError: if a file cannot be read or written.
    """
    methods = read_methods(options.evaluations)
    found = compare(methods, np.random.default_rng(options.seed))
    if options.output:
        write_page(options.output, methods, options.policy)
    if options.json:
        document = found.to_json() | ({"page": str(options.output)} if options.output else {})
        print(json.dumps(document, indent=2, allow_nan=False))
        return 0
    print("\n".join(_lines(found)))
    if options.output:
        print(f"wrote {options.output}")
    return 0


def _lines(found: Comparison) -> list[str]:
    width = max(len(contender.label) for contender in found.contenders)
    pairs = [f"{pair.first} – {pair.second}" for pair in found.pairs]
    wide = max(map(len, pairs))
    return [
        f"{found.protocol['name']}, {len(found.goals):,} goals",
        "",
        f"{'':<{width}}  {'ranks':>5}  {'reached %':>9}  {'95 %':>13}  {'runs: mean ± std':>16}  {'IQM (95 %)':>20}",
        *(_contender_line(contender, width) for contender in found.contenders),
        "",
        f"{'':<{wide}}  {'difference %':>12}  {'95 %':>16}  {'wins':>13}  {'p':>8}  {'p (Holm)':>8}  better",
        *(
            f"{name:<{wide}}  {100 * pair.difference.value:>+12.2f}  {_ends(pair.difference, '+.2f'):>16}  "
            f"{f'{pair.first_only:,}:{pair.second_only:,}':>13}  {pair.p_value:>8.2g}  {pair.adjusted_p_value:>8.2g}  "
            f"{pair.better or 'open'}"
            for name, pair in zip(pairs, found.pairs, strict=True)
        ),
    ]


def _contender_line(contender: Contender, width: int) -> str:
    rank = contender.rank
    over_runs = contender.aggregates["success_percent"]
    mean, std = over_runs.mean_std
    middle = over_runs.interquartile_mean
    runs = sum(over_runs.runs.values())
    spread = f"{mean:.2f} ± {std:.2f}" if runs > 1 else "one run"
    interval = f"{middle.value:.2f} ({middle.low:.2f}..{middle.high:.2f})" if runs > 1 else ""
    return (
        f"{contender.label:<{width}}  {f'{rank.low}..{rank.high}':>5}  {100 * contender.success.value:>9.2f}  "
        f"{_ends(contender.success, '.2f'):>13}  {spread:>16}  {interval:>20}"
    )


def _ends(estimate: Estimate, form: str) -> str:
    """An interval in percent."""
    return f"{format(100 * estimate.low, form)}..{format(100 * estimate.high, form)}"
