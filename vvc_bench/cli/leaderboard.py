"""``vvc-bench leaderboard``: submit policies, fly those of others again, write the tables."""

import argparse
import dataclasses
import json
import threading
from pathlib import Path

from vvc_bench.datasets.progress import progress_line
from vvc_bench.leaderboard.confinement import Limits
from vvc_bench.leaderboard.entries import list_entries
from vvc_bench.leaderboard.render import render
from vvc_bench.leaderboard.submission import Erratum
from vvc_bench.leaderboard.submit import About, submit, training_data
from vvc_bench.leaderboard.verify import Verdict, verify_entry
from vvc_bench.policies.built_in import BUILT_IN

REFUSED = 1
"""Exit code where an entry is refused, or the pages are not those of the entries."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    commands = parser.add_subparsers(dest="action", required=True, metavar="ACTION", title="actions")
    for name, (summary, add, _) in _COMMANDS.items():
        action = commands.add_parser(name, help=summary, description=f"{summary.capitalize()}.", allow_abbrev=False)
        add(action)
        action.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Do it.

    Returns:
        0, or 1 where an entry is refused or the pages are not current.

    Raises:
        ValueError: for an impossible choice, or a policy that cannot be submitted.
        OSError: if something cannot be read or written.
    """
    return _COMMANDS[options.action][2](options)


def _flight_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--threads", type=int, help="at most so many (default: all cores)")
    parser.add_argument(
        "--time-limit-s",
        type=float,
        default=Limits.wall_s,
        help=f"stop a policy after so many seconds (default: {Limits.wall_s:g})",
    )


def _submit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--policy", required=True, help=f"an ONNX model, or {', '.join(BUILT_IN)}")
    parser.add_argument("--protocol", required=True, help="what to evaluate it by, as hard-1k-v0")
    parser.add_argument("--author", required=True, help="who you are")
    parser.add_argument("--method", required=True, help="what it is, in a sentence")
    parser.add_argument("--entry", metavar="NAME", help="what to call it (default: as the policy)")
    parser.add_argument(
        "--training-data", nargs="+", default=[], metavar="NAME", help="what it learned from, as pid-v0 or NAME=SHA256"
    )
    parser.add_argument("--budget", help="what the training took")
    parser.add_argument("--code", metavar="URL", help="where the code is")
    parser.add_argument(
        "--seeds", nargs="+", type=int, default=[0], metavar="SEED", help="of the evaluation (default: 0)"
    )
    parser.add_argument("--supersedes", metavar="ENTRY", help="the entry that this one corrects")
    parser.add_argument("--reason", help="what was wrong with that")
    _root_option(parser, "--output")
    _flight_options(parser)


def _root_option(parser: argparse.ArgumentParser, name: str) -> None:
    parser.add_argument(
        name,
        dest="root",
        type=Path,
        default=Path("leaderboards"),
        metavar="FOLDER",
        help="folder of all entries (default: leaderboards)",
    )


def _limits(options: argparse.Namespace) -> Limits:
    if options.threads is not None and options.threads < 1:
        raise ValueError(f"--threads must be at least 1, got {options.threads}")
    if not 0.0 < options.time_limit_s < threading.TIMEOUT_MAX:
        raise ValueError(f"--time-limit-s must be positive, got {options.time_limit_s:g}")
    return dataclasses.replace(Limits(), wall_s=options.time_limit_s)


def _submit(options: argparse.Namespace) -> int:
    if (options.supersedes is None) != (options.reason is None):
        raise ValueError("--supersedes and --reason go together")
    about = About(
        options.author,
        options.method,
        options.entry,
        tuple(training_data(text) for text in options.training_data),
        options.budget,
        options.code,
        Erratum(options.supersedes, options.reason) if options.supersedes is not None else None,
    )
    with progress_line(options.protocol, "flights", shown=not options.json) as progress:
        folder = submit(
            options.root,
            options.policy,
            options.protocol,
            about,
            seeds=options.seeds,
            threads=options.threads,
            limits=_limits(options),
            progress=progress,
        )
    success = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["success"]
    if options.json:
        print(json.dumps({"folder": str(folder), "success": success}, indent=2))
    else:
        print(f"{folder}: {_rate(success)}")
    return 0


def _rate(success: dict[str, float]) -> str:
    return (
        f"{success['count']:,} of {success['episodes']:,} goals, {100 * success['rate']:.1f} % "
        f"({100 * success['low']:.1f} to {100 * success['high']:.1f})"
    )


def _verify_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "entries", nargs="*", type=Path, metavar="ENTRY", help="folders, as leaderboards/hard-1k-v0/pid"
    )
    parser.add_argument("--all", action="store_true", help="all entries of the folder")
    parser.add_argument(
        "--announced-seed", type=int, metavar="N", help="fly goals too that nobody knew before N was announced"
    )
    _root_option(parser, "--leaderboards")
    _flight_options(parser)


def _verify(options: argparse.Namespace) -> int:
    if bool(options.entries) == options.all:
        raise ValueError("name entries to verify, or --all")
    verdicts = []
    for folder in list_entries(options.root) if options.all else options.entries:
        with progress_line(folder.name, "flights", shown=not options.json) as progress:
            verdict = verify_entry(
                folder,
                announced_seed=options.announced_seed,
                threads=options.threads,
                limits=_limits(options),
                progress=progress,
            )
        verdicts.append(verdict)
        if not options.json:
            print("\n".join(_lines(verdict)), flush=True)
    if options.json:
        print(json.dumps([{"accepted": each.accepted, **dataclasses.asdict(each)} for each in verdicts], indent=2))
    return 0 if all(verdict.accepted for verdict in verdicts) else REFUSED


def _lines(verdict: Verdict) -> list[str]:
    how = "every number the same" if verdict.exact else "within the tolerance between machines"
    result = f"accepted, {how}, {verdict.seconds:.1f} s" if verdict.accepted else "REFUSED"
    figures = [f"  {what.replace('_', '-')}: {_rate(dict(success))}" for what, success in verdict.figures.items()]
    return [
        f"{verdict.name}: {result}",
        *(f"  {problem}" for problem in verdict.problems),
        *figures,
        *(f"  note: {note}" for note in verdict.notes),
    ]


def _render_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--check", action="store_true", help="write nothing; say whether the pages are current")
    _root_option(parser, "--leaderboards")


def _render(options: argparse.Namespace) -> int:
    changed = [str(path) for path in render(options.root, check=options.check)]
    if options.json:
        print(json.dumps({"changed": changed}, indent=2))
    elif options.check and changed:
        print(f"not current: {', '.join(changed)}; run vvc-bench leaderboard render")
    else:
        print("\n".join(changed) or "all pages are current")
    return REFUSED if options.check and changed else 0


_COMMANDS = {
    "submit": ("evaluate a policy and make an entry of it", _submit_options, _submit),
    "verify": ("fly entries again and compare every number", _verify_options, _verify),
    "render": ("write the tables and pages", _render_options, _render),
}
