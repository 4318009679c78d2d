"""Where datasets come from: copies that break are never opened, whatever happens on the way is survived."""

import hashlib
import json
import logging
import os
import pty
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from loopback_server import Server, serving

from vvc_bench.datasets import download as downloading
from vvc_bench.datasets import local, remote
from vvc_bench.datasets.catalogue import PID
from vvc_bench.datasets.download import BrokenPromiseError
from vvc_bench.datasets.sources import known_names, load_dataset
from vvc_bench.datasets.store import CorruptDataset, Description, write_dataset
from vvc_bench.experts import APPENDIX_C
from vvc_bench.goals import grid
from vvc_bench.rollout import fly_law

NAME = "small-v0"
FILES = ("manifest.json", "episodes.parquet", "transitions-00000.parquet")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mirror with one dataset."""
    mirror = tmp_path_factory.mktemp("mirror")
    flown = fly_law(PID, grid([160, 200, 240], [-10, 0, 10], [-30, 0, 45]).goals, APPENDIX_C)
    write_dataset(mirror / NAME, flown.episodes, Description(NAME))
    return mirror


@pytest.fixture
def mirror(original: Path, tmp_path: Path) -> Path:
    """A copy of it that may be spoilt."""
    shutil.copytree(original, tmp_path / "mirror")
    return tmp_path / "mirror"


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home, no mirror, a network, and no patience."""
    monkeypatch.setenv("VVC_BENCH_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("VVC_BENCH_MIRROR", raising=False)
    monkeypatch.delenv("VVC_BENCH_OFFLINE", raising=False)
    monkeypatch.setattr(downloading, "FIRST_PAUSE", 0.001)
    return tmp_path / "home"


@pytest.fixture
def copy(home: Path) -> Path:
    """Where the copy lies, or will."""
    return home / "datasets" / NAME


@pytest.fixture
def server(mirror: Path) -> Iterator[Server]:
    with serving(mirror) as running:
        yield running


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def left_behind(copy: Path) -> set[str]:
    """What lies beside the copy, besides its lock and its note."""
    return {path.name for path in copy.parent.iterdir()} - {NAME, f".{NAME}.lock", f".{NAME}.note"}


# Where they come from


def test_a_path_is_opened_as_it_is(mirror: Path, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert load_dataset(mirror / NAME).name == NAME
    assert load_dataset(str(mirror / NAME)).folder == mirror / NAME
    monkeypatch.chdir(mirror)
    assert load_dataset(f"./{NAME}").name == NAME
    assert not home.exists()
    with pytest.raises(FileNotFoundError, match=r"is no dataset: it has no manifest\.json; .*import_recordings"):
        load_dataset(mirror)
    with pytest.raises(ValueError, match="unknown dataset 'small-v0'"):
        load_dataset(NAME)


@pytest.mark.parametrize("spell", [str, Path.as_uri])
def test_a_mirror_may_be_a_folder(mirror: Path, original: Path, copy: Path, spell: Callable[[Path], str]) -> None:
    dataset = load_dataset(NAME, source=spell(mirror), offline=True)
    assert dataset.folder == copy
    assert content(copy) == content(original / NAME)
    assert left_behind(copy) == set()


def test_what_was_fetched_once_is_not_fetched_again(
    server: Server, original: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VVC_BENCH_MIRROR", f"{server.url}/")
    load_dataset(NAME).read()
    assert content(copy) == content(original / NAME)
    assert sorted(asked.path for asked in server.asked) == sorted(f"/{NAME}/{name}" for name in FILES)
    load_dataset(NAME)
    monkeypatch.delenv("VVC_BENCH_MIRROR")
    assert load_dataset(NAME, offline=True).hash == load_dataset(original / NAME).hash
    assert len(server.asked) == 3


def test_a_recipe_is_followed_and_parents_come_first(home: Path) -> None:
    dataset = load_dataset("pid-aug-sample-v0", offline=True, progress=False)
    assert dataset.read().reached.all()
    parent = load_dataset("pid-sample-v0", source="build")
    assert dataset.manifest["parents"] == {"pid-sample-v0": parent.hash}
    assert {path.name for path in (home / "datasets").glob("[!.]*")} == {"pid-sample-v0", "pid-aug-sample-v0"}


def test_a_broken_copy_is_built_again(home: Path) -> None:
    built = load_dataset("pid-sample-v0")
    path = home / "datasets" / "pid-sample-v0" / FILES[2]
    path.write_bytes(path.read_bytes()[:-1])
    again = load_dataset("pid-sample-v0")
    assert again.hash == built.hash
    again.read()


# What is said where they do not


def test_unknown_names_are_told_from_known_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown dataset 'pid-v1'; did you mean pid-v0 or .*Known are pid-v0, "):
        load_dataset("pid-v1")
    assert {"pid-v0", "pid-aug-v0", "irpo3-aug-v0", "openml-46000", "openml-46017"} <= set(known_names())


def test_a_mirror_that_has_none_of_that_name_is_named(server: Server, home: Path) -> None:
    with pytest.raises(ValueError, match=f"unknown dataset 'other-v0'; {server.url} has none of that name either"):
        load_dataset("other-v0", source=server.url)
    assert not list((home / "datasets").glob("[!.]*"))


def test_a_set_that_stands_for_none_of_the_papers_says_so() -> None:
    with pytest.raises(ValueError, match="pid400-v0 stands for no set on OpenML"):
        load_dataset("pid400-v0", source="openml")


@pytest.mark.parametrize("name", ["", "..", ".hidden", "a..b", "Pid-v0", "pid v0", "x" * 65, "pid-v0\n", "püd"])
def test_names_that_cannot_be_are_refused(name: str, home: Path) -> None:
    with pytest.raises(ValueError, match="is no name of a dataset"):
        load_dataset(name, source="http://127.0.0.1:9")
    assert not home.exists()


def test_without_the_network_only_what_is_here_is_opened(
    server: Server, mirror: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VVC_BENCH_OFFLINE", "1")
    with pytest.raises(OSError, match=f"not on this machine, and the network is not to be used.*{server.url}"):
        load_dataset(NAME, source=server.url)
    with pytest.raises(OSError, match=r"the network is not to be used.*would come from OpenML"):
        load_dataset("openml-46000")
    assert server.asked == []
    load_dataset(NAME, source=str(mirror))
    load_dataset(NAME, source=server.url)
    monkeypatch.setenv("VVC_BENCH_OFFLINE", "0")
    assert server.asked == []


def test_secrets_of_a_mirror_are_not_printed() -> None:
    for mirror in ("file://user:secret@/nowhere?token=secret", "http://user:secret@127.0.0.1:9/?token=secret"):
        with pytest.raises((ValueError, OSError), match=r"^(file|http)://") as raised:
            load_dataset("other-v0", source=mirror)
        assert "secret" not in str(raised.value)


# Copies that break


def test_single_flipped_bits_are_found_and_repaired(
    mirror: Path, original: Path, copy: Path, caplog: pytest.LogCaptureFixture
) -> None:
    generator = np.random.default_rng(0)
    load_dataset(NAME, source=str(mirror))
    expected = content(original / NAME)
    for _ in range(50):
        name = FILES[generator.integers(len(FILES))]
        damaged = bytearray(expected[name])
        damaged[generator.integers(len(damaged))] ^= 1 << generator.integers(8)
        (copy / name).write_bytes(damaged)
        caplog.clear()
        load_dataset(NAME, source=str(mirror))
        assert content(copy) == expected
        assert f"doing so now, the damaged copy is kept in {copy.with_name(f'.{NAME}.broken')}" in caplog.text
        assert content(copy.with_name(f".{NAME}.broken"))[name] == damaged


def test_a_flip_is_found_though_the_file_looks_as_old_as_it_was(mirror: Path, original: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    path = copy / FILES[2]
    settle(copy)
    stamp = path.stat()
    path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:])
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    load_dataset(NAME, source=str(mirror))
    assert content(copy) == content(original / NAME)


def settle(copy: Path) -> None:
    """Let the copy be looked at once its last change is long enough ago to tell another one from it."""
    patch = pytest.MonkeyPatch()
    patch.setattr(local, "_UNSETTLED", -1.0)
    local.check_copy(copy)
    patch.undo()


def test_a_copy_that_has_not_changed_is_not_read_again(
    mirror: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_dataset(NAME, source=str(mirror))
    settle(copy)
    monkeypatch.setattr(local, "sha256_of", lambda _path: pytest.fail("was read"))
    load_dataset(NAME)


def test_a_copy_that_changed_a_moment_ago_is_read_again(
    mirror: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_dataset(NAME, source=str(mirror))
    read: list[Path] = []
    monkeypatch.setattr(local, "sha256_of", lambda path: read.append(path) or downloading.sha256_of(path))
    load_dataset(NAME)
    assert [path.name for path in read] == list(json.loads((copy / FILES[0]).read_text())["files"])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda copy: (copy / FILES[2]).write_bytes((copy / FILES[2]).read_bytes()[:-100]),
        lambda copy: (copy / FILES[1]).unlink(),
        lambda copy: (copy / FILES[0]).unlink(),
        lambda copy: (copy / FILES[0]).write_text("{}"),
        lambda copy: [path.unlink() for path in copy.iterdir()],
        lambda copy: (shutil.rmtree(copy), copy.write_text("a file")),
        lambda copy: (copy.with_name(f".{NAME}.note").write_text("[]"), (copy / FILES[1]).write_bytes(b"")),
    ],
)
def test_whatever_was_done_to_a_copy_is_repaired(
    mirror: Path, original: Path, copy: Path, spoil: Callable[[Path], object]
) -> None:
    load_dataset(NAME, source=str(mirror))
    spoil(copy)
    load_dataset(NAME, source=str(mirror)).read()
    assert content(copy) == content(original / NAME)


def test_another_datasets_copy_is_not_taken_for_this_one(mirror: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    copy.rename(copy.with_name("other-v0"))
    with pytest.raises(CorruptDataset, match="is the manifest of 'small-v0', not of 'other-v0'"):
        load_dataset("other-v0")


def test_what_cannot_be_repaired_is_neither_opened_nor_lost(mirror: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    (copy / FILES[2]).write_bytes(b"broken")
    with pytest.raises(CorruptDataset, match="6 bytes"):
        load_dataset(NAME)
    assert (copy / FILES[2]).read_bytes() == b"broken"


def test_a_folder_that_may_not_be_written_to_is_read_all_the_same(mirror: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    copy.with_name(f".{NAME}.note").unlink()
    copy.with_name(f".{NAME}.note").mkdir()
    load_dataset(NAME, offline=True)


# Mirrors that lie


def sealed(document: dict[str, object]) -> str:
    """A manifest with a right checksum of its own, whatever it says."""
    from vvc_bench.datasets import manifest

    document = {key: value for key, value in document.items() if key != "sha256"}
    return manifest._text(document | {"sha256": manifest._sha256(manifest._text(document))})


def rewrite(mirror: Path, **changes: object) -> None:
    path = mirror / NAME / FILES[0]
    path.write_text(sealed(json.loads(path.read_text()) | changes), encoding="utf-8")


def entry(**changes: object) -> dict[str, object]:
    return {"sha256": "0" * 64, "bytes": 10, "rows": 1} | changes


@pytest.mark.parametrize(
    "name",
    ["../../escaped", "/tmp/escaped", "..", ".", "a/b.parquet", "a\\b.parquet", "manifest.json", "", "x\0y", ".hidden"],
)
def test_manifests_that_name_other_files_are_refused(server: Server, mirror: Path, home: Path, name: str) -> None:
    files = json.loads((mirror / NAME / FILES[0]).read_text())["files"]
    rewrite(mirror, files=files | {name: entry()})
    with pytest.raises(CorruptDataset, match=r"manifest\.json lists files other than"):
        load_dataset(NAME, source=server.url)
    rewrite(mirror, files={FILES[1]: entry(), name: entry()})
    with pytest.raises(CorruptDataset):
        load_dataset(NAME, source=server.url)
    assert {asked.path for asked in server.asked} == {f"/{NAME}/{FILES[0]}"}
    assert not list((home / "datasets").glob("[!.]*"))


def test_manifests_that_promise_too_much_are_refused(
    server: Server, mirror: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = json.loads((mirror / NAME / FILES[0]).read_text())["files"]
    rewrite(mirror, files=files | {FILES[2]: files[FILES[2]] | {"bytes": 10**18}})
    with pytest.raises(CorruptDataset, match=r"promises 10{18} bytes of .*, of which at most 10{11} are taken"):
        load_dataset(NAME, source=server.url)
    rewrite(mirror, files=files | {FILES[2]: files[FILES[2]] | {"bytes": 10**11}})
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: shutil._ntuple_diskusage(10**10, 0, 10**10))
    with pytest.raises(OSError, match=r"100 GB are needed in .*, 10 GB are free; make room, or set VVC_BENCH_HOME"):
        load_dataset(NAME, source=server.url)
    monkeypatch.setattr(remote, "LARGEST_MANIFEST", 1000)
    with pytest.raises(OSError, match="longer than the 1000 bytes"):
        load_dataset(NAME, source=server.url)
    assert {asked.path for asked in server.asked} == {f"/{NAME}/{FILES[0]}"}


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", '{"files": 3}', "<html>no</html>"])
def test_what_is_no_manifest_is_refused(server: Server, mirror: Path, text: str) -> None:
    (mirror / NAME / FILES[0]).write_text(text)
    with pytest.raises(CorruptDataset, match=r"manifest\.json"):
        load_dataset(NAME, source=server.url)


def test_a_manifest_of_another_dataset_is_refused(server: Server, mirror: Path) -> None:
    rewrite(mirror, name="pid-v0")
    with pytest.raises(CorruptDataset, match="is the manifest of 'pid-v0', not of 'small-v0'"):
        load_dataset(NAME, source=server.url)


def test_files_that_are_not_what_the_manifest_says_are_refused(server: Server, mirror: Path, copy: Path) -> None:
    path = mirror / NAME / FILES[2]
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(BrokenPromiseError, match="has SHA-256"):
        load_dataset(NAME, source=server.url)
    assert not copy.exists()
    path.unlink()
    with pytest.raises(BrokenPromiseError, match=r"manifest\.json promises .*, but it is not there: .*404"):
        load_dataset(NAME, source=server.url)
    assert not copy.exists()


def test_what_another_version_has_left_is_not_mixed_in(server: Server, original: Path, copy: Path) -> None:
    arriving = copy.with_name(f".{NAME}.arriving")
    arriving.mkdir(parents=True)
    (arriving / FILES[1]).write_bytes(b"another version")
    (arriving / f"{FILES[2]}.0123456789abcdef.part").write_bytes(b"another version")
    (arriving / "folder").mkdir()
    (arriving / "link").symlink_to("/etc/passwd")
    load_dataset(NAME, source=server.url)
    assert content(copy) == content(original / NAME)


# Interruptions and company


LOAD = """
import sys
from vvc_bench.datasets.sources import load_dataset
print(load_dataset("small-v0", source=sys.argv[1]).hash)
"""


Starter = Callable[[Server], "subprocess.Popen[str]"]


@pytest.fixture
def start(home: Path) -> Iterator[Starter]:
    """Starts processes that load the dataset; none outlives the test."""
    started: list[subprocess.Popen[str]] = []

    def run(server: Server) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", LOAD, server.url]
        pipe = subprocess.PIPE
        environment = os.environ | {"VVC_BENCH_HOME": str(home)}
        started.append(subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def hold(server: Server, path: str) -> tuple[threading.Event, threading.Event]:
    """Let the server stop after the first piece of a file: told when, and told to go on."""
    reached, go_on = threading.Event(), threading.Event()

    def pause(asked: str, _count: int) -> None:
        if asked == path:
            reached.set()
            go_on.wait(30)

    server.faults.pause = pause
    return reached, go_on


def test_a_killed_process_leaves_what_it_had_and_no_lock(
    server: Server, start: Starter, original: Path, copy: Path
) -> None:
    whole = (original / NAME / FILES[2]).stat().st_size
    reached, go_on = hold(server, f"/{NAME}/{FILES[2]}")
    process = start(server)
    assert reached.wait(30)
    arriving = copy.with_name(f".{NAME}.arriving")
    part = next(iter(arriving.glob(f"{FILES[2]}.*.part")), None)
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline and not (part and part.stat().st_size):
        time.sleep(0.01)
        part = next(iter(arriving.glob(f"{FILES[2]}.*.part")), None)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    go_on.set()
    assert not copy.exists()
    assert part is not None
    have = part.stat().st_size
    assert 0 < have < whole
    server.asked.clear()
    load_dataset(NAME, source=server.url).read()
    assert content(copy) == content(original / NAME)
    assert [(asked.path.rpartition("/")[2], asked.range) for asked in server.asked] == [
        (FILES[0], None),
        (FILES[2], f"bytes={have}-"),
    ]


def test_of_two_processes_one_fetches_and_the_other_waits(server: Server, start: Starter, original: Path) -> None:
    reached, go_on = hold(server, f"/{NAME}/{FILES[2]}")
    first = start(server)
    assert reached.wait(30)
    second = start(server)
    said = second.stderr.readline()
    assert "another process is making" in said
    go_on.set()
    outputs = [process.communicate(timeout=30)[0].strip() for process in (first, second)]
    assert outputs == [load_dataset(original / NAME).hash] * 2
    assert sorted(asked.path for asked in server.asked) == sorted(f"/{NAME}/{name}" for name in FILES)


def test_faults_of_the_network_are_survived(server: Server, original: Path, copy: Path) -> None:
    paths = [f"/{NAME}/{name}" for name in FILES]
    server.faults.statuses = {path: [500, 503] for path in paths}
    server.faults.cut_after = {path: [10, 0] for path in paths}
    server.faults.redirects[f"/moved/{NAME}/{FILES[2]}"] = f"{server.url}{paths[2]}"
    for name in FILES[:2]:
        server.faults.redirects[f"/moved/{NAME}/{name}"] = f"/{NAME}/{name}"
    load_dataset(NAME, source=f"{server.url}/moved")
    assert content(copy) == content(original / NAME)


def test_a_mirror_that_is_down_leaves_the_broken_copy_aside(server: Server, mirror: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    (copy / FILES[2]).write_bytes(b"broken")
    server.faults.statuses = {f"/{NAME}/{FILES[0]}": [500] * 99}
    with pytest.raises(OSError, match="could not be fetched in 5 attempts"):
        load_dataset(NAME, source=server.url)
    assert not copy.exists()
    assert content(copy.with_name(f".{NAME}.broken"))[FILES[2]] == b"broken"


# What is seen meanwhile


def test_a_line_shows_how_far_it_has_come_on_a_terminal(server: Server, home: Path) -> None:
    master, slave = pty.openpty()
    environment = os.environ | {"VVC_BENCH_HOME": str(home)}
    process = subprocess.Popen([sys.executable, "-c", LOAD, server.url], env=environment, stderr=slave, stdout=slave)
    os.close(slave)
    shown = b""
    while process.poll() is None or shown.count(b"\n") < 2:
        try:
            shown += os.read(master, 1 << 16)
        except OSError:  # the terminal's other end is closed
            break
    os.close(master)
    assert process.wait(30) == 0
    assert "fetching small-v0 ████████████████████████ 100%" in shown.decode()


def test_nothing_is_shown_elsewhere(server: Server, start: Starter) -> None:
    output, errors = start(server).communicate(timeout=30)
    assert errors == ""
    assert len(output.strip()) == len(hashlib.sha256().hexdigest())


def test_messages_come_without_a_logging_setup(mirror: Path, home: Path, copy: Path) -> None:
    load_dataset(NAME, source=str(mirror))
    (copy / FILES[2]).write_bytes(b"broken")
    run = subprocess.run(
        [sys.executable, "-c", LOAD, str(mirror)],
        env=os.environ | {"VVC_BENCH_HOME": str(home)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "transitions-00000.parquet has 6 bytes" in run.stderr
    assert logging.getLogger("vvc_bench.datasets.local").level == logging.NOTSET
