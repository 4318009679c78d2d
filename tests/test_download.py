"""Downloads against a real server on this machine that cuts, refuses, redirects, changes files and sends wrong ones."""

import hashlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from loopback_server import Server, serving

from vvc_bench.datasets import download as downloading
from vvc_bench.datasets.download import (
    BrokenPromiseError,
    Promise,
    check_space,
    download,
    part_of,
    read_small,
    without_secrets,
)

CONTENT = np.random.default_rng(0).bytes(3_000_000)
PROMISE = Promise(len(CONTENT), hashlib.sha256(CONTENT).hexdigest())


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloading, "FIRST_PAUSE", 0.001)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    (tmp_path / "served").mkdir()
    (tmp_path / "served" / "file").write_bytes(CONTENT)
    with serving(tmp_path / "served") as running:
        yield running


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "file"


def fetch(server: Server, place: Path, promise: Promise = PROMISE) -> list[int]:
    """Download, and what progress was told."""
    told: list[int] = []
    download(f"{server.url}/file", place, promise, progress=told.append)
    return told


def left_behind(place: Path) -> set[str]:
    return {path.name for path in place.parent.iterdir()} - {"served", place.name}


def test_a_file_arrives_whole(server: Server, place: Path) -> None:
    told = fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert sum(told) == len(CONTENT)
    assert left_behind(place) == set()


def test_an_empty_file_arrives_too(server: Server, place: Path) -> None:
    (server.folder / "file").write_bytes(b"")
    fetch(server, place, Promise(0, hashlib.sha256(b"").hexdigest()))
    assert place.read_bytes() == b""


@pytest.mark.parametrize("lengths", [True, False])
def test_cut_transfers_go_on_where_they_stopped(server: Server, place: Path, lengths: bool) -> None:
    server.faults.lengths = lengths
    server.faults.cut_after["/file"] = [1_000_000, 0, 500_000, 1]
    told = fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert sum(told) == len(CONTENT)
    starts = [asked.range for asked in server.asked]
    assert starts == [None, *(f"bytes={n}-" for n in (1_000_000, 1_000_000, 1_500_000, 1_500_001))]
    assert {asked.if_range for asked in server.asked[1:]} == {f'"{hashlib.md5(CONTENT).hexdigest()}"'}


def test_many_cuts_are_survived_as_long_as_each_brings_something(server: Server, place: Path) -> None:
    server.faults.cut_after["/file"] = [100_000] * 20
    fetch(server, place)
    assert place.read_bytes() == CONTENT


def test_without_ranges_it_begins_again(server: Server, place: Path) -> None:
    server.faults.ranges = False
    server.faults.cut_after["/file"] = [1_000_000]
    told = fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert sum(told) == len(CONTENT)
    assert -1_000_000 in told


def test_a_file_that_changes_between_two_attempts_is_not_spliced(server: Server, place: Path) -> None:
    old = np.random.default_rng(1).bytes(len(CONTENT))
    (server.folder / "file").write_bytes(old)
    server.faults.cut_after["/file"] = [1_000_000]
    server.faults.pause = lambda _path, sent: (server.folder / "file").write_bytes(CONTENT) if sent >= 900_000 else None
    fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert [asked.range for asked in server.asked] == [None, "bytes=1000000-"]


def test_a_change_that_the_server_does_not_tell_is_seen_by_the_checksum(server: Server, place: Path) -> None:
    server.faults.etags = False
    part_of(place, PROMISE).write_bytes(b"\0" * 1_000_000)
    told = fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert sum(told) == len(CONTENT)


@pytest.mark.parametrize("status", [500, 503, 429])
def test_a_busy_server_is_asked_again(server: Server, place: Path, status: int) -> None:
    server.faults.statuses["/file"] = [status] * 4
    fetch(server, place)
    assert place.read_bytes() == CONTENT


