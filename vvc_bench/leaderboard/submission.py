"""What an entry says about itself: ``submission.json``, read strictly.

An entry is a folder ``<protocol>/<entry>/`` with this document, the policy's file if it has one, and the evaluation
that is claimed: ``summary.json`` and ``episodes.parquet``. The document holds the SHA-256 of each of them.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

from vvc_bench.policies.built_in import BUILT_IN

FORMAT, FORMAT_VERSION = "vvc-bench-submission", 1
SUBMISSION, POLICY, SUMMARY, EPISODES = "submission.json", "policy.onnx", "summary.json", "episodes.parquet"
CLAIMED = (SUMMARY, EPISODES)
"""The files of the evaluation that is claimed."""

LARGEST_DOCUMENT = 10**6  # bytes of submission.json or summary.json
MOST_SEEDS = 100
TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"

_ENTRY = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_URL = re.compile(r"https?://[A-Za-z0-9._~:/?#@!$&*+,;=%-]{1,500}")

Check: TypeAlias = Callable[[object, str], Any]
"""From a value and what to call it to the value, or a ValueError."""


@dataclass(frozen=True)
class OnnxPolicy:
    """A policy that lies in the entry's folder as ``policy.onnx``."""

    sha256: str
    bytes: int
    kind: str = "onnx"

    def describe(self) -> dict[str, str | None]:
        """As its agent does."""
        return {"kind": self.kind, "name": Path(POLICY).stem, "sha256": self.sha256}


@dataclass(frozen=True)
class BuiltInPolicy:
    """A policy of the package, one of `BUILT_IN`."""

    name: str
    kind: str = "built-in"

    def describe(self) -> dict[str, str | None]:
        """As its agent does."""
        return {"kind": self.kind, "name": self.name, "sha256": None}


@dataclass(frozen=True)
class TrainingData:
    """A set that was learned from, and its hash where it is known."""

    name: str
    sha256: str | None


@dataclass(frozen=True)
class Erratum:
    """Which entry a new one takes the place of, and why."""

    entry: str
    reason: str


@dataclass(frozen=True)
class Submission:
    """One entry.

    Args:
        entry: small letters, digits, dots, dashes and underscores; the name of its folder.
        protocol: name of what it was evaluated by; the name of the folder above.
        protocol_sha256: the protocol's hash.
        author: who submits.
        method: what it is, in a sentence.
        training_data: the sets that it learned from.
        budget: what training took, in the author's words.
        code: URL of the code that made it.
        policy: what flies.
        seeds: the seeds that it was evaluated with.
        files: name → SHA-256 of the evaluation's files.
        submitted: UTC.
        supersedes: the entry that this one corrects.
        platform: what it was evaluated on.
    """

    entry: str
    protocol: str
    protocol_sha256: str
    author: str
    method: str
    training_data: tuple[TrainingData, ...]
    budget: str | None
    code: str | None
    policy: OnnxPolicy | BuiltInPolicy
    seeds: tuple[int, ...]
    files: Mapping[str, str]
    submitted: str
    supersedes: Erratum | None
    platform: Mapping[str, str]

    def to_bytes(self) -> bytes:
        """The document."""
        document = {"format": FORMAT, "format_version": FORMAT_VERSION} | asdict(self)
        return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def parse_submission(content: bytes, place: Path) -> Submission:
    """A submission, if the document is one to the letter.

    Args:
        content: the bytes of ``submission.json``.
        place: where they are from, for messages.

    Raises:
        ValueError: for a missing or unknown entry, a value that is impossible, or a file not as `submit` writes it.
    """
    if len(content) > LARGEST_DOCUMENT:
        raise ValueError(f"{place} has {len(content)} bytes; at most {LARGEST_DOCUMENT} are taken")
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        raise ValueError(f"{place} is no JSON document") from None
    try:
        checked = _object(_DOCUMENT)(document, "submission")
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from None
    del checked["format"], checked["format_version"]
    submission = Submission(**checked)
    if submission.to_bytes() != content:
        raise ValueError(f"{place} is not as vvc-bench leaderboard submit writes it (order, spaces or repeated names)")
    return submission


def checked_entry(name: str) -> str:
    """An entry's name, if it can be one.

    Raises:
        ValueError: if it cannot, such as one that would lead out of its folder.
    """
    return str(_entry(name, "entry"))


def checked_line(text: str, what: str) -> str:
    """A line that an author wrote, if it can be shown.

    Raises:
        ValueError: if it is empty, too long, or holds characters that cannot be seen.
    """
    return str(_line(500)(text, what))


def sha256(content: bytes) -> str:
    """Of bytes, as 64 digits."""
    return hashlib.sha256(content).hexdigest()


# Checks


