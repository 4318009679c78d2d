"""One file from elsewhere: whole and as promised, or not at all.

What has arrived is kept in a file beside the place where it belongs, so that the next attempt, in this process or after
a crash, goes on from there. The file appears under its name once its length and its SHA-256 are those that were
promised. Files come through ``http(s)://`` (the standard library), and through ``file://``, ``s3://`` and the like
(pyarrow's file systems).
"""

import errno
import hashlib
import http.client
import os
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from io import BufferedIOBase
from pathlib import Path
from typing import IO, NamedTuple
from urllib.parse import urlsplit, urlunsplit

from vvc_bench.datasets.progress import short_number
from vvc_bench.version import __version__

ATTEMPTS = 5
"""How often in a row a transfer may fail without having brought anything."""

TIMEOUT = 30.0  # s without a byte
FIRST_PAUSE = 0.5  # s before the second attempt; doubled for each further one
LONGEST_PAUSE = 20.0

_CHUNK = 1 << 20
_WEB = ("http", "https")
_PASSING = {408, 425, 429}  # HTTP statuses that ask to come again, besides all from 500 on
_MISSING = {404, 410}
_NOT_ALLOWED = {401, 403}
_DISK_IS_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


class Promise(NamedTuple):
    """What a file is to be."""

    bytes: int
    sha256: str


class BrokenPromiseError(OSError):
    """What arrived is not what was promised."""


class _PassingError(Exception):
    """A transfer that may succeed when tried again."""


class _Transfer(NamedTuple):
    """An open transfer."""

    stream: BufferedIOBase
    start: int
    """Of the file's bytes, the first one that comes."""
    length: int | None
    """How many bytes are to come, where that is known."""
    version: str
    """The server's name for this version of the file (a strong ETag); empty if it gives none."""


def no_progress(_count: int) -> None:
    """Tell nobody."""


def download(
    url: str,
    path: Path,
    promise: Promise,
    *,
    progress: Callable[[int], object] = no_progress,
) -> None:
    """Fetch a file, from where an earlier attempt stopped if there was one.

    Args:
        url: ``http(s)://``, ``file://``, ``s3://`` or what else pyarrow knows.
        path: where to; the folder is there.
        promise: its length and checksum.
        progress: told how many bytes have come since it was last told; fewer than none if they must come again.

    Raises:
        FileNotFoundError: if there is no such file.
        PermissionError: if the server does not let us have it.
        BrokenPromiseError: if another file than promised comes, twice.
        OSError: if it cannot be had for another reason, the disk being full among them; what has come is kept.
    """
    part = part_of(path, promise)
    found = _complete(url, part, promise, progress)
    if found != promise.sha256:  # perhaps what was left of another version: once more from the beginning
        _discard(part)
        progress(-promise.bytes)
        found = _complete(url, part, promise, progress)
    if found != promise.sha256:
        _discard(part)
        raise BrokenPromiseError(
            f"{without_secrets(url)} has SHA-256 {found}, but {promise.sha256} was promised; "
            "the file there is damaged or has changed: tell whoever keeps it, or choose another source"
        )
    sync(part)
    part.replace(path)
    _discard(part)


def part_of(path: Path, promise: Promise) -> Path:
    """Where an unfinished download of a file is kept."""
    return path.with_name(f"{path.name}.{promise.sha256[:16]}.part")


def read_small(url: str, limit: int) -> bytes:
    """A small file's content.

    Args:
        url: as in `download`.
        limit: the most bytes that are taken.

    Raises:
        OSError: as `download` does, and if it is longer.
    """
    failures = 0
    while True:
        try:
            return _read_all(url, limit)
        except _PassingError as fault:
            failures += 1
            _pause_or_give_up(url, failures, fault)


def _read_all(url: str, limit: int) -> bytes:
    with _open(url, 0, "") as transfer:
        with _passing_faults():
            content = transfer.stream.read(limit + 1)
        if len(content) > limit:
            raise BrokenPromiseError(
                f"{without_secrets(url)} is longer than the {limit} bytes that such a file may have"
            )
        if transfer.length not in (None, len(content)):
            raise _PassingError(f"it ended after {len(content)} of {transfer.length} bytes")
        return content


def stated(url: str) -> tuple[int | None, str]:
    """What the server says of a file: its length, and its ETag if that is a strong one, with its quotation marks.

    Raises:
        OSError: if it does not answer.
    """
    try:
        with _open(url, 0, "") as transfer:
            return transfer.length, transfer.version
    except _PassingError as fault:
        raise OSError(f"{without_secrets(url)}: {fault}") from fault


def check_space(folder: Path, needed: int) -> None:
    """Refuse to begin what the disk has no room for.

    Raises:
        OSError: says how much is needed and how much there is.
    """
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"{short_number(needed)}B are needed in {folder}, {short_number(free)}B are free; "
            "make room, or set VVC_BENCH_HOME to a folder on another disk",
        )


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sync(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def without_secrets(url: str) -> str:
    """A URL as it may be printed: without user, password and query."""
    parts = urlsplit(url)
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))


def _complete(url: str, part: Path, promise: Promise, progress: Callable[[int], object]) -> str:
    """Append to ``part`` until it has the promised length; returns its SHA-256."""
    if part.exists() and part.stat().st_size > promise.bytes:
        part.unlink()
    have = part.stat().st_size if part.exists() else 0
    progress(have)
    failures = 0
    while have < promise.bytes or not part.exists():
        before = have
        try:
            have = _append(url, part, have, promise, progress)
        except _PassingError as fault:
            have = part.stat().st_size if part.exists() else 0
            failures = 0 if have > before else failures + 1
            _pause_or_give_up(url, failures, fault)
    return sha256_of(part)


