"""The compiler's cache: quick the second time, and never stale."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vvc_bench
from vvc_bench.jit import COMPILED

pytestmark = pytest.mark.skipif(not COMPILED, reason="about compiled code")

PACKAGE = Path(vvc_bench.__file__).parent

FLY = """
from vvc_bench import sim
settings = sim.Settings(control_mode="end_to_end")
state = sim.start_from(settings, airspeed_mps=200, altitude_m=5000)
state = sim.step(state, [0, 0, 0, 1], settings)
from vvc_bench.sim.stepping import _step_rows
print(sim.State(*state).load_factor_x, sum(_step_rows.stats.cache_hits.values()))
"""


def fly(folder: Path, home: Path) -> tuple[float, int]:
    """Load factor along x at full throttle in a fresh process, and whether it came from the cache."""
    environment = os.environ | {"PYTHONPATH": str(folder), "VVC_BENCH_HOME": str(home)}
    run = subprocess.run(
        [sys.executable, "-c", FLY], env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    load_factor, hits = run.stdout.split()
    return float(load_factor), int(hits)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The package's own copy in a folder that may be edited."""
    shutil.copytree(PACKAGE, tmp_path / "copy" / "vvc_bench", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "copy"


@pytest.mark.slow
def test_an_edited_kernel_is_never_served_stale(copy: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    before, hits = fly(copy, home)
    assert hits == 0
    assert fly(copy, home) == (before, 1)

    engine = copy / "vvc_bench" / "sim" / "propulsion.py"
    engine.write_text(engine.read_text().replace("1.26 * MASS", "1.36 * MASS"))
    after, hits = fly(copy, home)
    assert hits == 0
    assert after > before + 0.05

    table = copy / "vvc_bench" / "sim" / "data" / "alpha.csv"
    stamp = table.stat()
    table.write_text(table.read_text().replace("0.953", "9.953"))
    os.utime(table, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert fly(copy, home)[1] == 0


def test_without_a_place_for_the_cache_it_still_flies(copy: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert fly(copy, blocked)[1] == 0
