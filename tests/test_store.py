"""Datasets on disk: nothing lost, nothing half written, nothing damaged served."""

import contextlib
import dataclasses
import hashlib
import itertools
import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from small_flights import delayed_flights, flights, same, surface_flights, without_flights

from vvc_bench.datasets import folders, schema
from vvc_bench.datasets.manifest import EPISODES, MANIFEST, TRANSITIONS
from vvc_bench.datasets.store import CorruptDataset, Description, open_dataset, write_dataset
from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Observation, columns

FILES = (MANIFEST, EPISODES, TRANSITIONS)
DESCRIPTION = Description(
    "small-v0", {"grid": [3, 3, 5]}, 7, {"reach_target": 40, "crash": 5}, 45, {"length": 80.5}, {"parent-v0": "00"}
)


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return flights()


@pytest.fixture(autouse=True)
def small_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schema, "ROWS_OF_A_GROUP", 500)


@pytest.fixture
def folder(flown: Episodes, tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "small-v0", flown, DESCRIPTION)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def debris(folder: Path) -> list[str]:
    return [path.name for path in folder.parent.iterdir() if path != folder]


# Round trip


@pytest.mark.parametrize(
    "make",
    [flights, delayed_flights, surface_flights, lambda: without_flights(flights())],
    ids=["guidance", "delay, gusts and starts of their own", "surfaces", "empty"],
)
def test_what_is_written_is_read(make: Callable[[], Episodes], tmp_path: Path) -> None:
    episodes = make()
    dataset = open_dataset(write_dataset(tmp_path / "set", episodes, DESCRIPTION))
    assert same(dataset.read(), episodes)
    assert same(dataset.check(), episodes)
    assert len(dataset) == len(episodes)


def test_values_that_are_easily_lost(flown: Episodes, tmp_path: Path) -> None:
    special = np.array([-0.0, 0.0, np.nan, np.inf, -np.inf, 1e-45], dtype=np.float32)
    flown = flown.select(range(6))
    flown.rewards[:3] = special[:3]
    flown.load_factors[:6] = special
    flown.goals[:, 2] = special.astype(np.float64)
    flown.seeds.flags.writeable = True
    flown.seeds[:] = [0, 1, 2**53, 2**63 - 1, -1, -(2**63)]
    assert same(open_dataset(write_dataset(tmp_path / "set", flown, DESCRIPTION)).read(), flown)


