"""Sets made from their specifications: the same bytes, however they are made."""

import dataclasses
import hashlib
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vvc_bench.datasets.build import build_dataset
from vvc_bench.datasets.catalogue import CATALOGUE, Specification, Updated
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.merge import update
from vvc_bench.datasets.mirror import fly_under, mirror
from vvc_bench.datasets.store import open_dataset
from vvc_bench.datasets.verify import fly_again

SAMPLE = CATALOGUE["pid-sample-v0"]

BUILD = """
import sys
from pathlib import Path
from vvc_bench.datasets.build import build_dataset
from vvc_bench.datasets.catalogue import CATALOGUE
build_dataset(CATALOGUE["pid-sample-v0"], Path(sys.argv[1]), find_parent=print, shards=45,
              progress=lambda done, goals: print(done, flush=True))
"""


def no_parent(name: str) -> Dataset:
    raise AssertionError(f"asked for {name}")


def fingerprints(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def make(folder: Path, specification: Specification = SAMPLE, **options: object) -> dict[str, str]:
    build_dataset(specification, folder, find_parent=no_parent, **options)
    return fingerprints(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "pid-sample-v0"
    make(folder)
    return folder


@pytest.mark.parametrize("options", [{"threads": 1}, {"threads": 2}, {"shards": 1}, {"shards": 7}])
def test_threads_and_shards_change_no_byte(made: Path, tmp_path: Path, options: dict[str, int]) -> None:
    assert make(tmp_path / made.name, **options) == fingerprints(made)
    assert [path.name for path in tmp_path.iterdir()] == [made.name]


def test_a_build_that_was_killed_goes_on_where_it_stopped(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / made.name
    with subprocess.Popen([sys.executable, "-c", BUILD, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if int(line) >= 20:
                process.send_signal(signal.SIGKILL)
                break
    assert not folder.exists()
    (working,) = tmp_path.iterdir()
    done_before = len([path for path in (working / "shards").iterdir() if not path.name.startswith(".")])
    assert 0 < done_before < 45
    steps: list[int] = []
    build_dataset(SAMPLE, folder, find_parent=no_parent, shards=45, progress=lambda done, _: steps.append(done))
    assert steps[0] >= 7 * done_before
    assert fingerprints(folder) == fingerprints(made)
    assert not working.exists()


def test_a_damaged_shard_is_flown_again(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / made.name
    process = subprocess.Popen([sys.executable, "-c", BUILD, str(folder)], stdout=subprocess.PIPE, text=True)
    while int(process.stdout.readline()) < 20:
        pass
    process.kill()
    process.communicate()
    (working,) = tmp_path.iterdir()
    victim = next(iter(sorted(working.glob("shards/0*")))) / "transitions-00000.parquet"
    content = bytearray(victim.read_bytes())
    content[len(content) // 2] ^= 1
    victim.write_bytes(content)
    assert make(folder, shards=45) == fingerprints(made)


def test_two_builders_at_once_make_one_set(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / made.name
    builders = [
        subprocess.Popen([sys.executable, "-c", BUILD, str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    errors = [builder.communicate()[1].decode() for builder in builders]
    assert [builder.returncode for builder in builders] == [0, 0], errors
    assert fingerprints(folder) == fingerprints(made)


def test_a_set_says_what_it_is_and_flies_again(made: Path) -> None:
    made_set = open_dataset(made)
    manifest = made_set.manifest
    assert manifest["specification"] == SAMPLE.to_json()
    assert manifest["counts"]["goals_flown"] == 315
    assert sum(manifest["last_events"].values()) == 315
    assert manifest["last_events"]["reach_target"] == len(made_set)
    assert manifest["metrics"]["table_1"]["trajectories"] == len(made_set)
    assert fly_again(made_set.read()).passed


def test_mirrored_sets_have_their_parents(made: Path, tmp_path: Path) -> None:
    parent = open_dataset(made)
    build_dataset(CATALOGUE["pid-aug-sample-v0"], tmp_path / "aug", find_parent=lambda _: parent)
    augmented = open_dataset(tmp_path / "aug")
    assert augmented.manifest["parents"] == {"pid-sample-v0": parent.hash}
    expected = update(parent.read(), mirror(parent.read()))
    np.testing.assert_array_equal(augmented.read().actions, expected.episodes.actions)
    report = augmented.manifest["metrics"]["mirror"]
    assert (report["new_goals"], report["shorter"]) == (expected.new, expected.shorter)
    assert fly_again(augmented.read()).passed


def test_over_ray_the_bytes_are_the_same(made: Path, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed: pip install vvc-bench[ray]")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        assert make(tmp_path / made.name, engine="ray", shards=5, threads=1) == fingerprints(made)
    finally:
        ray.shutdown()


def test_a_policy_of_the_package_makes_its_set(tmp_path: Path) -> None:
    sample = CATALOGUE["irpo1-sample-v0"]
    assert isinstance(sample.recipe, Updated)
    make(tmp_path / "pursuit", CATALOGUE["pursuit-sample-v0"])
    parent = open_dataset(tmp_path / "pursuit")
    build_dataset(sample, tmp_path / "irpo", find_parent={"pursuit-sample-v0": parent}.__getitem__)
    stored = open_dataset(tmp_path / "irpo")
    assert stored.manifest["parents"] == {parent.name: parent.hash}
    flights = stored.where(source=f"irpo1-sample-v0/{sample.recipe.policies[0]}")
    assert len(flights) > len(stored) / 2
    assert len(stored) > len(fly_under(parent.read(), sample.scenario))
    assert fly_again(stored.read()).passed


def test_what_cannot_be_built_is_refused(tmp_path: Path) -> None:
    sample = CATALOGUE["irpo1-sample-v0"]
    assert isinstance(sample.recipe, Updated)
    other = dataclasses.replace(sample, recipe=dataclasses.replace(sample.recipe, policies=("sha256:00",)))
    with pytest.raises(ValueError, match="no policy of the package has the SHA-256 00"):
        make(tmp_path / "x", other)
    with pytest.raises(ValueError, match="shards must be 1 to 315, the number of goals; got 0"):
        make(tmp_path / "x", shards=0)
    with pytest.raises(ValueError, match="engine must be one of local, ray; got 'slurm'"):
        make(tmp_path / "x", engine="slurm")
    assert not list(tmp_path.iterdir())