def _object(known: Mapping[str, Check]) -> Check:
    def check(value: object, what: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise ValueError(f"{what} must be an object, got {value!r}")
        missing, unknown = sorted(known.keys() - value.keys()), sorted(value.keys() - known.keys())
        if missing:
            raise ValueError(f"{what} lacks {missing[0]!r}")
        if unknown:
            raise ValueError(f"{what} has an unknown entry {unknown[0]!r}; known are {', '.join(known)}")
        return {name: each(value[name], name) for name, each in known.items()}

    return check


def _of(kind: Callable[..., Any], known: Mapping[str, Check]) -> Check:
    return lambda value, what: kind(**_object(known)(value, what))


def _either(expected: object) -> Check:
    def check(value: object, what: str) -> object:
        if type(value) is not type(expected) or value != expected:
            raise ValueError(f"{what} must be {expected!r}, got {value!r}")
        return value

    return check


def _optional(known: Check) -> Check:
    return lambda value, what: None if value is None else known(value, what)


def _list(known: Check, least: int, most: int) -> Check:
    def check(value: object, what: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(f"{what} must be a list of {least} to {most}, got {value!r}")
        return tuple(known(each, what) for each in value)

    return check


def _pattern(pattern: re.Pattern[str], meaning: str) -> Check:
    def check(value: object, what: str) -> str:
        if not isinstance(value, str) or not pattern.fullmatch(value) or ".." in value:
            raise ValueError(f"{what} must be {meaning}, got {value!r}")
        return value

    return check


def _line(longest: int) -> Check:
    def check(value: object, what: str) -> str:
        if not isinstance(value, str) or not 0 < len(value.strip()) <= len(value) <= longest:
            raise ValueError(f"{what} must be a text of 1 to {longest} characters, got {value!r}")
        if not value.isprintable():
            raise ValueError(f"{what} must be one line of characters that can be seen, got {value!r}")
        return value

    return check


def _whole_number(least: int, most: int) -> Check:
    def check(value: object, what: str) -> int:
        if type(value) is not int or not least <= value <= most:
            raise ValueError(f"{what} must be a whole number from {least} to {most}, got {value!r}")
        return value

    return check


def _time(value: object, what: str) -> str:
    try:
        if isinstance(value, str) and datetime.strptime(value, TIME_FORMAT).strftime(TIME_FORMAT) == value:
            return value
    except ValueError:
        pass
    raise ValueError(f"{what} must be a time as 2026-01-31T12:00:00Z, got {value!r}")


def _seeds(value: object, what: str) -> tuple[int, ...]:
    seeds: tuple[int, ...] = _list(_whole_number(0, 2**63 - 1), 1, MOST_SEEDS)(value, what)
    if len(set(seeds)) != len(seeds):
        raise ValueError(f"{what} must be different ones, got {list(seeds)}")
    return seeds


def _policy(value: object, what: str) -> OnnxPolicy | BuiltInPolicy:
    kind = value.get("kind") if isinstance(value, dict) else None
    if kind == "onnx":
        known: dict[str, Check] = {"sha256": _hash, "bytes": _whole_number(1, 2**40), "kind": _either("onnx")}
        return OnnxPolicy(**_object(known)(value, what))
    if kind == "built-in":
        names = _pattern(re.compile("|".join(map(re.escape, BUILT_IN))), f"one of {', '.join(BUILT_IN)}")
        return BuiltInPolicy(**_object({"name": names, "kind": _either("built-in")})(value, what))
    raise ValueError(f"{what} must be of kind 'onnx' or 'built-in', got {kind!r}: what executes code is not taken")


def _names(known: Check, least: int, most: int) -> Check:
    def check(value: object, what: str) -> dict[str, Any]:
        if not isinstance(value, dict) or not least <= len(value) <= most:
            raise ValueError(f"{what} must be an object of {least} to {most} entries, got {value!r}")
        return {str(_line(64)(name, what)): known(each, f"{what} {name}") for name, each in value.items()}

    return check


_entry = _pattern(_ENTRY, "a name of small letters, digits, '.', '_' and '-', at most 64 of them")
_hash = _pattern(_SHA256, "a SHA-256 of 64 small hexadecimal digits")
_url = _pattern(_URL, "a URL that begins with http:// or https://")

_DOCUMENT: dict[str, Check] = {
    "format": _either(FORMAT),
    "format_version": _either(FORMAT_VERSION),
    "entry": _entry,
    "protocol": _entry,
    "protocol_sha256": _hash,
    "author": _line(100),
    "method": _line(500),
    "training_data": _list(_of(TrainingData, {"name": _line(100), "sha256": _optional(_hash)}), 0, 20),
    "budget": _optional(_line(200)),
    "code": _optional(_url),
    "policy": _policy,
    "seeds": _seeds,
    "files": _object(dict.fromkeys(CLAIMED, _hash)),
    "submitted": _time,
    "supersedes": _optional(_of(Erratum, {"entry": _entry, "reason": _line(500)})),
    "platform": _names(_line(200), 1, 20),
}
