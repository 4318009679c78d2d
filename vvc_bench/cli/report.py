"""``vvc-bench report``: evaluations as one self-contained page with pictures."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from vvc_bench.datasets.progress import progress_line
from vvc_bench.evaluation.methods import Method, read_methods

FOLDERS_HELP = (
    "what vvc-bench evaluate wrote, as FOLDER or LABEL=FOLDER; folders with the same label are runs of one method"
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    parser.add_argument("evaluations", nargs="+", metavar="FOLDER", help=FOLDERS_HELP)
    parser.add_argument(
        "--output", type=Path, default=Path("report.html"), metavar="PAGE", help="page to write (default: %(default)s)"
    )
    add_policy_option(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def add_policy_option(parser: argparse.ArgumentParser) -> None:
    """The option for policies whose sample flights are shown."""
    parser.add_argument(
        "--policy",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="ONNX file of an evaluated policy, known by its checksum, for sample flights (may be repeated; built-in "
        "policies are found without)",
    )


def run(options: argparse.Namespace) -> int:
    """Read, write, say where.

    Raises:
        ValueError: for folders that hold no evaluation.
        ImportError: without matplotlib.
        OSError: if a file cannot be read or written.
    """
    methods = read_methods(options.evaluations)
    write_page(options.output, methods, options.policy)
    print(json.dumps({"page": str(options.output)}) if options.json else f"wrote {options.output}")
    return 0


def write_page(path: Path, methods: Sequence[Method], policies: Sequence[Path]) -> None:
    """Write the report of some methods, with sample flights of the policies that are at hand."""
    from vvc_bench.evaluation.report import write_report
    from vvc_bench.evaluation.samples import flown_protocols, sample_flights

    protocols = flown_protocols(methods)
    with progress_line("flying samples", "methods") as show:
        flights = sample_flights(methods, protocols, policies, show)
    with progress_line("drawing", "protocols") as show:
        write_report(path, methods, protocols, flights, show)
