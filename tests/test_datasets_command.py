"""``vvc-bench datasets`` as its users run it: real processes, real files."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

SAMPLE = "pid-sample-v0"


def run(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", "vvc_bench", "datasets", *arguments]
    environment = os.environ | {"PYTHONUTF8": "1", "VVC_BENCH_HOME": str(home), "VVC_BENCH_OFFLINE": "1"}
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", cwd=home, env=environment)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home with one set, and this process's compiled code."""
    folder = tmp_path_factory.mktemp("home")
    known = os.environ.get("VVC_BENCH_HOME")
    if known and (Path(known) / "compiled").is_dir():
        (folder / "compiled").symlink_to(Path(known) / "compiled")
    done = run(folder, "build", SAMPLE)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert "157" in done.stdout
    return folder


def test_what_is_here_is_marked(home: Path) -> None:
    done = run(home, "list", "--json")
    rows = {row["name"]: row for row in json.loads(done.stdout)}
    assert rows[SAMPLE]["here"]
    assert not rows["pid-v0"]["here"]
    assert rows["pid-v0"]["openml_id"] == 46000
    assert f"* {SAMPLE}" in run(home, "list").stdout


def test_a_set_says_what_it_is(home: Path) -> None:
    document = json.loads(run(home, "info", SAMPLE, "--json").stdout)
    assert document["counts"]["episodes"] == document["metrics"]["table_1"]["trajectories"]
    assert str(home) in document["folder"]


def test_verifying_finds_one_changed_byte(home: Path, tmp_path: Path) -> None:
    assert run(home, "build", SAMPLE, "--output", str(tmp_path / "copy")).returncode == 0
    good = run(home, "verify", str(tmp_path / "copy"), "--json")
    assert (good.returncode, json.loads(good.stdout)["passed"]) == (0, True)
    file = tmp_path / "copy" / "transitions-00000.parquet"
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 4
    file.write_bytes(content)
    bad = run(home, "verify", str(tmp_path / "copy"))
    assert bad.returncode == 2
    assert "transitions-00000.parquet" in bad.stderr
    assert "Traceback" not in bad.stderr


def test_differences_between_two_sets(home: Path) -> None:
    assert run(home, "build", "pid-aug-sample-v0").returncode == 0
    done = run(home, "diff", SAMPLE, "pid-aug-sample-v0", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert found["gained"] == [[300.0, -30.0, -60.0]]
    assert found["lost"] == []
    assert len(found["shortened"]) > 10


def test_exports_read_back(home: Path, tmp_path: Path) -> None:
    for name in ("csv", "npz"):
        done = run(home, "export", SAMPLE, "--format", name, "--output", str(tmp_path / f"set.{name}"))
        assert done.returncode == 0, done.stderr
    frame = pd.read_csv(tmp_path / "set.csv")
    with np.load(tmp_path / "set.npz") as arrays:
        assert len(frame) == len(arrays["rewards"])
        np.testing.assert_allclose(frame["reward"], arrays["rewards"], rtol=1e-6)
        assert arrays["terminals"].sum() == 157


def test_the_card_is_one_page_and_pictures(home: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    done = run(home, "plot", SAMPLE, "--output", str(tmp_path / "card"))
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "card" / "card.html").read_text(encoding="utf-8")
    assert SAMPLE in page
    assert "http-equiv" not in page
    assert list((tmp_path / "card").glob("*.png"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("info", "pid-v9"), "unknown dataset 'pid-v9'; did you mean"),
        (("info", "../secrets"), "no dataset"),
        (("build", SAMPLE, "--shards", "0"), "must be at least 1"),
        (("build", SAMPLE, "--engine", "slurm"), "invalid choice"),
        (("export", SAMPLE, "--format", "hdf5", "--output", "x"), "invalid choice"),
        ((), "required"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(home: Path, arguments: tuple[str, ...], said: str) -> None:
    done = run(home, *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert not done.stdout


def test_publishing_writes_a_mirror_with_the_card(home: Path, tmp_path: Path) -> None:
    done = run(home, "publish", SAMPLE, "--dir", str(tmp_path / "public"), "--json")
    place = Path(json.loads(done.stdout)["folder"])
    assert place == tmp_path / "public" / SAMPLE
    assert {"manifest.json", "card.html", "coverage.png", "openml.json"} <= {path.name for path in place.iterdir()}
    fetched = run(home, "download", SAMPLE, "--source", str(tmp_path / "public"), "--json")
    assert json.loads(fetched.stdout)["hash"] == json.loads(run(home, "info", SAMPLE, "--json").stdout)["hash"]


def test_a_set_is_updated_by_a_policy_and_mirrored(home: Path, tmp_path: Path) -> None:
    """The same flights as of the catalogue's set by that policy, under other labels."""
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: pip install vvc-bench[onnx]")
    mine, image = str(tmp_path / "mine"), str(tmp_path / "mine-aug")
    made = run(home, "update", "pursuit-sample-v0", "--policy", "irpo1-seed0", "--output", mine)
    assert (made.returncode, made.stderr) == (0, "")
    same = run(home, "diff", "irpo1-sample-v0", mine, "--json")
    found = json.loads(same.stdout)
    assert found.pop("same") > 200
    assert [found[name] for name in ("gained", "lost", "shortened", "lengthened", "changed")] == [[]] * 5
    assert run(home, "mirror", mine, "--grid", "sample", "--output", image).returncode == 0
    gained = json.loads(run(home, "diff", mine, image, "--json").stdout)
    assert gained["lost"] == gained["lengthened"] == []
    assert run(home, "verify", image).returncode == 0


@pytest.mark.parametrize(
    ("policy", "name", "message"),
    [
        ("pid", "mine", "'pid' has no file whose hash a set could name"),
        ("irpo1-seed0", "My set", "'My set' is no name of a dataset"),
        ("missing.onnx", "mine", "missing.onnx"),
        ("irpo1-seed0", SAMPLE, f"{SAMPLE} is the set that it would be made from"),
    ],
)
def test_what_cannot_update_a_set_is_refused(home: Path, tmp_path: Path, policy: str, name: str, message: str) -> None:
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: pip install vvc-bench[onnx]")
    done = run(home, "update", SAMPLE, "--policy", policy, "--output", str(tmp_path / name))
    assert done.returncode == 2
    assert message in done.stderr
    assert not list(tmp_path.iterdir())
