"""Folders that appear whole: written beside their place, then moved into it in one step."""

import contextlib
import ctypes
import errno
import fcntl
import glob
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

_HERE = -100  # AT_FDCWD of Linux's fcntl.h
_EXCHANGE = 2  # RENAME_EXCHANGE of Linux's fs.h


@contextlib.contextmanager
def replaced_folder(folder: Path, marker: str) -> Iterator[Path]:
    """Make or replace a folder in one move; the block writes into an empty folder beside it, which is yielded.

    Readers see the old folder or the new one, and so do they after a crash. Of two writers the last one wins. If the
    block fails, what it wrote is removed and the old folder stays. What killed writers left behind is removed first.

    Args:
        folder: its place; parents are made if need be.
        marker: name of a file that tells a folder of this kind: another folder is not replaced.

    Raises:
        FileExistsError: if there is something else in its place.
        OSError: if the disk is full, or the folder cannot be written to.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    _require_replaceable(folder, marker)
    _remove_abandoned(folder)
    unfinished, owned = _claim(folder)
    try:
        yield unfinished
        _flush(unfinished)
        _require_replaceable(folder, marker)
        _put_in_place(unfinished, folder)
        _flush_entry(folder.parent)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)  # what was replaced, or what failed
        os.close(owned)


def _claim(folder: Path) -> tuple[Path, int]:
    """An empty folder beside another, locked by this process, and the lock's descriptor."""
    while True:
        unfinished = _beside(folder, "unfinished")
        unfinished.mkdir()
        with contextlib.suppress(FileNotFoundError):  # removed as abandoned before it was locked
            owned = _lock(unfinished)
            if unfinished.exists():
                return unfinished, owned
            os.close(owned)


def _beside(folder: Path, what: str) -> Path:
    return folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.{what}")


def _require_replaceable(folder: Path, marker: str) -> None:
    while True:
        before = _identity(folder)
        obstacle = _obstacle(folder, marker)
        if obstacle is None:
            return
        if before == _identity(folder):  # else another writer replaced it while it was looked at
            raise FileExistsError(f"{folder} {obstacle}; it is left as it is: choose another place")


def _obstacle(folder: Path, marker: str) -> str | None:
    """Why a folder must not be replaced."""
    if folder.is_symlink():
        return "is no folder"
    try:
        names = {path.name for path in folder.iterdir()}
    except FileNotFoundError:
        return None
    except NotADirectoryError:
        return "is no folder"
    return f"holds other things (no {marker})" if names and marker not in names else None


def _identity(path: Path) -> tuple[int, int] | None:
    """Tells one thing at a path from another that takes its place."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return None
    return status.st_ino, status.st_ctime_ns


def _lock(folder: Path) -> int:
    """An exclusive lock on a folder, which ends with the descriptor or with the process."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold an exclusive lock on a folder for the block; it ends with the process at the latest."""
    descriptor = _lock(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def _remove_abandoned(folder: Path) -> None:
    """Remove unfinished folders that no living process has locked."""
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.????????.unfinished"):
        with contextlib.suppress(OSError):
            descriptor = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(descriptor)


def _flush(folder: Path) -> None:
    """Bring a folder's files to the disk."""
    for path in (*folder.rglob("*"), folder):
        _flush_entry(path)


def _flush_entry(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _put_in_place(new: Path, folder: Path) -> None:
    """``folder`` becomes ``new`` and, if there was one, ``new`` the old one or nothing.

    Where the system cannot swap two folders, there is an instant in which neither is in place.
    """
    while not _swapped(new, folder):
        aside = _beside(folder, "replaced")
        with contextlib.suppress(FileNotFoundError):
            folder.rename(aside)
        try:
            new.rename(folder)
        except OSError as error:
            if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
                shutil.rmtree(aside, ignore_errors=True)  # another writer has put one in place
                continue
            with contextlib.suppress(FileNotFoundError):
                aside.rename(folder)
            raise
        shutil.rmtree(aside, ignore_errors=True)
        return


def _swapped(first: Path, second: Path) -> bool:
    """Swap two folders in one step, if there are two and the system can."""
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    return renameat2 is not None and not renameat2(_HERE, bytes(first), _HERE, bytes(second), _EXCHANGE)