def _append(url: str, part: Path, have: int, promise: Promise, progress: Callable[[int], object]) -> int:
    """One transfer; returns how many bytes ``part`` has then."""
    known = _version_file(part).read_text(encoding="utf-8") if _version_file(part).exists() else ""
    with _open(url, have, known) as transfer:
        if transfer.start != have:
            progress(transfer.start - have)
            have = transfer.start
        with _room(part):
            _version_file(part).write_text(transfer.version, encoding="utf-8")
        with part.open("ab") as file:
            file.truncate(have)
            for chunk in _chunks(transfer.stream):
                if have + len(chunk) > promise.bytes:
                    raise BrokenPromiseError(
                        f"{without_secrets(url)} sends more than the {promise.bytes} bytes that were promised"
                    )
                with _room(part):
                    file.write(chunk)
                    file.flush()
                have += len(chunk)
                progress(len(chunk))
    if have < promise.bytes:
        raise _PassingError(f"it ended after {have} of {promise.bytes} bytes")
    return have


def _discard(part: Path) -> None:
    part.unlink(missing_ok=True)
    _version_file(part).unlink(missing_ok=True)


def _version_file(part: Path) -> Path:
    return part.with_suffix(".version")


def _chunks(stream: BufferedIOBase) -> Iterator[bytes]:
    while True:
        with _passing_faults():
            chunk = stream.read1(_CHUNK)
        if not chunk:
            return
        yield chunk


def _pause_or_give_up(url: str, failures: int, fault: Exception) -> None:
    if failures == ATTEMPTS:
        raise OSError(f"{without_secrets(url)} could not be fetched in {ATTEMPTS} attempts: {fault}") from fault
    time.sleep(min(FIRST_PAUSE * 2.0 ** max(failures - 1, 0), LONGEST_PAUSE))


@contextmanager
def _passing_faults() -> Iterator[None]:
    """Faults of the network as something to try again."""
    try:
        yield
    except (http.client.HTTPException, TimeoutError, ConnectionError) as fault:
        raise _PassingError(str(fault) or type(fault).__name__) from fault


@contextmanager
def _room(part: Path) -> Iterator[None]:
    """A full disk, in words."""
    try:
        yield
    except OSError as fault:
        if fault.errno not in _DISK_IS_FULL:
            raise
        raise OSError(
            fault.errno,
            f"no room left in {part.parent}: {fault.strerror}; what has come so far is kept: "
            "make room and load the set again, or set VVC_BENCH_HOME to a folder on another disk",
        ) from fault


def _open(url: str, start: int, version: str) -> AbstractContextManager[_Transfer]:
    scheme = urlsplit(url).scheme
    return _open_web(url, start, version) if scheme in _WEB else _open_filesystem(url, start)


class _OnlyToEquallySafe(urllib.request.HTTPRedirectHandler):
    """Follow redirects, but not from https to anything less."""

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: http.client.HTTPMessage,
        newurl: str,
    ) -> urllib.request.Request | None:
        allowed = ("https",) if req.type == "https" else _WEB
        if urlsplit(newurl).scheme not in allowed:
            raise PermissionError(
                f"{without_secrets(req.full_url)} redirects to {without_secrets(newurl)}, which is not {allowed[0]}"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


@contextmanager
def _open_web(url: str, start: int, version: str) -> Iterator[_Transfer]:
    headers = {"User-Agent": f"vvc-bench/{__version__}"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if version:
            headers["If-Range"] = version
    request = urllib.request.Request(url, headers=headers)
    with _answered(request) as response:
        etag = response.headers.get("ETag", "")
        yield _Transfer(response, _first_byte(response), response.length, "" if etag.startswith("W/") else etag)


def _answered(request: urllib.request.Request) -> http.client.HTTPResponse:
    """The answer to a request, if it brings something."""
    try:
        with _passing_faults():
            answer: http.client.HTTPResponse = urllib.request.build_opener(_OnlyToEquallySafe).open(
                request, timeout=TIMEOUT
            )
            return answer
    except urllib.error.HTTPError as fault:
        raise _http_error(request, fault) from fault
    except urllib.error.URLError as fault:
        raise _PassingError(str(fault.reason)) from fault


def _http_error(request: urllib.request.Request, fault: urllib.error.HTTPError) -> Exception:
    fault.close()
    status = f"HTTP {fault.code} {fault.reason}"
    said = f"{without_secrets(request.full_url)}: {status}"
    if fault.code in _MISSING:
        return FileNotFoundError(said)
    if fault.code in _NOT_ALLOWED:
        return PermissionError(said)
    if fault.code >= 500 or fault.code in _PASSING:
        return _PassingError(status)
    if fault.code == http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
        return BrokenPromiseError(f"{said}: the file there is shorter than was promised")
    return OSError(said)


def _first_byte(response: http.client.HTTPResponse) -> int:
    """Which byte of the file comes first: 0 unless the server grants the wanted range."""
    if response.status != http.HTTPStatus.PARTIAL_CONTENT:
        return 0
    given = response.headers.get("Content-Range", "")
    try:
        return int(given.removeprefix("bytes").strip().partition("-")[0])
    except ValueError:
        raise OSError(f"{without_secrets(response.url)} answers with an unreadable Content-Range: {given!r}") from None


@contextmanager
def _open_filesystem(url: str, start: int) -> Iterator[_Transfer]:
    import pyarrow as pa
    from pyarrow import fs

    try:
        filesystem, inside = fs.FileSystem.from_uri(url)
    except pa.ArrowInvalid:  # its message repeats the whole URL
        raise ValueError(
            f"{without_secrets(url)} is no address that can be read; take http(s)://, file://, s3:// or gs://"
        ) from None
    with filesystem.open_input_file(inside) as file:
        file.seek(start)
        yield _Transfer(file, start, file.size() - start, "")
