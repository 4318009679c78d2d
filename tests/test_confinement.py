"""What a confined process cannot do, each beside the same without confinement."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from vvc_bench.leaderboard import confinement

ATTEMPT = f"""
import json, os, runpy, socket, subprocess, sys
from pathlib import Path
confined, action, argument, memory = sys.argv[1:]
could = {{}}
if confined == "confined":
    known = runpy.run_path({confinement.__file__!r})
    limits = known["Limits"](memory_bytes=int(memory), file_bytes=10_000)
    could = known["confine"](limits, known["_pythons_folders"]())
try:
    match action:
        case "read": what = len(Path(argument).read_bytes())
        case "write": what = Path(argument).write_bytes(b"x" * 100_000)
        case "connect": what = bool(socket.create_connection(("127.0.0.1", int(argument)), timeout=5))
        case "datagram": what = socket.socket(type=socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", int(argument)))
        case "start": what = subprocess.run([argument]).returncode
        case "allocate": what = len(bytearray(int(argument)))
except (OSError, MemoryError) as error:
    what = type(error).__name__
print(json.dumps([could, what]))
"""


def attempt(folder: Path, action: str, argument: object, *, confined: bool, memory: int = 10**9) -> object:
    done = subprocess.run(
        [sys.executable, "-c", ATTEMPT, "confined" if confined else "free", action, str(argument), str(memory)],
        capture_output=True,
        text=True,
        cwd=folder,
        check=True,
    )
    could, what = json.loads(done.stdout)
    for each, ability in could.items():
        if not ability and action in {"network": ("connect", "datagram"), "files": ("read", "start", "write")}[each]:
            pytest.skip(f"this system cannot take away a process's {each}")
    return what


@pytest.fixture
def port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize("action", ["connect", "datagram"])
def test_no_network(tmp_path: Path, port: int, action: str) -> None:
    assert attempt(tmp_path, action, port, confined=False) == 1
    assert attempt(tmp_path, action, port, confined=True) in ("PermissionError", "OSError")


def test_no_files_of_others(tmp_path: Path) -> None:
    work, secret = tmp_path / "work", tmp_path / "secret"
    work.mkdir()
    secret.write_text("secret")
    (work / "own").write_text("own")
    for path in (secret, Path("../secret"), secret.with_name("work") / ".." / "secret"):
        assert attempt(work, "read", path, confined=False) == 6
        assert attempt(work, "read", path, confined=True) == "PermissionError"
    (work / "link").symlink_to(secret)
    assert attempt(work, "read", "link", confined=True) == "PermissionError"
    assert attempt(work, "read", "own", confined=True) == 3


def test_writing_only_at_work_and_little(tmp_path: Path) -> None:
    work, other = tmp_path / "work", tmp_path / "other"
    work.mkdir()
    assert attempt(work, "write", other, confined=False) == 100_000
    assert attempt(work, "write", other, confined=True) == "PermissionError"
    assert attempt(work, "write", "own", confined=True) == "OSError"  # larger than a file may be
    assert (work / "own").stat().st_size == 10_000


def test_no_other_programs(tmp_path: Path) -> None:
    assert attempt(tmp_path, "start", "/bin/true", confined=False) == 0
    assert attempt(tmp_path, "start", "/bin/true", confined=True) == "PermissionError"


def test_no_more_memory(tmp_path: Path) -> None:
    assert attempt(tmp_path, "allocate", 5 * 10**8, confined=True, memory=10**9) == 5 * 10**8
    assert attempt(tmp_path, "allocate", 5 * 10**8, confined=True, memory=4 * 10**8) == "MemoryError"
