"""One aircraft, many aircraft, and no compiler: the same bits. Bad input: refused, nothing lost."""

import itertools
import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.jit import COMPILED
from vvc_bench.sim import stepping

SETTINGS = [
    sim.Settings(control_mode=mode, dynamics=dynamics, frequency_hz=frequency)
    for mode, dynamics, frequency in itertools.product(
        ("guidance", "end_to_end"), ("reference", "accurate"), (10.0, 40.0)
    )
]
INDEX = {name: i for i, name in enumerate(sim.State._fields)}


def identifier(settings: sim.Settings) -> str:
    return f"{settings.control_mode}-{settings.dynamics}-{settings.frequency_hz:g}Hz"


def everything(count: int) -> NDArray:
    """Conditions with all that the paper leaves out, different for each aircraft."""
    rng = np.random.default_rng(5)
    return sim.make_conditions(
        wind_north_mps=rng.uniform(-20, 20, count),
        wind_east_mps=rng.uniform(-20, 20, count),
        wind_up_mps=rng.uniform(-2, 2, count),
        gust_intensity_mps=rng.uniform(0, 5, count),
        seed=np.arange(count),
        density_offset=rng.uniform(-0.1, 0.1, count),
        mass_offset=rng.uniform(-0.1, 0.1, count),
        actuator_time_constant_s=rng.uniform(0, 0.2, count),
        actuator_rate_limit_degps=rng.uniform(20, 60, count),
        engine_time_constant_s=rng.uniform(0, 2, count),
        delay_steps=rng.integers(0, 4, count),
    )


def random_commands(settings: sim.Settings, count: int, steps: int, seed: int = 0) -> NDArray:
    """Commands across their bounds and somewhat beyond, shape (steps, count, width)."""
    fields = sim.fields_of(settings.command_fields).values()
    low, high = np.array([(field.low, field.high) for field in fields]).T
    middle, reach = 0.5 * (high + low), 0.5 * (high - low)
    shape = (steps, count, settings.command_width)
    return middle + 0.6 * reach * np.random.default_rng(seed).uniform(-1, 1, shape) ** 3 * 2


def fly(settings: sim.Settings, states: NDArray, commands: NDArray, conditions: NDArray, **options: int) -> NDArray:
    for command in commands:
        states = sim.step_many(states, command, settings, conditions, **options)
    return states


@pytest.mark.parametrize("settings", SETTINGS, ids=identifier)
def test_one_is_many(settings: sim.Settings) -> None:
    conditions = everything(16)
    states = sim.start(settings, speed_mps=np.linspace(150, 300, 16), conditions=conditions)
    commands = random_commands(settings, 16, 30)
    alone = states.copy()
    for command, i in itertools.product(commands, range(16)):
        sim.step(alone[i], command[i], settings, conditions[i : i + 1], out=alone[i])
    np.testing.assert_array_equal(alone, fly(settings, states, commands, conditions))


@pytest.mark.skipif(not COMPILED, reason="compares with compiled code")
@pytest.mark.parametrize("settings", SETTINGS, ids=identifier)
def test_compiled_is_plain_python(settings: sim.Settings) -> None:
    conditions = everything(4)
    states = sim.start(settings, conditions=conditions, altitude_m=[1000, 3000, 5000, 9000])
    commands = random_commands(settings, 4, 20 if settings.dynamics == "reference" else 5)
    compiled = fly(settings, states, commands, conditions)
    plain = states.copy()
    for command in commands:
        stepping._step_rows.py_func(plain, command, conditions, settings.row, plain, 0, 4)
    np.testing.assert_array_equal(plain, compiled)


def test_batch_order_and_threads_do_not_matter() -> None:
    settings = sim.Settings()
    count = 3000
    conditions = everything(count)
    states = sim.start(settings, conditions=conditions, speed_mps=np.linspace(150, 300, count))
    commands = random_commands(settings, count, 20)
    one = fly(settings, states, commands, conditions, threads=1)
    for threads in (2, 3, 8):
        np.testing.assert_array_equal(fly(settings, states, commands, conditions, threads=threads), one)
    order = np.random.default_rng(0).permutation(count)
    shuffled = fly(settings, states[order], commands[:, order], conditions[order])
    np.testing.assert_array_equal(shuffled, one[order])
    part = slice(1234, 1241)
    np.testing.assert_array_equal(fly(settings, states[part], commands[:, part], conditions[part]), one[part])