def test_it_gives_up_after_five_attempts_that_bring_nothing(server: Server, place: Path) -> None:
    server.faults.cut_after["/file"] = [1_000_000]
    server.faults.statuses["/file"] = []
    server.faults.pause = lambda _path, _sent: server.faults.statuses.update({"/file": [500] * 99})
    with pytest.raises(OSError, match=r"127\.0\.0\.1:\d+/file could not be fetched in 5 attempts: HTTP 500"):
        fetch(server, place)
    assert not place.exists()
    assert part_of(place, PROMISE).stat().st_size == 1_000_000
    assert len(server.asked) == 6
    server.faults.statuses.clear()
    server.faults.pause = lambda _path, _sent: None
    fetch(server, place)
    assert server.asked[-1].range == "bytes=1000000-"
    assert place.read_bytes() == CONTENT


def test_nobody_listening_is_an_error(tmp_path: Path, place: Path) -> None:
    with serving(tmp_path) as stopped:
        url = stopped.url
    with pytest.raises(OSError, match=r"could not be fetched in 5 attempts: .*refused"):
        download(f"{url}/file", place, PROMISE)


@pytest.mark.parametrize(
    ("status", "error"), [(404, FileNotFoundError), (410, FileNotFoundError), (403, PermissionError), (400, OSError)]
)
def test_a_refusal_is_not_tried_again(server: Server, place: Path, status: int, error: type[Exception]) -> None:
    server.faults.statuses["/file"] = [status] * 9
    with pytest.raises(error, match=f"HTTP {status}"):
        fetch(server, place)
    assert len(server.asked) == 1


def test_redirects_are_followed(server: Server, place: Path) -> None:
    server.faults.redirects["/file"] = "/elsewhere"
    (server.folder / "elsewhere").write_bytes(CONTENT)
    server.faults.cut_after["/elsewhere"] = [10]
    fetch(server, place)
    assert place.read_bytes() == CONTENT


def test_redirects_lead_nowhere_less_safe(server: Server, place: Path) -> None:
    server.faults.redirects["/file"] = "file:///etc/passwd"
    with pytest.raises(OSError, match="file:///etc/passwd' is not allowed"):
        fetch(server, place)
    server.faults.redirects["/file"] = "ftp://127.0.0.1/file"
    with pytest.raises(PermissionError, match=r"redirects to ftp://127\.0\.0\.1/file, which is not http"):
        fetch(server, place)
    handler = downloading._OnlyToEquallySafe()
    request = downloading.urllib.request.Request("https://example.org/file")
    with pytest.raises(PermissionError, match=r"redirects to http://example\.org/file, which is not https"):
        handler.redirect_request(request, None, 302, "", None, "http://example.org/file")  # type: ignore[arg-type]


def test_another_file_than_promised_is_refused_after_two_tries(server: Server, place: Path) -> None:
    (server.folder / "file").write_bytes(b"\0" * len(CONTENT))
    with pytest.raises(BrokenPromiseError, match=f"has SHA-256 .* but {PROMISE.sha256} was promised"):
        fetch(server, place)
    assert len(server.asked) == 2
    assert not place.exists()
    assert left_behind(place) == set()


def test_more_than_promised_is_not_taken(server: Server, place: Path) -> None:
    with pytest.raises(BrokenPromiseError, match="more than the 1000 bytes"):
        fetch(server, place, PROMISE._replace(bytes=1000))
    assert part_of(place, PROMISE).stat().st_size == 0


def test_less_than_promised_is_said(server: Server, place: Path) -> None:
    server.faults.etags = False
    with pytest.raises(BrokenPromiseError, match=r"416.*shorter than was promised"):
        fetch(server, place, PROMISE._replace(bytes=len(CONTENT) + 1))


def test_small_files_are_read_whole_and_not_beyond_a_limit(server: Server) -> None:
    (server.folder / "small").write_bytes(CONTENT[:5000])
    server.faults.cut_after["/small"] = [100, 0]
    assert read_small(f"{server.url}/small", 5000) == CONTENT[:5000]
    assert len(server.asked) == 3
    with pytest.raises(BrokenPromiseError, match="longer than the 4999 bytes"):
        read_small(f"{server.url}/small", 4999)
    with pytest.raises(FileNotFoundError, match="HTTP 404"):
        read_small(f"{server.url}/none", 10)


