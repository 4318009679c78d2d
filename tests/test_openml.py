"""The path to and from OpenML, with the real package against a server on this machine that speaks its protocol."""

import io
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from openml_server import KEY, Entry, OpenMLServer, openml_serving
from public_flights import fly, long_table

from vvc_bench.datasets.download import BrokenPromiseError
from vvc_bench.datasets.publish import publish_on_openml
from vvc_bench.datasets.recordings import UnknownLayoutError
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.datasets.store import Description, open_dataset, write_dataset
from vvc_bench.rollout import Episodes

FLIGHTS = pa.table(
    {
        "time": [0.0, 0.1, 0.2, 0.0, 0.1],
        "s_v": np.random.default_rng(0).normal(200, 30, 5),
        "a_nz": np.array([1, -0.1, 2.5, 9, 1e-7], dtype=np.float32),
        "steps": [1, 2, 3, 1, 2],
        "where": ["here", "there", "it's", "a,b", "%"],
    }
)

NUMBERS = FLIGHTS.drop_columns(["where"])


def parquet(table: pa.Table) -> bytes:
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


@pytest.fixture(scope="module")
def openml(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The package, with a folder of its own for what it writes when it is imported."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        patch.setenv("OPENML_CACHE_DIR", str(tmp_path_factory.mktemp("users-cache")))
        yield pytest.importorskip("openml", reason="pip install 'vvc-bench[openml]'")


@pytest.fixture
def server(openml: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[OpenMLServer]:
    with openml_serving() as running:
        monkeypatch.setattr(openml.config, "server", f"{running.url}/api/v1/xml")
        monkeypatch.setattr(openml.config, "connection_n_retries", 1)
        yield running


@pytest.fixture
def arff(openml: ModuleType) -> bytes:
    """As the writer makes it that the package itself uses."""
    del openml
    kinds = {"steps": "INTEGER", "where": "STRING"}
    attributes = [(name, kinds.get(name, "REAL")) for name in FLIGHTS.column_names]
    rows = [list(row.values()) for row in FLIGHTS.to_pylist()]
    writer = pytest.importorskip("arff")
    return writer.dumps({"relation": "flights", "attributes": attributes, "data": rows}).encode()


@pytest.fixture
def fetch(openml: ModuleType, tmp_path: Path) -> Callable[[], pa.Table]:
    from vvc_bench.datasets.openml_source import fetch_table

    def run() -> pa.Table:
        users = openml.config.get_config_as_dict()
        try:
            return fetch_table(46000, tmp_path / "cache")
        finally:
            assert not (tmp_path / "cache").exists()
            assert openml.config.get_config_as_dict() == users

    return run


def test_the_parquet_file_comes_from_the_object_store(server: OpenMLServer, fetch: Callable[[], pa.Table]) -> None:
    server.entries[46000] = Entry(parquet=parquet(FLIGHTS))
    assert fetch().equals(FLIGHTS)
    methods = [asked.partition("?")[0] for asked in server.asked]
    store = "/datasets/0004/46000/dataset_46000.pq"
    assert methods == ["GET /api/v1/xml/data/46000", f"HEAD {store}", f"GET {store}", f"GET {store}"]


@pytest.mark.parametrize("named", [True, False])
def test_without_it_the_arff_file_comes(
    server: OpenMLServer, fetch: Callable[[], pa.Table], arff: bytes, named: bool
) -> None:
    server.entries[46000] = Entry(arff, parquet=parquet(FLIGHTS) if named else None, in_store=False)
    came = fetch()
    assert came.column_names == FLIGHTS.column_names
    for name in ("time", "s_v", "steps", "where"):
        assert came[name].to_pylist() == FLIGHTS[name].to_pylist()
    np.testing.assert_array_equal(came["a_nz"].to_numpy().astype(np.float32), FLIGHTS["a_nz"].to_numpy())


@pytest.mark.usefixtures("openml")
def test_arff_files_are_what_others_read() -> None:
    from vvc_bench.datasets.openml_source import arff_text

    read = pytest.importorskip("arff").loads(arff_text(NUMBERS))
    assert read["attributes"] == [("time", "REAL"), ("s_v", "REAL"), ("a_nz", "REAL"), ("steps", "INTEGER")]
    sent = np.array([list(row.values()) for row in NUMBERS.to_pylist()])
    np.testing.assert_array_equal(np.array(read["data"], dtype=np.float32), sent.astype(np.float32))
    np.testing.assert_array_equal(np.array(read["data"])[:, 1], sent[:, 1])


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flip(content: bytes) -> bytes:
    return content[:100] + bytes([content[100] ^ 1]) + content[101:]


@pytest.mark.parametrize("spoil", [cut, flip])
def test_a_spoilt_parquet_file_is_fetched_again(
    server: OpenMLServer, fetch: Callable[[], pa.Table], spoil: Callable[[bytes], bytes]
) -> None:
    server.entries[46000] = Entry(parquet=parquet(FLIGHTS))
    server.spoil = [spoil]
    assert fetch().equals(FLIGHTS)
    server.spoil = [spoil] * 9
    with pytest.raises(BrokenPromiseError, match=r"broke off|has MD5"):
        fetch()


def test_a_spoilt_arff_file_is_fetched_again(server: OpenMLServer, fetch: Callable[[], pa.Table], arff: bytes) -> None:
    server.entries[46000] = Entry(arff)
    server.spoil = [flip]
    assert fetch().num_rows == 5
    server.entries[46000] = Entry(arff, md5="0" * 32)
    with pytest.raises(BrokenPromiseError, match="is damaged: Checksum of downloaded file is unequal"):
        fetch()
    server.entries[46000] = Entry(arff)
    server.spoil = [cut] * 9
    with pytest.raises(BrokenPromiseError, match=r"dataset 46000 .* broke off"):
        fetch()


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ((111, "Unknown dataset"), FileNotFoundError),
        ((112, "No access granted"), PermissionError),
        ((113, "Something else"), OSError),
    ],
)
def test_the_servers_errors_are_pythons(
    server: OpenMLServer, fetch: Callable[[], pa.Table], error: tuple[int, str], expected: type[OSError]
) -> None:
    server.entries[46000] = Entry(error=error)
    with pytest.raises(expected, match=error[1]) as raised:
        fetch()
    assert raised.type is expected


