"""Verify entries: read them strictly, fly their policies again, compare every number."""

import contextlib
import importlib.util
import platform as system
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pandas as pd

from vvc_bench.evaluation import Evaluation, Protocol, named_protocol, read_evaluation
from vvc_bench.leaderboard import sandbox
from vvc_bench.leaderboard.claims import differences, same_flights, unfounded
from vvc_bench.leaderboard.confinement import Limits
from vvc_bench.leaderboard.entries import Entry, list_entries, read_entry
from vvc_bench.leaderboard.submission import BuiltInPolicy, Submission
from vvc_bench.version import __version__

_PACKAGES = ("numba", "numpy", "onnxruntime")
_CPU = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Verdict:
    """What became of an entry.

    Args:
        name: ``protocol/entry``, or the folder where that could not be told.
        problems: why it is refused; none if it is accepted.
        notes: what else is to be known.
        figures: ``claimed``, ``flown`` and ``held_out``: successes, flights, rate and its 95 % interval.
        exact: whether every number had to be the same.
        seconds: how long it took.
    """

    name: str
    problems: tuple[str, ...]
    notes: tuple[str, ...] = ()
    figures: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    exact: bool = False
    seconds: float = 0.0

    @property
    def accepted(self) -> bool:
        """Whether nothing is wrong with it."""
        return not self.problems


@cache
def this_platform() -> dict[str, str]:
    """What results may depend on in their last digits."""
    return {
        "vvc_bench": __version__,
        "system": system.system(),
        "machine": system.machine(),
        "processor": _processor(),
        "python": system.python_version(),
    } | {name: _installed(name) for name in _PACKAGES}