@pytest.mark.skipif(not COMPILED, reason="about compiled code")
def test_nothing_compiles_after_the_first_call() -> None:
    settings = sim.Settings()
    sim.step(sim.start(settings), [0, 1, 0.2], settings)
    before = len(stepping._step_rows.signatures)
    for other in SETTINGS:
        conditions = everything(2)
        states = sim.start(other, conditions=conditions, altitude_m=[4000, 5000])
        fly(other, states, random_commands(other, 2, 2).astype(np.float32), conditions)
        sim.step(sim.start(other), [0] * other.command_width, other)
        sim.step(states[0], np.zeros(other.command_width, dtype=int), other)
        sim.step(np.broadcast_to(states[0], states.shape)[1], [0] * other.command_width, other)
    assert before == len(stepping._step_rows.signatures) == 1


def test_zero_conditions_change_no_bit() -> None:
    settings = sim.Settings()
    states = sim.start(settings, heading_deg=np.linspace(-180, 180, 8))
    commands = random_commands(settings, 8, 50)
    nothing = sim.make_conditions(seed=np.arange(8))
    np.testing.assert_array_equal(
        fly(settings, states, commands, nothing), fly(settings, states, commands, stepping.STILL_ROW)
    )


def test_commands_are_clipped_and_counted() -> None:
    for settings in (sim.Settings(), sim.Settings(control_mode="end_to_end")):
        fields = list(sim.fields_of(settings.command_fields).values())
        high = np.array([field.high for field in fields])
        state = sim.start(settings)
        at_bound = sim.step(state, high, settings)
        beyond = sim.step(state, high + [1.0, 0.0, np.inf, 2.0][: len(high)], settings)
        clipped = INDEX["clipped_commands"]
        assert at_bound[clipped] == 0
        assert beyond[clipped] == len(high) - 1
        np.testing.assert_array_equal(np.delete(at_bound, clipped), np.delete(beyond, clipped))


def test_out_may_be_the_input() -> None:
    settings = sim.Settings()
    conditions = everything(8)
    states = sim.start(settings, conditions=conditions)
    commands = random_commands(settings, 8, 5)
    expected = fly(settings, states, commands, conditions)
    for command in commands:
        assert sim.step_many(states, command, settings, conditions, out=states) is states
    np.testing.assert_array_equal(states, expected)


@pytest.mark.parametrize("many", [False, True])
def test_nan_commands_are_refused_and_nothing_is_lost(many: bool) -> None:
    settings = sim.Settings()
    states = sim.start(settings, heading_deg=np.zeros(700))
    commands = random_commands(settings, 700, 1)[0]
    commands[650, 1] = np.nan
    before = states.copy()
    step, which = (sim.step_many, slice(None)) if many else (sim.step, 650)
    with pytest.raises(ValueError, match=r"'load_factor' of aircraft \d+ is NaN"):
        step(states[which], commands[which], settings, out=states[which])
    np.testing.assert_array_equal(states, before)


@pytest.mark.parametrize(
    ("states", "commands", "conditions", "out"),
    [
        ((5, 42), (5, 4), (1, 12), (5, 42)),
        ((5, 42), (4, 3), (1, 12), (5, 42)),
        ((5, 41), (5, 3), (1, 12), (5, 41)),
        ((5, 42), (5, 3), (2, 12), (5, 42)),
        ((5, 42), (5, 3), (5, 11), (5, 42)),
        ((5, 42), (5, 3), (1, 12), (5, 43)),
        ((42,), (3,), (1, 12), (42,)),
    ],
)
def test_wrong_shapes_are_refused(states: tuple, commands: tuple, conditions: tuple, out: tuple) -> None:
    with pytest.raises(ValueError, match="for N aircraft, states and out must be"):
        sim.step_many(np.zeros(states), np.zeros(commands), sim.Settings(), np.zeros(conditions), out=np.zeros(out))


