"""The command ``vvc-bench``: parse, call, print.

Each subcommand is a module with ``add_options(parser)`` and ``run(options) -> int``, named in `COMMANDS`. Only the
module of the chosen one is imported, so that help and errors come at once.
"""

import argparse
import importlib
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

from vvc_bench.version import __version__

BAD_INPUT = 2
INTERRUPTED = 130  # 128 + SIGINT, as shells report it

COMMANDS = {
    "fly": "fly one flight to a goal and write it to files",
    "datasets": "make, fetch, measure and check demonstration sets",
    "best": "show the shortest known flight to each goal, and hand in shorter ones",
    "train": "train a baseline, or go on with a training",
    "evaluate": "fly policies to every goal of a protocol and keep the results",
    "compare": "compare evaluations of the same protocol goal by goal",
    "report": "write evaluations as one page with pictures",
    "reproduce": "make tables of the paper again, beside its figures",
    "leaderboard": "submit policies, fly those of others again, rank them",
}
"""Name, also that of the module in this package, and what it does."""


class _Parser(argparse.ArgumentParser):
    """One line for an error, in place of the usage of every option."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: the arguments after the program's name; by default those of the process.

    Returns:
        The exit code: 0, 2 for bad input (with one line on stderr that says what was wrong), 130 if interrupted.
    """
    arguments = _join_negative_values(list(sys.argv[1:] if argv is None else argv))
    parser = _make_parser(arguments[0] if arguments else "")
    options = parser.parse_args(arguments)
    try:
        return int(importlib.import_module(f"{__name__}.{options.command}").run(options))
    except (ValueError, ImportError, OSError) as error:
        print(f"{parser.prog} {options.command}: error: {_message(error)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"{parser.prog} {options.command}: interrupted", file=sys.stderr)
        return INTERRUPTED


def _make_parser(chosen: str) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="vvc-bench", description="Fixed-wing velocity-vector control: simulator and benchmark.", allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"vvc-bench {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", title="commands")
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary, description=f"{summary.capitalize()}.", allow_abbrev=False)
        if name == chosen:
            importlib.import_module(f"{__name__}.{name}").add_options(command)
    return parser


def _join_negative_values(arguments: list[str]) -> list[str]:
    """``--option -5,3`` as ``--option=-5,3``: argparse takes what begins with a minus sign for another option."""
    joined: list[str] = []
    for argument in arguments:
        negative = re.match(r"-[.\d]|-(inf|nan)\b", argument, re.IGNORECASE)
        if negative and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _message(error: Exception) -> str:
    """What went wrong, on one line."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot write {error.filename}: {error.strerror}; choose another folder with --output"
    return " ".join(str(error).split())