def test_delayed_commands_are_part_of_a_start(tmp_path: Path) -> None:
    episodes = delayed_flights()
    dataset = open_dataset(write_dataset(tmp_path / "set", episodes, DESCRIPTION))
    assert episodes.starts.shape == (20, 42 + 2 * 3)
    np.testing.assert_array_equal(dataset.episode_column("start_delayed_1_load_factor_g"), episodes.starts[:, 46])
    np.testing.assert_array_equal(dataset.episode_column("start_pitch_rad"), episodes.starts[:, 20])
    assert set(dataset.episode_column("outcome")) == {"none", "crash", "reach_target"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"actions": np.zeros((3, 3))}, r"actions must be float32 \(\d+, 3\), got float64 \(3, 3\)"),
        ({"rewards": np.zeros((5, 1), np.float32)}, "rewards must be float32"),
        ({"offsets": np.array([0, 5, 5, 9])}, "offsets must be rising int64"),
        ({"sources": np.array([b"pid"])}, "sources must be str"),
    ],
)
def test_arrays_that_would_be_changed_are_refused(
    flown: Episodes, tmp_path: Path, change: dict[str, np.ndarray], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_dataset(tmp_path / "set", dataclasses.replace(flown, **change), DESCRIPTION)
    assert list(tmp_path.iterdir()) == []


def test_descriptions_that_are_no_documents_are_refused(flown: Episodes, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_dataset(tmp_path / "set", flown, Description("a", metrics={"mean": float("nan")}))
    with pytest.raises(TypeError, match="JSON"):
        write_dataset(tmp_path / "set", flown, Description("a", metrics={"mean": {1, 2}}))
    for name in ("", "../a", "a/b", ".a", "a" * 101):
        with pytest.raises(ValueError, match="a set's name has"):
            Description(name)
    assert list(tmp_path.iterdir()) == []


def test_the_same_flights_give_the_same_bytes(folder: Path, flown: Episodes, tmp_path: Path) -> None:
    again = write_dataset(tmp_path / "again", flown.select(np.arange(len(flown))), DESCRIPTION)
    assert contents(again) == contents(folder)
    script = (
        "import sys; from pathlib import Path; from small_flights import flights; from test_store import DESCRIPTION;"
        "from vvc_bench.datasets import schema; schema.ROWS_OF_A_GROUP = 500;"
        "from vvc_bench.datasets.store import write_dataset; write_dataset(sys.argv[1], flights(), DESCRIPTION)"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent), "PYTHONHASHSEED": "5", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", script, tmp_path / "elsewhere"], check=True, env=environment)
    assert contents(tmp_path / "elsewhere") == contents(folder)


# What others see


def test_files_are_plain_parquet(folder: Path, flown: Episodes) -> None:
    table = pq.read_table(folder / TRANSITIONS)
    assert table.column_names == [
        *("episode", "step", *columns(Observation)),
        *("action_roll_rate_degps", "action_load_factor_g", "action_throttle"),
        *("reward", "terminated", "truncated", "events"),
        *("aileron_deg", "elevator_deg", "rudder_deg", "throttle", "load_factor_g"),
    ]
    for name, field in columns(Observation).items():
        known = table.schema.field(name)
        assert known.type == pa.float32()
        assert known.metadata[b"unit"].decode() == field.unit.outside
        assert field.meaning in known.metadata[b"meaning"].decode()
    np.testing.assert_array_equal(table["speed_mps"].to_numpy(), flown.observations[:, 3])
    np.testing.assert_array_equal(np.diff(table["step"].to_numpy()) == 1, np.diff(table["episode"].to_numpy()) == 0)
    ends = flown.offsets[1:] - 1
    assert np.flatnonzero(table["terminated"].to_numpy()).tolist() == ends[flown.reached].tolist()
    frame = pq.read_table(folder / EPISODES).to_pandas()
    np.testing.assert_array_equal(frame[["goal_speed_mps", "goal_path_angle_deg", "goal_azimuth_deg"]], flown.goals)
    np.testing.assert_array_equal(frame["length"], flown.lengths)
    np.testing.assert_array_equal(frame["first_transition"], flown.offsets[:-1])
    np.testing.assert_array_equal(frame["final_roll_deg"], flown.final_observations[:, 0])
    returns = [flown.rewards[a:b].sum(dtype=float) for a, b in itertools.pairwise(flown.offsets)]
    np.testing.assert_allclose(frame["return"], returns, rtol=1e-12)
    assert set(frame["outcome"]) == {"reach_target"}


def test_row_groups_end_with_trajectories(folder: Path) -> None:
    file = pq.ParquetFile(folder / TRANSITIONS)
    groups = [file.read_row_group(i, columns=["episode"])["episode"].to_numpy() for i in range(file.num_row_groups)]
    assert len(groups) > 5
    assert all(abs(len(group) - 500) < 150 for group in groups[:-1])
    assert all(before[-1] < after[0] for before, after in itertools.pairwise(groups))
    frame = pq.read_table(folder / EPISODES).to_pandas()
    for i, group in enumerate(groups):
        assert frame["episode"][frame["row_group"] == i].tolist() == np.unique(group).tolist()


def test_encodings_are_the_ones_that_were_chosen(folder: Path) -> None:
    for name, dictionaries in (
        (TRANSITIONS, {"episode", "events"}),
        (
            EPISODES,
            {"goal_speed_mps", "goal_path_angle_deg", "goal_azimuth_deg", "source", "outcome", "final_events"},
        ),
    ):
        group = pq.read_metadata(folder / name).row_group(0)
        for column in (group.column(j) for j in range(group.num_columns)):
            has_dictionary = "RLE_DICTIONARY" in column.encodings
            assert has_dictionary == (column.path_in_schema in dictionaries), column.path_in_schema
            assert column.compression == "ZSTD"
            if column.physical_type in ("FLOAT", "DOUBLE") and not has_dictionary:
                assert "BYTE_STREAM_SPLIT" in column.encodings


def test_page_checksums_are_written(folder: Path) -> None:
    column = pq.read_metadata(folder / TRANSITIONS).row_group(2).column(5)
    content = bytearray((folder / TRANSITIONS).read_bytes())
    content[column.data_page_offset + column.total_compressed_size - 3] ^= 1
    with pytest.raises(OSError, match="CRC"):
        pq.ParquetFile(pa.BufferReader(bytes(content)), page_checksum_verification=True).read()


def test_the_manifest_says_what_the_set_is(folder: Path, flown: Episodes) -> None:
    dataset = open_dataset(folder)
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    assert {key: value for key, value in manifest.items() if key != "sha256"} == dataset.manifest
    assert (manifest["name"], manifest["seed"], manifest["parents"]) == ("small-v0", 7, {"parent-v0": "00"})
    assert manifest["counts"] == {"goals_flown": 45, "episodes": len(flown), "transitions": len(flown.rewards)}
    assert manifest["last_events"] == {"reach_target": 40, "crash": 5}
    assert dataset.scenario == flown.scenario
    for name, entry in manifest["files"].items():
        content = (folder / name).read_bytes()
        assert (entry["bytes"], entry["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())
    assert dataset.hash == hashlib.sha256((folder / MANIFEST).read_bytes()).hexdigest()
    speed = manifest["columns"]["transitions"]["speed_mps"]
    values = flown.observations[:, 3].astype(float)
    expected = {"mean": values.mean(), "std": values.std(), "min": values.min(), "max": values.max()}
    assert {key: speed[key] for key in expected} == pytest.approx(expected, rel=1e-8)
    assert speed["unit"] == "mps"


# Damage


def read_in_parts(folder: Path, like: Episodes) -> Episodes:
    """The flights from one column after another."""
    dataset, where = open_dataset(folder), schema.layout(like.scenario)
    transitions = {name: dataset.column(name) for names in where.transitions.values() for name in names}
    table = {name: dataset.episode_column(name) for names in where.episodes.values() for name in names}
    arrays = schema.arrays_of(transitions, where.transitions) | schema.arrays_of(table, where.episodes)
    return Episodes(dataset.scenario, offsets=like.offsets, **arrays)


def test_no_flipped_byte_is_served(folder: Path, flown: Episodes) -> None:
    """200 flips, a third in each file: whole reads refuse them all, partial ones refuse or give what was written."""
    generator = random.Random(0)
    assert same(read_in_parts(folder, flown), flown)
    refused_in_parts = 0
    for k in range(200):
        path = folder / FILES[k % 3]
        content = path.read_bytes()
        place, change = generator.randrange(len(content)), generator.randrange(1, 256)
        path.write_bytes(content[:place] + bytes([content[place] ^ change]) + content[place + 1 :])
        with pytest.raises(CorruptDataset, match=str(folder)):
            open_dataset(folder).read()
        with pytest.raises(CorruptDataset, match=str(folder)):
            open_dataset(folder).check()
        try:
            assert same(read_in_parts(folder, flown), flown), (path, place, change)
        except CorruptDataset:
            refused_in_parts += 1
        path.write_bytes(content)
    assert refused_in_parts > 190


def test_no_flipped_byte_is_served_by_what_is_open(folder: Path, flown: Episodes) -> None:
    """Trajectories and columns from a set whose file of transitions is damaged after it was opened and used."""
    dataset = open_dataset(folder)
    assert same(dataset[3], flown.select([3]))
    metadata = pq.read_metadata(folder / TRANSITIONS)
    content = (folder / TRANSITIONS).read_bytes()
    generator = random.Random(1)
    for _ in range(100):
        group = generator.randrange(metadata.num_row_groups)
        chunk = metadata.row_group(group).column(generator.randrange(metadata.num_columns))
        start = chunk.dictionary_page_offset or chunk.data_page_offset
        place = start + generator.randrange(min(chunk.total_compressed_size, 40))  # page headers lie here
        damaged = content[:place] + bytes([content[place] ^ generator.randrange(1, 256)]) + content[place + 1 :]
        (folder / TRANSITIONS).write_bytes(damaged)
        with pytest.raises(CorruptDataset, match="between bytes"):
            dataset.column(chunk.path_in_schema)
        inside = np.flatnonzero(dataset.episode_column("row_group") == group)
        outside = np.flatnonzero(dataset.episode_column("row_group") != group)
        if chunk.path_in_schema not in ("episode", "step", "terminated", "truncated"):
            with pytest.raises(CorruptDataset, match="between bytes"):
                dataset[int(inside[0])]
        assert same(dataset[int(outside[0])], flown.select(outside[:1]))


def test_truncated_empty_and_missing_files_are_named(folder: Path) -> None:
    for name in FILES:
        path = folder / name
        content = path.read_bytes()
        for size in (0, 1, 4, len(content) // 2, len(content) - 1):
            path.write_bytes(content[:size])
            with pytest.raises(CorruptDataset, match=f"{name}.*build or download it again"):
                open_dataset(folder).read()
        path.unlink()
        with pytest.raises(CorruptDataset, match=f"no file '{name}'"):
            open_dataset(folder)
        path.write_bytes(content)
    open_dataset(folder).check()
    with pytest.raises(FileNotFoundError):
        open_dataset(folder / "elsewhere")


def test_a_file_cut_off_while_it_is_open_is_noticed(folder: Path) -> None:
    dataset = open_dataset(folder)
    dataset.column("reward")
    os.truncate(folder / TRANSITIONS, 5000)
    with pytest.raises(CorruptDataset, match="ends early"):
        dataset.column("reward")


def sealed(document: dict[str, object]) -> bytes:
    """A manifest with the right checksum."""
    document = {key: value for key, value in document.items() if key != "sha256"}
    text = json.dumps(document, indent=2, ensure_ascii=False) + "\n"
    document["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    return (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode()


def test_wrong_columns_are_refused_although_all_checksums_are_right(folder: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    for name in (EPISODES, TRANSITIONS):
        content = (folder / name).read_bytes()
        table = pq.read_table(folder / name)
        for wrong in (table.drop(["events" if name == TRANSITIONS else "seed"]), table.slice(1), pa.table({"a": [1]})):
            sink = pa.BufferOutputStream()
            pq.write_table(wrong.replace_schema_metadata(table.schema.metadata), sink)
            (folder / name).write_bytes(sink.getvalue().to_pybytes())
            sums = {"sha256": hashlib.sha256(sink.getvalue()).hexdigest(), "bytes": sink.getvalue().size}
            files = manifest["files"] | {name: manifest["files"][name] | sums}
            (folder / MANIFEST).write_bytes(sealed(manifest | {"files": files}))
            with pytest.raises(CorruptDataset, match=name):
                open_dataset(folder).read()
        (folder / name).write_bytes(content)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m | {"format": "other"}, "is no manifest"),
        (lambda m: m | {"format_version": 2}, "has format version 2, this vvc-bench reads 1: update it"),
        (lambda m: m | {"name": "../../etc"}, "name that is not plain"),
        (lambda m: m | {"name": 3}, "has no 'name' that is a str"),
        (lambda m: m | {"seed": True}, "has no 'seed' that is a int"),
        (lambda m: {key: m[key] for key in m if key != "parents"}, "has no 'parents'"),
        (lambda m: m | {"files": m["files"] | {"../x": m["files"][EPISODES]}}, "lists files other than"),
        (lambda m: m | {"files": {"/etc/passwd": m["files"][EPISODES]}}, "lists files other than"),
        (
            lambda m: m | {"files": m["files"] | {EPISODES: {"sha256": "0", "bytes": 1, "rows": 1}}},
            "without its sha256",
        ),
        (lambda m: m | {"counts": m["counts"] | {"episodes": -1}}, "has counts other than"),
        (lambda m: m | {"counts": m["counts"] | {"episodes": 1}}, "without its sha256, bytes and rows"),
        (lambda m: m | {"scenario": {"task": {}}}, "has a scenario or columns that cannot be read"),
        (lambda m: m | {"scenario": []}, "has no 'scenario'"),
        (lambda m: m | {"columns": {}}, "has a scenario or columns that cannot be read"),
        (lambda m: m | {"columns": m["columns"] | {"episodes": {}}}, "has other columns"),
    ],
)
def test_hostile_manifests_are_refused(
    folder: Path, change: Callable[[dict[str, object]], dict[str, object]], message: str
) -> None:
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    (folder / MANIFEST).write_bytes(sealed(change(manifest)))
    with pytest.raises(CorruptDataset, match=message):
        open_dataset(folder)


def test_what_is_no_manifest_is_refused(folder: Path) -> None:
    good = (folder / MANIFEST).read_bytes()
    twice = good.replace(b'"seed": 7,', b'"seed": 7,\n  "seed": 7,')
    for content in (b"[]", b"3", b"{", b"\xff\xfe", b"[" * 100_000, good + b"\n", twice, good.replace(b'": ', b'":')):
        (folder / MANIFEST).write_bytes(content)
        with pytest.raises(CorruptDataset, match=MANIFEST):
            open_dataset(folder)


def test_links_and_pipes_are_refused(folder: Path, tmp_path: Path) -> None:
    for name in FILES:
        path, elsewhere = folder / name, tmp_path / "elsewhere"
        path.rename(elsewhere)
        path.symlink_to(elsewhere)
        with pytest.raises(CorruptDataset, match="is a link"):
            open_dataset(folder)
        path.unlink()
        os.mkfifo(path)
        with pytest.raises(CorruptDataset, match="is no plain file"):
            open_dataset(folder)
        path.unlink()
        path.mkdir()
        with pytest.raises(CorruptDataset, match="is no plain file"):
            open_dataset(folder)
        path.rmdir()
        elsewhere.rename(path)


# Writing over


def test_nothing_but_a_set_is_replaced(flown: Episodes, tmp_path: Path) -> None:
    place = tmp_path / "thesis"
    place.mkdir()
    (place / "chapter.txt").write_text("ten years of work", encoding="utf-8")
    with pytest.raises(FileExistsError, match="holds other things"):
        write_dataset(place, flown, DESCRIPTION)
    assert contents(place) == {"chapter.txt": b"ten years of work"}
    with pytest.raises(FileExistsError, match="is no folder"):
        write_dataset(place / "chapter.txt", flown, DESCRIPTION)
    (tmp_path / "link").symlink_to(place)
    with pytest.raises(FileExistsError, match="is no folder"):
        write_dataset(tmp_path / "link", flown, DESCRIPTION)
    assert debris(place) == ["link"]


@pytest.mark.parametrize("at_once", [True, False], ids=["swapped by the system", "renamed twice"])
def test_a_set_is_replaced_and_what_is_open_stays_readable(
    folder: Path, flown: Episodes, monkeypatch: pytest.MonkeyPatch, at_once: bool
) -> None:
    if not at_once:
        monkeypatch.setattr(folders.ctypes, "CDLL", lambda *_, **__: object())
    before = open_dataset(folder)
    write_dataset(folder, flown.select([1, 2]), DESCRIPTION)
    assert len(open_dataset(folder).check()) == 2
    assert same(before.read(), flown)
    assert same(before[5], flown.select([5]))
    assert debris(folder) == []


def write_again_and_again(folder: Path, which: list[list[int]]) -> None:
    schema.ROWS_OF_A_GROUP = 500
    flown = flights()
    for chosen in which:
        write_dataset(folder, flown.select(chosen), DESCRIPTION)


def test_readers_see_the_old_set_or_the_new_one(folder: Path, flown: Episodes) -> None:
    context = multiprocessing.get_context("spawn")
    choices = [[0, 1], list(range(30))]
    writer = context.Process(target=write_again_and_again, args=(folder, choices * 15))
    writer.start()
    seen = set()
    while writer.is_alive():
        dataset = open_dataset(folder)
        first = dataset[0]
        assert same(first, flown.select([0]))
        assert len(dataset.read()) == len(dataset)
        seen.add(len(dataset))
    writer.join()
    assert writer.exitcode == 0
    assert seen >= {2, 30}
    assert debris(folder) == []


def test_two_writers_at_once(folder: Path, flown: Episodes) -> None:
    context = multiprocessing.get_context("spawn")
    writers = [
        context.Process(target=write_again_and_again, args=(folder, [chosen] * 10)) for chosen in ([0, 1], [2, 3, 4])
    ]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    read = open_dataset(folder).check()
    assert same(read, flown.select([0, 1])) or same(read, flown.select([2, 3, 4]))
    assert debris(folder) == []


@pytest.mark.parametrize("at_once", [True, False], ids=["swapped by the system", "renamed twice"])
def test_many_writers_of_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: bool) -> None:
    if not at_once:
        monkeypatch.setattr(folders.ctypes, "CDLL", lambda *_, **__: object())

    def work(name: str) -> None:
        for _ in range(50):
            with folders.replaced_folder(tmp_path / "place", "first") as place:
                for file in ("first", "second"):
                    (place / file).write_text(name, encoding="utf-8")

    threads = [threading.Thread(target=work, args=(name,)) for name in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(contents(tmp_path / "place").values())) == 1
    assert debris(tmp_path / "place") == []


def test_a_killed_writer_leaves_the_old_set_and_debris_that_the_next_one_removes(folder: Path, flown: Episodes) -> None:
    """kill −9 at many moments of writing, the start of the process aside."""
    script = (
        "import sys; from pathlib import Path; from small_flights import flights; from test_store import DESCRIPTION;"
        "from vvc_bench.datasets.store import write_dataset; flown = flights(); print(flush=True)\n"
        "while True: write_dataset(Path(sys.argv[1]), flown.select([0, 1]), DESCRIPTION)"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    generator, left = random.Random(2), 0
    for _ in range(8):
        with subprocess.Popen(
            [sys.executable, "-c", script, folder], stdout=subprocess.PIPE, env=environment
        ) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            time.sleep(generator.uniform(0.0, 0.3))
            writer.send_signal(signal.SIGKILL)
        left += bool(debris(folder))
        assert all(name.startswith(".small-v0.") and name.endswith(".unfinished") for name in debris(folder))
        read = open_dataset(folder).check()
        assert same(read, flown) or same(read, flown.select([0, 1]))
    assert left > 0
    write_dataset(folder, flown, DESCRIPTION)
    assert debris(folder) == []
    assert same(open_dataset(folder).check(), flown)


def test_a_living_writer_is_left_alone(folder: Path, flown: Episodes) -> None:
    with folders.replaced_folder(folder, MANIFEST) as place:
        (place / MANIFEST).write_text("unfinished", encoding="utf-8")
        write_dataset(folder, flown.select([0]), DESCRIPTION)
        assert (place / MANIFEST).read_text(encoding="utf-8") == "unfinished"
        assert len(open_dataset(folder)) == 1
    assert (folder / MANIFEST).read_text(encoding="utf-8") == "unfinished"
    assert debris(folder) == []


def test_a_failed_writer_leaves_nothing(folder: Path) -> None:
    before = contents(folder)
    with pytest.raises(KeyError), folders.replaced_folder(folder, MANIFEST) as place:
        (place / "half").write_text({}["text"], encoding="utf-8")
    assert contents(folder) == before
    assert debris(folder) == []


LIMITED = """
import resource, sys
from pathlib import Path
from small_flights import flights
from test_store import DESCRIPTION
from vvc_bench.datasets.store import write_dataset
flown = flights()
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
try:
    write_dataset(Path(sys.argv[1]), flown, DESCRIPTION)
except OSError as error:
    print("OSError", error)
"""


@pytest.mark.parametrize("limit", [0, 1000, 30_000, 60_000])
def test_files_that_cannot_grow_leave_the_old_set(folder: Path, limit: int) -> None:
    before = contents(folder)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    command = [sys.executable, "-c", LIMITED, folder, str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.stdout.startswith("OSError"), done.stderr
    assert contents(folder) == before
    assert debris(folder) == []


@pytest.fixture
def little_disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(place)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no small file system can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_full_disk_leaves_the_old_set(little_disk: Path, flown: Episodes) -> None:
    folder = write_dataset(little_disk / "small-v0", flown.select(range(20)), DESCRIPTION)
    before = contents(folder)
    with contextlib.suppress(OSError), (little_disk / "filler").open("wb") as file:
        file.write(bytes(100_000))
    with pytest.raises(OSError, match="No space left"):
        write_dataset(folder, flown, DESCRIPTION)
    assert contents(folder) == before
    assert debris(folder) == ["filler"]
    open_dataset(folder).check()


def test_reading_from_many_threads(folder: Path, flown: Episodes) -> None:
    dataset, wrong = open_dataset(folder), []

    def work(first: int) -> None:
        for e in range(first, len(flown), 4):
            if not same(dataset[e], flown.select([e])):
                wrong.append(e)

    threads = [threading.Thread(target=work, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
