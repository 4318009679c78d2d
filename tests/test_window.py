"""``render_mode="human"``: a window that shows the flight by itself, on a virtual display where Xvfb is installed."""

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator

import pytest

SHOWN = """
import gymnasium, numpy as np, vvc_bench
import matplotlib.pyplot as plt
from vvc_bench.envs.rendering import draw_frame
environment = gymnasium.make("VVC/Hard-v0", render_mode="human", frequency_hz=1, step_limit=2)
assert environment.unwrapped.metadata["render_fps"] == 1

def shown():
    (number,) = plt.get_fignums()
    return plt.figure(number).axes[0].images[0].get_array()

def expected():
    return draw_frame(environment.unwrapped.flight)

environment.reset(seed=0)
np.testing.assert_array_equal(shown(), expected())
environment.step([10.0, 1.5, 0.5])
environment.step([10.0, 1.5, 0.5])  # the last, which is not left out
np.testing.assert_array_equal(shown(), expected())
environment.close()
assert plt.get_fignums() == []
"""
NOT_SHOWN = """
import gymnasium, vvc_bench
gymnasium.make("VVC/Hard-v0", render_mode="human").reset()
"""


def python(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(
        [sys.executable, "-c", program], env=known | environment, capture_output=True, text=True, check=False
    )


@pytest.fixture
def display() -> Iterator[str]:
    reading, writing = os.pipe()
    options = ["-displayfd", str(writing), "-screen", "0", "1280x800x24"]
    with subprocess.Popen(["Xvfb", *options], pass_fds=[writing], stderr=subprocess.DEVNULL) as server:
        os.close(writing)
        with os.fdopen(reading) as told:
            yield f":{told.readline().strip()}"
        server.terminate()


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="Xvfb is not installed: apt-get install xvfb")
@pytest.mark.skipif(importlib.util.find_spec("_tkinter") is None, reason="this Python has no tkinter")
def test_reset_and_step_show_the_flight(display: str) -> None:
    ran = python(SHOWN, DISPLAY=display, MPLBACKEND="tkagg")
    assert (ran.returncode, ran.stdout) == (0, ""), ran.stderr


def test_without_a_display_it_says_what_to_do() -> None:
    ran = python(NOT_SHOWN, MPLBACKEND="agg")
    assert ran.returncode == 1
    assert "needs a display and an interactive matplotlib backend, not 'agg'; use render_mode='rgb_array'" in ran.stderr