def test_one_aircraft_wrong_shapes_are_refused() -> None:
    settings = sim.Settings()
    state = sim.start(settings)
    for command in ([0.0, 1.0], [0.0, 1.0, 0.2, 0.0], [[0.0, 1.0, 0.2]]):
        with pytest.raises(ValueError, match="for N aircraft"):
            sim.step(state, command, settings)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control_mode": "autopilot"}, "control_mode must be one of"),
        ({"dynamics": "exact"}, "dynamics must be one of"),
        ({"frequency_hz": 0.5}, "frequency_hz must lie in"),
        ({"frequency_hz": 200}, "frequency_hz must lie in"),
        ({"frequency_hz": float("nan")}, "frequency_hz must lie in"),
    ],
)
def test_impossible_settings_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sim.Settings(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"altitude_m": np.nan}, "altitude_m must be a finite number"),
        ({"altitude_m": [1000, 2000], "speed_mps": [200, 210, 220]}, "must have one length"),
        ({"altitude_m": 12000, "speed_mps": 60}, "no trim at 12000 m and 60 m/s: no angle of attack"),
        ({"altitude_m": 0, "speed_mps": 400}, "of full thrust"),
    ],
)
def test_impossible_starts_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sim.start(sim.Settings(), **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"airspeed": 200}, "unknown state 'airspeed'; known are airspeed_mps"),
        ({"altitude_m": 100}, "airspeed_mps must be given and positive"),
        ({"airspeed_mps": 200, "roll_deg": np.inf}, "roll_deg must be a finite number"),
    ],
)
def test_impossible_states_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sim.start_from(sim.Settings(), **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"wind_mps": 3}, "unknown condition 'wind_mps'"),
        ({"mass_offset": -1.5}, r"mass_offset must lie in \[-0.9, 10\], got -1.5"),
        ({"delay_steps": 0.5}, "delay_steps must be a whole number"),
        ({"gust_intensity_mps": [1, 2], "seed": [1, 2, 3]}, "must have one length"),
    ],
)
def test_impossible_conditions_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sim.make_conditions(**arguments)


@pytest.mark.skipif(not COMPILED, reason="Python's own math.cos raises for infinity; compiled code gives NaN")
def test_wild_states_do_not_raise() -> None:
    settings = sim.Settings(control_mode="end_to_end")
    rng = np.random.default_rng(3)
    states = sim.start(settings, heading_deg=np.zeros(200))
    states += rng.normal(size=states.shape) * 10.0 ** rng.uniform(-3, 12, states.shape)
    states[:3] = np.array([np.nan, np.inf, 0.0])[:, None]
    for command in random_commands(settings, 200, 20):
        states = sim.step_many(states, command, settings)
    assert states.shape == (200, len(sim.State._fields))


def test_rows_and_fields_agree() -> None:
    from vvc_bench.sim.rows import load_conditions, load_state, store_state

    row = np.arange(len(sim.State._fields), dtype=float)[None]
    assert load_state(row, 0) == sim.State(*row[0])
    stored = np.zeros_like(row)
    store_state(sim.State(*row[0]), stored, 0)
    np.testing.assert_array_equal(stored, row)
    row = np.arange(len(sim.Conditions._fields), dtype=float)[None]
    assert load_conditions(row, 0) == sim.Conditions(*row[0])


WITHOUT_COMPILER = """
from vvc_bench import jit, sim
assert not jit.COMPILED
settings = sim.Settings()
state = sim.start(settings)
for _ in range(5):
    state = sim.step(state, [0.3, 1.5, 0.4], settings)
print(state.tobytes().hex())
import sys
assert "numba" not in sys.modules
"""


def test_without_the_compiler_the_bits_are_the_same() -> None:
    environment = os.environ | {"VVC_BENCH_JIT": "0"}
    command = [sys.executable, "-c", WITHOUT_COMPILER]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    settings = sim.Settings()
    state = sim.start(settings)
    for _ in range(5):
        state = sim.step(state, [0.3, 1.5, 0.4], settings)
    assert run.stdout.strip() == state.tobytes().hex()
