"""The entries' folders: read with every check that takes no flight, listed, and added to but never changed."""

import json
import os
import stat
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vvc_bench.leaderboard.submission import (
    CLAIMED,
    EPISODES,
    LARGEST_DOCUMENT,
    POLICY,
    SUBMISSION,
    SUMMARY,
    OnnxPolicy,
    Submission,
    parse_submission,
    sha256,
)
from vvc_bench.policies.onnx import LARGEST_FILE

SITE = "site"
"""Folder beside those of the protocols: the pages."""

LARGEST_EPISODES = 32 * 10**6  # bytes
_LARGEST = {
    SUBMISSION: LARGEST_DOCUMENT,
    SUMMARY: LARGEST_DOCUMENT,
    EPISODES: LARGEST_EPISODES,
    POLICY: LARGEST_FILE,
}


@dataclass(frozen=True)
class Entry:
    """A folder whose files are those that its submission names.

    Args:
        folder: where it is.
        submission: what it says.
        sha256: of ``submission.json``.
        summary: what it claims.
        episodes: the Parquet file of the flights that it claims; nothing but its hash is checked yet.
        model: the policy's file, if it has one.
    """

    folder: Path
    submission: Submission
    sha256: str
    summary: Mapping[str, Any]
    episodes: bytes
    model: bytes | None

    @property
    def name(self) -> str:
        """``protocol/entry``."""
        return f"{self.submission.protocol}/{self.submission.entry}"


def list_entries(root: Path) -> list[Path]:
    """Folders of all entries, by protocol and name.

    Raises:
        FileNotFoundError: if there is no such folder.
    """
    if not root.is_dir():
        raise FileNotFoundError(f"there is no folder {root} with entries")
    protocols = [folder for folder in _folders(root) if folder.name != SITE]
    return [entry for protocol in protocols for entry in _folders(protocol)]


def _folders(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))


def read_entry(folder: Path) -> Entry:
    """An entry, once its document, its files and their hashes agree.

    Raises:
        ValueError: if they do not; says how.
        OSError: if a file cannot be read.
    """
    if folder.is_symlink() or not folder.is_dir():
        raise ValueError(f"{folder} is no folder of an entry")
    content = _read(folder, SUBMISSION)
    submission = parse_submission(content, folder / SUBMISSION)
    _check_place(folder, submission)
    names = {SUBMISSION, *CLAIMED} | ({POLICY} if isinstance(submission.policy, OnnxPolicy) else set())
    found = {path.name for path in folder.iterdir()}
    if found != names:
        odd = min(found ^ names)
        raise ValueError(f"{folder} {'lacks' if odd in names else 'has a file that does not belong there:'} {odd}")
    files = {name: _read(folder, name) for name in sorted(names - {SUBMISSION})}
    promised = dict(submission.files)
    if isinstance(submission.policy, OnnxPolicy):
        promised[POLICY] = submission.policy.sha256
    for name, promise in promised.items():
        if sha256(files[name]) != promise:
            raise ValueError(f"{folder / name} has SHA-256 {sha256(files[name])}; {SUBMISSION} says {promise}")
    summary = _parse_summary(files[SUMMARY], folder / SUMMARY)
    return Entry(folder, submission, sha256(content), summary, files[EPISODES], files.get(POLICY))


def _check_place(folder: Path, submission: Submission) -> None:
    place = folder.resolve()
    if (place.parent.name, place.name) != (submission.protocol, submission.entry):
        raise ValueError(
            f"{folder} holds entry {submission.entry!r} of {submission.protocol!r}; it must lie in "
            f"{submission.protocol}/{submission.entry}"
        )


def _read(folder: Path, name: str) -> bytes:
    """A plain file of an entry, if it is not too large."""
    path = folder / name
    try:
        status = path.lstat()
    except FileNotFoundError:
        raise ValueError(f"{folder} lacks {name}") from None
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"{path} is no plain file: links lead out of the entry")
    if status.st_size > _LARGEST[name]:
        raise ValueError(f"{path} has {status.st_size} bytes; at most {_LARGEST[name]} are taken")
    return path.read_bytes()


def _parse_summary(content: bytes, place: Path) -> dict[str, Any]:
    try:
        summary = json.loads(content)
    except (ValueError, RecursionError):
        raise ValueError(f"{place} is no JSON document") from None
    if not isinstance(summary, dict):
        raise ValueError(f"{place} is no JSON object")
    return summary


def add_entry(root: Path, submission: Submission, files: Mapping[str, bytes]) -> Path:
    """Make an entry's folder in one move; what is there already stays as it is.

    Args:
        root: the folder of all entries.
        submission: what the entry says.
        files: its other files.

    Returns:
        The folder.

    Raises:
        FileExistsError: if there is an entry of that name.
        ValueError: if what was written is no whole entry.
        OSError: if it cannot be written.
    """
    folder = root / submission.protocol / submission.entry
    require_free(folder)
    root.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", suffix=".unfinished", dir=root) as place:
        unfinished = Path(place, submission.protocol, submission.entry)
        unfinished.mkdir(parents=True)
        for name, content in {**files, SUBMISSION: submission.to_bytes()}.items():
            with (unfinished / name).open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        read_entry(unfinished)
        folder.parent.mkdir(exist_ok=True)
        require_free(folder)
        unfinished.rename(folder)
    return folder


def require_free(folder: Path) -> None:
    """Refuse to write where an entry is.

    Raises:
        FileExistsError: if there is one.
    """
    if folder.exists() or folder.is_symlink():
        raise FileExistsError(
            f"there is an entry {folder}; entries are not overwritten: choose another name with --entry, and name the "
            "one that it corrects with --supersedes"
        )