def test_a_server_that_falls_silent_is_left(server: Server, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloading, "TIMEOUT", 0.2)
    silences = [0.6]

    def fall_silent(_path: str, sent: int) -> None:
        if sent > 200_000 and silences:
            time.sleep(silences.pop())

    server.faults.pause = fall_silent
    fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert len(server.asked) == 2


DOWNLOAD = textwrap.dedent(
    """
    import sys
    from pathlib import Path
    from vvc_bench.datasets.download import Promise, download
    url, place, size, digest = sys.argv[1:]
    download(url, Path(place), Promise(int(size), digest))
    """
)


def downloader(server: Server, place: Path, *wrapper: str) -> subprocess.Popen[str]:
    command = [*wrapper, sys.executable, "-c", DOWNLOAD, f"{server.url}/file", str(place), *map(str, PROMISE)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def test_a_killed_download_is_resumed(server: Server, place: Path) -> None:
    killed, part = threading.Event(), part_of(place, PROMISE)
    server.faults.pause = lambda _path, sent: killed.wait(0 if sent < 2_000_000 else 20) and None
    process = downloader(server, place)
    while process.poll() is None and not (part.exists() and part.stat().st_size > 1_000_000):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    killed.set()
    assert not place.exists()
    have = part.stat().st_size
    server.faults.pause = lambda _path, _sent: None
    fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert have > 1_000_000
    assert server.asked[-1].range == f"bytes={have}-"


@pytest.mark.skipif(os.name == "nt", reason="limits the size of files as Unix can")
def test_a_full_disk_is_said_and_costs_nothing(server: Server, place: Path) -> None:
    process = downloader(server, place, "bash", "-c", 'ulimit -f 1000; exec "$@"', "bash")  # blocks of 1024 bytes
    _, errors = process.communicate(timeout=20)
    assert process.returncode != 0
    assert "no room left in" in errors
    assert "what has come so far is kept" in errors
    assert not place.exists()
    assert part_of(place, PROMISE).stat().st_size == 1000 * 1024
    fetch(server, place)
    assert place.read_bytes() == CONTENT
    assert server.asked[-1].range == f"bytes={1000 * 1024}-"


def test_too_little_room_is_said_before_anything_is_fetched(tmp_path: Path) -> None:
    check_space(tmp_path, 1000)
    with pytest.raises(OSError, match=r"1e\+03 TB are needed in .*VVC_BENCH_HOME"):
        check_space(tmp_path, 10**15)


def test_files_come_from_folders_too(tmp_path: Path, place: Path) -> None:
    (tmp_path / "source").write_bytes(CONTENT)
    part_of(place, PROMISE).write_bytes(CONTENT[:1_000_000])
    download((tmp_path / "source").as_uri(), place, PROMISE)
    assert place.read_bytes() == CONTENT
    with pytest.raises(FileNotFoundError):
        download((tmp_path / "none").as_uri(), tmp_path / "other", PROMISE)
    with pytest.raises(ValueError, match=r"gopher://example\.org/file is no address that can be read"):
        download("gopher://example.org/file", tmp_path / "other", PROMISE)


def test_secrets_in_urls_are_not_printed() -> None:
    assert without_secrets("s3://key:secret@bucket/a/b?token=1#x") == "s3://bucket/a/b"


def test_files_come_from_object_stores_too(server: Server, place: Path) -> None:
    """Amazon's protocol, spoken by pyarrow: a HEAD, then GETs of ranges."""
    address = server.url.removeprefix("http://")
    url = f"s3://key:secret@{{}}?endpoint_override={address}&scheme=http&region=nowhere"
    (server.folder / "bucket").mkdir()
    (server.folder / "bucket" / "file").write_bytes(CONTENT)
    part_of(place, PROMISE).write_bytes(CONTENT[:1_000_000])
    download(url.format("bucket/file"), place, PROMISE)
    assert place.read_bytes() == CONTENT
    assert int(server.asked[-1].range.removeprefix("bytes=").partition("-")[0]) >= 1_000_000
    with pytest.raises(FileNotFoundError):
        download(url.format("bucket/none"), place, PROMISE)
