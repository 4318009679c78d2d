"""The copies of datasets on this machine: where they lie, who may change them, whether they are whole.

Beside each copy lies a note of what was found when it was last read through: the manifest's SHA-256, and size, times
and inode of every file. A copy that still looks so is taken for whole without being read again, so that opening costs
nothing; whatever is then read of it is verified anyway.
"""

import fcntl
import hashlib
import json
import logging
import re
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from vvc_bench.datasets.download import Promise, sha256_of
from vvc_bench.datasets.manifest import MANIFEST, CorruptDataset, damaged, parse_manifest
from vvc_bench.home import home_folder

LARGEST_MANIFEST = 16 * 10**6  # bytes
LARGEST_FILE = 100 * 10**9  # bytes; the paper's largest set has 0.3·10⁹

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")
_UNSETTLED = 1.0  # s after a file's last change in which another change might bear the same time

_log = logging.getLogger(__name__)


class _Note(NamedTuple):
    """What was found when a copy was last read through."""

    manifest: str
    """SHA-256."""
    files: dict[str, list[int]]
    """By name: size, times of change in ns, inode; none where the last change was too recent to tell from another."""


def datasets_folder() -> Path:
    """Where copies lie: one folder for each, by name."""
    return home_folder() / "datasets"


def checked_name(name: str) -> str:
    """A dataset's name, if it can be one.

    Raises:
        ValueError: if it cannot, such as one that would lead out of the folder of datasets.
    """
    if not _NAME.fullmatch(name) or ".." in name:
        raise ValueError(
            f"{name!r} is no name of a dataset: small letters, digits, dots and hyphens, as in pid-v0; "
            f"for a folder, give a path, as in ./{name}"
        )
    return name


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Be the only process that makes or replaces this copy; the system lets go of the lock of a process that dies."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _beside(folder, "lock").open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _log.warning("another process is making %s; waiting for it", folder)
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def check_copy(folder: Path) -> None:
    """Read a copy through, unless it looks as it did when that was last done.

    Raises:
        FileNotFoundError: if there is none.
        CorruptDataset: if it is not what its manifest says.
    """
    if not folder.exists():
        raise FileNotFoundError(f"there is no dataset in {folder}")
    manifest = _read_manifest(folder)
    promises = promised_files(manifest, folder.name, folder / MANIFEST)
    now = _Note(hashlib.sha256(manifest).hexdigest(), _appearance(folder, promises))
    if _read_note(folder) == now:
        return
    check_files(folder, folder.name)
    _write_note(folder, now if _settled(now) else now._replace(files={}))


def check_files(folder: Path, name: str) -> None:
    """Read every file of a dataset and compare it with the manifest.

    Raises:
        CorruptDataset: if one differs.
    """
    for file, promise in promised_files(_read_manifest(folder), name, folder / MANIFEST).items():
        _check_file(folder / file, promise)


def set_aside(folder: Path, fault: CorruptDataset) -> None:
    """Make place for a whole copy; the broken one is kept until the next one breaks."""
    broken = _beside(folder, "broken")
    shutil.rmtree(broken, ignore_errors=True)
    folder.rename(broken)
    _log.warning("%s; doing so now, the damaged copy is kept in %s", fault, broken)


def promised_files(manifest: bytes, name: str, place: Path) -> dict[str, Promise]:
    """What the manifest of a dataset says of its files.

    Args:
        manifest: its bytes.
        name: the dataset's.
        place: where it comes from, for messages.

    Raises:
        CorruptDataset: if it is no manifest, or another set's, or promises more than a dataset can have.
    """
    document = parse_manifest(manifest, place)
    if document["name"] != name:
        raise damaged(place, f"is the manifest of {document['name']!r}, not of {name!r}")
    promises = {file: Promise(stated["bytes"], stated["sha256"]) for file, stated in document["files"].items()}
    for file, promise in promises.items():
        if promise.bytes > LARGEST_FILE:
            raise damaged(place, f"promises {promise.bytes} bytes of {file}, of which at most {LARGEST_FILE} are taken")
    return promises


def _read_manifest(folder: Path) -> bytes:
    try:
        return (folder / MANIFEST).read_bytes()
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as fault:
        raise damaged(folder / MANIFEST, "is missing") from fault


def _check_file(path: Path, promise: Promise) -> None:
    if not path.is_file():
        raise damaged(path, "is missing")
    if path.stat().st_size != promise.bytes:
        raise damaged(path, f"has {path.stat().st_size} bytes and should have {promise.bytes}")
    if sha256_of(path) != promise.sha256:
        raise damaged(path, "differs from its checksum")


def _appearance(folder: Path, files: Mapping[str, Promise]) -> dict[str, list[int]]:
    """What changes when a file does, for those that are there."""
    found = {name: (folder / name).stat() for name in files if (folder / name).is_file()}
    return {name: [each.st_size, each.st_mtime_ns, each.st_ctime_ns, each.st_ino] for name, each in found.items()}


def _settled(note: _Note) -> bool:
    """Whether another change of a file would show."""
    last_change = max((max(times) for _, *times, _ in note.files.values()), default=0)
    return time.time() - last_change * 1e-9 > _UNSETTLED


def _read_note(folder: Path) -> _Note | None:
    try:
        return _Note(**json.loads(_beside(folder, "note").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def _write_note(folder: Path, note: _Note) -> None:
    with suppress(OSError):  # where only others may write
        _beside(folder, "note").write_text(json.dumps(note._asdict()), encoding="utf-8")


def _beside(folder: Path, what: str) -> Path:
    return folder.with_name(f".{folder.name}.{what}")