def _processor() -> str:
    if _CPU.exists():
        for line in _CPU.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return system.processor() or "unknown"


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def verify_entry(
    folder: Path,
    *,
    announced_seed: int | None = None,
    threads: int | None = None,
    limits: Limits = Limits(),  # noqa: B008  (immutable)
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> Verdict:
    """Read an entry, fly its policy again in a confined process, and compare.

    Args:
        folder: ``…/<protocol>/<entry>``; the entries around it are looked through for the same policy.
        announced_seed: fly goals too that are drawn from this seed and the submission's hash.
        threads: at most so many.
        limits: what the confined process gets.
        progress: told how many flights are done, and of how many.

    Raises:
        FileNotFoundError: if there is no such folder.
        ImportError: without onnx or onnxruntime; says what to install.
    """
    if not folder.exists():
        raise FileNotFoundError(f"there is no entry {folder}")
    require_packages()
    begun = time.monotonic()
    name = "/".join(folder.resolve().parts[-2:])
    try:
        entry = read_entry(folder)
        protocol = _protocol(entry)
        claimed = _claimed(entry)
        problems = _without_flying(entry, protocol, claimed)
        if problems:
            return Verdict(name, tuple(problems), seconds=time.monotonic() - begun)
        flown = _fly(entry, announced_seed, threads, limits, progress)
    except (ValueError, RecursionError) as error:
        return Verdict(name, (str(error),), seconds=time.monotonic() - begun)
    exact = dict(entry.submission.platform) == this_platform()
    problems = differences(claimed, flown.evaluation, exact=exact)
    figures = {"claimed": entry.summary["success"], "flown": flown.evaluation.summary["success"]}
    if flown.held_out is not None:
        figures["held_out"] = flown.held_out.summary["success"]
    notes = [*_not_confined(flown.confined), *_overfitted(figures)]
    return Verdict(name, tuple(problems), tuple(notes), figures, exact, time.monotonic() - begun)


def require_packages() -> None:
    """Find out before anything flies whether models can be looked through and flown.

    Raises:
        ImportError: if they cannot; says what to install.
    """
    missing = [name for name in ("onnx", "onnxruntime") if importlib.util.find_spec(name) is None]
    if missing:
        raise ImportError(f"the leaderboard takes {missing[0]}, which is missing: pip install vvc-bench[leaderboard]")


def _protocol(entry: Entry) -> Protocol:
    """The protocol that an entry names, if it is still what it was."""
    protocol = named_protocol(entry.submission.protocol)
    if entry.submission.protocol_sha256 != protocol.hash:
        raise ValueError(
            f"the entry was made for {protocol.name} with hash {entry.submission.protocol_sha256}; here it has "
            f"{protocol.hash}"
        )
    return protocol


def _claimed(entry: Entry) -> Evaluation:
    """What an entry claims, read by a confined process first: this one would be killed where it takes all memory."""
    sandbox.try_to_read(entry.episodes)
    return read_evaluation(entry.folder)


def _without_flying(entry: Entry, protocol: Protocol, claimed: Evaluation) -> list[str]:
    """What is wrong with an entry, as far as can be told at once."""
    submission = entry.submission
    others = [other for other in readable_entries(entry.folder.resolve().parents[1]) if other.name != entry.name]
    check_erratum(submission, others)
    problems = unfounded(claimed, protocol, submission.policy.describe(), submission.seeds)
    copied = "" if problems else duplicate(submission, _earlier(submission, others), claimed.episodes)
    return [copied] if copied else problems


def _fly(
    entry: Entry,
    announced_seed: int | None,
    threads: int | None,
    limits: Limits,
    progress: Callable[[int, int], object],
) -> sandbox.Flown:
    policy = entry.submission.policy
    return sandbox.fly(
        entry.submission.protocol,
        policy.name if isinstance(policy, BuiltInPolicy) else entry.model or b"",
        entry.submission.seeds,
        announced=None if announced_seed is None else sandbox.Announced(entry.sha256, announced_seed),
        threads=threads,
        limits=limits,
        progress=progress,
    )


def readable_entries(root: Path) -> list[Entry]:
    """All entries that can be read; the others are refused when they are verified."""
    found = []
    for folder in list_entries(root):
        with contextlib.suppress(ValueError):
            found.append(read_entry(folder))
    return found


def duplicate(submission: Submission, others: Sequence[Entry], episodes: pd.DataFrame | None = None) -> str:
    """Which of other entries this one is under another name; empty if none.

    The same model is found on all protocols, the same flights on this one. An entry may repeat those that it corrects.

    Args:
        submission: what the entry says.
        others: entries that came before it.
        episodes: its flights; without them only the policies are compared.
    """
    corrected = _corrected(submission, others)
    for other in sorted(others, key=lambda entry: _age(entry.submission)):
        known = other.submission
        if known.entry == submission.entry or known.entry in corrected:
            continue
        what = ""
        if known.policy == submission.policy:
            what = "the policy is that"
        elif episodes is not None and known.protocol == submission.protocol and _flies_as(other, episodes):
            what = "the flights are those"
        if what:
            return f"{what} of entry {other.name}, submitted {known.submitted} by {known.author}"
    return ""


def _flies_as(other: Entry, episodes: pd.DataFrame) -> bool:
    try:
        return same_flights(episodes, _claimed(other).episodes)
    except ValueError:  # refused when it is verified
        return False


def _age(submission: Submission) -> tuple[str, str]:
    return submission.submitted, submission.entry


def _earlier(submission: Submission, others: Iterable[Entry]) -> list[Entry]:
    return [other for other in others if _age(other.submission) < _age(submission)]


def _corrected(submission: Submission, others: Iterable[Entry]) -> set[str]:
    """The entries of its protocol that this one corrects, one through the other."""
    known = {
        each.submission.entry: each.submission for each in others if each.submission.protocol == submission.protocol
    }
    corrected: set[str] = set()
    one: Submission | None = submission
    while one is not None and one.supersedes is not None and one.supersedes.entry not in corrected:
        corrected.add(one.supersedes.entry)
        one = known.get(one.supersedes.entry)
    return corrected


def check_erratum(submission: Submission, others: Iterable[Entry]) -> None:
    """Refuse to correct an entry that is not there, or is younger.

    Raises:
        ValueError: if so.
    """
    if submission.supersedes is None:
        return
    known = {
        each.submission.entry: each.submission for each in others if each.submission.protocol == submission.protocol
    }
    corrected = known.get(submission.supersedes.entry)
    if corrected is None:
        raise ValueError(f"it supersedes {submission.supersedes.entry!r}, which is no entry of {submission.protocol}")
    if _age(corrected) > _age(submission):
        raise ValueError(f"it supersedes {corrected.entry!r}, which was submitted later")


def _not_confined(confined: Mapping[str, bool]) -> list[str]:
    open_doors = [what for what, closed in confined.items() if not closed]
    return [f"this system could not take away the process's {' and '.join(open_doors)}"] if open_doors else []


def _overfitted(figures: Mapping[str, Mapping[str, float]]) -> list[str]:
    held_out, flown = figures.get("held_out"), figures["flown"]
    if held_out is None or held_out["high"] >= flown["low"]:
        return []
    return ["the goals that nobody knew are reached less often, beyond both intervals: look into it"]