@pytest.mark.usefixtures("server")
def test_no_server_is_an_error(
    openml: ModuleType, monkeypatch: pytest.MonkeyPatch, fetch: Callable[[], pa.Table]
) -> None:
    monkeypatch.setattr(openml.config, "server", "http://127.0.0.1:9/api/v1/xml")
    with pytest.raises(OSError, match="refused"):
        fetch()


@pytest.mark.parametrize("content", [b"nothing", b"@RELATION x\n@ATTRIBUTE y HORSE\n@DATA\n1\n"])
def test_what_is_no_arff_file_is_refused(server: OpenMLServer, fetch: Callable[[], pa.Table], content: bytes) -> None:
    server.entries[46000] = Entry(content)
    with pytest.raises(ValueError, match="no ARFF file"):
        fetch()


DESCRIPTION = {
    **{"name": "vvc-bench-test", "description": "Flights.", "creator": "somebody", "licence": "CC-BY-4.0"},
    **{"language": "English", "default_target_attribute": "a_nz", "citation": "none", "version_label": "0"},
}


def test_a_table_goes_up(
    openml: ModuleType, monkeypatch: pytest.MonkeyPatch, server: OpenMLServer, tmp_path: Path
) -> None:
    from vvc_bench.datasets.openml_source import arff_text, upload_table

    with pytest.raises(PermissionError, match="takes an API key"):
        upload_table(NUMBERS, DESCRIPTION, tmp_path)
    monkeypatch.setattr(openml.config, "apikey", "wrong")
    with pytest.raises(PermissionError, match="requires authentication via an API key"):
        upload_table(NUMBERS, DESCRIPTION, tmp_path)
    monkeypatch.setattr(openml.config, "apikey", KEY)
    assert upload_table(NUMBERS, DESCRIPTION, tmp_path) == 47000
    (upload,) = server.uploads
    assert upload["dataset"] == arff_text(NUMBERS).encode()
    assert b"<oml:name>vvc-bench-test</oml:name>" in upload["description"]
    assert b"<oml:licence>CC-BY-4.0</oml:licence>" in upload["description"]


