"""The reference dynamics against the closed binaries: recorded everywhere, live where `flycraft` is installed."""

import importlib.util
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from record_reference import (
    ENVELOPE,
    LAW_INPUT,
    RECORDINGS,
    REPORT_EVERY,
    Recording,
    record_closed_loop,
    record_control_law,
    record_open_loop,
    record_single_steps,
)
from reference_binary import REPORTED, scratch_folder

from vvc_bench import sim

STATE_COLUMNS = sim.columns(sim.State)
NAMES = list(STATE_COLUMNS)
SCALE = np.array([field.unit.scale for field in STATE_COLUMNS.values()])
REPORTED_INDEX = [NAMES.index(name) for name in REPORTED.values()]
IS_ANGLE = np.array([name.endswith("_deg") for name in REPORTED.values()])


def outside(states: NDArray) -> NDArray:
    """The reported quantities, in the reference's units and order."""
    return (states[..., : len(NAMES)] * SCALE)[..., REPORTED_INDEX]


def deviation(ours: NDArray, theirs: NDArray) -> NDArray:
    difference = np.abs(ours - theirs)
    wrapped = np.minimum(difference, np.abs(difference - 360.0))
    return np.where(IS_ANGLE, wrapped, difference)


def inside(commands: NDArray, settings: sim.Settings) -> NDArray:
    fields = sim.columns(settings.command_fields).values()
    return commands / [field.unit.scale for field in fields]


def fly(settings: sim.Settings, commands: NDArray) -> NDArray:
    """Reported quantities of N flights from trim, shape (N, steps, quantity)."""
    states = sim.start(settings, altitude_m=np.full(len(commands), 5000.0))
    reports = []
    for command in np.moveaxis(inside(commands, settings), 1, 0):
        states = sim.step_many(states, command, settings)
        reports.append(outside(states))
    return np.stack(reports, axis=1)


@pytest.fixture(params=["recorded", "live"])
def reference(request: pytest.FixtureRequest) -> Callable[[str], Recording]:
    """A recording by name: from the committed file, or made now and larger."""
    if request.param == "recorded":
        with np.load(RECORDINGS) as file:
            arrays = dict(file)
        return lambda name: {key.split("/")[1]: array for key, array in arrays.items() if key.startswith(name)}
    if importlib.util.find_spec("flycraft") is None:
        pytest.skip("flycraft is not installed: pip install vvc-bench[reference] (Linux or Windows, x86-64)")
    live = {
        "single_steps": lambda: record_single_steps(2000),
        "control_law": lambda: record_control_law(60),
        "open_loop": lambda: record_open_loop(50),
        "closed_loop": lambda: record_closed_loop(50),
    }

    def record(name: str) -> Recording:
        with scratch_folder():
            return live[name]()

    return record


def test_single_steps_over_the_whole_envelope(reference: Callable[[str], Recording]) -> None:
    recording = reference("single_steps")
    settings = sim.Settings(control_mode="end_to_end")
    given = dict(zip(ENVELOPE, recording["states"].T, strict=True))
    frozen = sim.make_conditions(actuator_rate_limit_degps=1e-12)  # so that deflections beyond the bounds stay
    given["aileron_deg"] = np.clip(given["aileron_deg"], -21.5, 21.5)  # the binaries clip this one themselves
    states = sim.start_from(settings, conditions=frozen, **given)
    commands = np.stack([states[:, sim.State._fields.index(name)] for name in sim.SurfaceCommand._fields], axis=-1)

    ours = outside(sim.step_many(states, commands, settings, frozen))

    scale = np.abs(recording["reports"]).max(axis=0)
    assert np.max(deviation(ours, recording["reports"]) / scale) < 1e-9


def test_control_law(reference: Callable[[str], Recording]) -> None:
    recording = reference("control_law")
    worst = 0.0
    index = {name: sim.State._fields.index(name) for name in ("load_factor", "load_factor_integral")}
    controls = [sim.State._fields.index(name) for name in sim.SurfaceCommand._fields]
    for frequency in np.unique(recording["frequencies"]):
        chosen = recording["frequencies"] == frequency
        settings = sim.Settings(frequency_hz=frequency)
        inputs, commands = recording["inputs"][chosen], inside(recording["commands"][chosen], settings)
        memory = np.zeros((chosen.sum(), 2))
        for k in range(inputs.shape[1]):
            given = dict(zip(LAW_INPUT, inputs[:, k].T, strict=True))
            load_factor = given.pop("load_factor_g")
            states = sim.start_from(settings, **given)
            states[:, index["load_factor"]] = load_factor
            states[:, sim.State._fields.index("steps")] = k
            states[:, index["load_factor_integral"] :][:, :2] = memory
            states = sim.step_many(states, commands[:, k], settings)
            memory = states[:, index["load_factor_integral"] :][:, :2].copy()
            ours = states[:, controls] * SCALE[controls]
            worst = max(worst, np.abs(ours - recording["outputs"][chosen, k]).max())
    assert worst < 1e-11


def test_open_loop_violent_motion(reference: Callable[[str], Recording]) -> None:
    recording = reference("open_loop")
    ours = fly(sim.Settings(control_mode="end_to_end"), recording["commands"])
    largest = deviation(ours, recording["reports"]).max(axis=(1, 2))
    assert np.median(largest) < 1e-6


def test_closed_loop_moderate_commands(reference: Callable[[str], Recording]) -> None:
    recording = reference("closed_loop")
    ours = fly(sim.Settings(control_mode="guidance"), recording["commands"])[:, REPORT_EVERY - 1 :: REPORT_EVERY]
    largest = deviation(ours, recording["reports"]).max(axis=(1, 2))
    assert np.median(largest) < 1e-5


def test_trim_of_the_default_start() -> None:
    state = sim.start(sim.Settings())
    report = dict(zip(NAMES, state * SCALE, strict=True))
    assert report["angle_of_attack_deg"] == pytest.approx(2.613220523094039, abs=1e-9)
    assert report["pitch_deg"] == pytest.approx(2.613220523094039, abs=1e-9)
    assert report["elevator_deg"] == pytest.approx(-1.327651593874395, abs=1e-9)
    assert report["thrust_n"] == pytest.approx(11390.330633921192, rel=1e-9)
    assert report["load_factor_g"] == pytest.approx(0.998960076119232, abs=1e-9)
