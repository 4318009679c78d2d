"""A whole dataset from a mirror: a place with a folder for each, as they lie on a disk."""

import shutil
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from vvc_bench.datasets.download import (
    BrokenPromiseError,
    Promise,
    check_space,
    download,
    part_of,
    read_small,
    sha256_of,
    sync,
    without_secrets,
)
from vvc_bench.datasets.local import LARGEST_MANIFEST, promised_files
from vvc_bench.datasets.manifest import MANIFEST
from vvc_bench.datasets.progress import progress_line


def fetch_dataset(mirror: str, name: str, folder: Path, *, progress: bool = True) -> None:
    """Fetch a dataset into a folder that is not there yet, from where an earlier attempt stopped if there was one.

    Args:
        mirror: a URL that `vvc_bench.datasets.download` takes, or a folder.
        name: of the dataset.
        folder: where to; it appears when all of it is there.
        progress: whether a line is drawn, if stderr is a terminal.

    Raises:
        FileNotFoundError: if the mirror does not have it.
        CorruptDataset: if its manifest is none.
        OSError: if it cannot be had, or does not fit on the disk; what has come is kept.
    """
    address = _address(mirror, name, MANIFEST)
    manifest = read_small(address, LARGEST_MANIFEST)
    promises = promised_files(manifest, name, Path(without_secrets(address)))
    arriving = folder.with_name(f".{name}.arriving")
    arriving.mkdir(parents=True, exist_ok=True)
    _clear(arriving, promises)
    missing = {file: promise for file, promise in promises.items() if not _is_there(arriving / file, promise)}
    check_space(arriving, sum(promise.bytes - _arrived(arriving / file, promise) for file, promise in missing.items()))
    total, done = sum(promise.bytes for promise in missing.values()), 0
    with progress_line(f"fetching {name}", "B", shown=progress) as show:

        def advance(count: int) -> None:
            nonlocal done
            done += count
            show(done, total)

        for file, promise in missing.items():
            try:
                download(_address(mirror, name, file), arriving / file, promise, progress=advance)
            except FileNotFoundError as fault:
                raise BrokenPromiseError(f"{MANIFEST} promises {file}, but it is not there: {fault}") from fault
    (arriving / MANIFEST).write_bytes(manifest)
    sync(arriving / MANIFEST)
    arriving.rename(folder)


def is_local(mirror: str) -> bool:
    """Whether a mirror needs no network."""
    return urlsplit(_as_url(mirror)).scheme == "file"


def _address(mirror: str, name: str, file: str) -> str:
    """The URL of a file; a query, such as the region of an object store, stays at the end."""
    parts = urlsplit(_as_url(mirror))
    return urlunsplit(parts._replace(path=f"{parts.path.rstrip('/')}/{name}/{file}"))


def _as_url(mirror: str) -> str:
    return mirror if "://" in mirror else Path(mirror).expanduser().absolute().as_uri()


def _clear(arriving: Path, promises: dict[str, Promise]) -> None:
    """Remove what an attempt at another version has left."""
    parts = [part_of(arriving / file, promise).stem for file, promise in promises.items()]
    for path in arriving.iterdir():
        if path.name in promises or path.stem in parts:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _is_there(path: Path, promise: Promise) -> bool:
    return path.is_file() and path.stat().st_size == promise.bytes and sha256_of(path) == promise.sha256


def _arrived(path: Path, promise: Promise) -> int:
    part = part_of(path, promise)
    return min(part.stat().st_size, promise.bytes) if part.exists() else 0