# Whole datasets


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VVC_BENCH_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("VVC_BENCH_MIRROR", raising=False)
    return tmp_path / "home"


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return fly()


@pytest.mark.parametrize("asked", [("openml-46012", None), ("openml-46012", "openml"), ("irpo1-v0", "openml")])
def test_the_papers_sets_come_from_openml(
    server: OpenMLServer, home: Path, flown: Episodes, asked: tuple[str, str | None]
) -> None:
    server.entries[46012] = Entry(parquet=parquet(long_table(flown)))
    name, source = asked
    dataset = load_dataset(name, source=source)
    assert dataset.name == "openml-46012"
    came = dataset.read()
    np.testing.assert_array_equal(came.observations, flown.observations)
    np.testing.assert_array_equal(came.goals, flown.goals)
    said = dataset.manifest["specification"]["imported"]
    assert said["from"] == "OpenML 46012"
    assert said["reflown"]["same_throughout"] == len(flown)
    assert dataset.manifest["counts"]["goals_flown"] == 50_715
    server.entries.clear()
    assert load_dataset("openml-46012", offline=True).hash == dataset.hash
    beside = {path.name for path in (home / "datasets").iterdir()}
    assert beside == {"openml-46012", ".openml-46012.lock", ".openml-46012.note"}


def test_an_arff_file_gives_the_same_dataset(server: OpenMLServer, home: Path, flown: Episodes) -> None:
    from vvc_bench.datasets.openml_source import arff_text

    server.entries[46013] = Entry(arff_text(long_table(flown)).encode())
    np.testing.assert_array_equal(load_dataset("openml-46013").read().observations, flown.observations)
    assert (home / "datasets" / "openml-46013").is_dir()


def test_tables_that_are_no_flights_are_refused_and_leave_nothing(server: OpenMLServer, home: Path) -> None:
    server.entries[46000] = Entry(parquet=parquet(FLIGHTS))
    with pytest.raises(UnknownLayoutError, match=r"no known layout\. Found columns: time, s_v, a_nz, steps, where"):
        load_dataset("openml-46000")
    with pytest.raises(FileNotFoundError, match="has no dataset 46001"):
        load_dataset("openml-46001")
    assert not list((home / "datasets").glob("[!.]*"))


def test_a_broken_copy_is_imported_again(server: OpenMLServer, home: Path, flown: Episodes) -> None:
    server.entries[46014] = Entry(parquet=parquet(long_table(flown)))
    whole = load_dataset("openml-46014")
    path = home / "datasets" / "openml-46014" / "episodes.parquet"
    path.write_bytes(flip(path.read_bytes()))
    assert load_dataset("openml-46014").hash == whole.hash
    load_dataset("openml-46014").read()


@pytest.mark.usefixtures("home")
def test_a_dataset_is_published(
    openml: ModuleType, monkeypatch: pytest.MonkeyPatch, server: OpenMLServer, tmp_path: Path, flown: Episodes
) -> None:
    dataset = open_dataset(write_dataset(tmp_path / "small-v0", flown, Description("small-v0")))
    monkeypatch.setattr(openml.config, "apikey", KEY)
    assert publish_on_openml(dataset) == 47000
    (upload,) = server.uploads
    rows = pytest.importorskip("arff").loads(upload["dataset"].decode())
    names = [name for name, _ in rows["attributes"]]
    assert names[:5] == ["episode", "step", "goal_speed_mps", "goal_path_angle_deg", "goal_azimuth_deg"]
    sent = np.array(rows["data"], dtype=np.float32)
    np.testing.assert_array_equal(sent[:, 5:13], flown.observations)
    np.testing.assert_array_equal(sent[:, names.index("action_throttle")], flown.actions[:, 2])
    assert dataset.hash.encode() in upload["description"]
    with pytest.raises(ValueError, match="are no dataset"):
        publish_on_openml(dataset.select([0]))


def test_without_the_package_it_says_what_to_install(home: Path) -> None:
    program = "import sys; sys.modules['openml'] = None; import vvc_bench; vvc_bench.load_dataset('openml-46000')"
    environment = os.environ | {"VVC_BENCH_HOME": str(home)}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert (
        "ImportError: OpenML takes the package openml, which is missing: pip install 'vvc-bench[openml]'" in run.stderr
    )
