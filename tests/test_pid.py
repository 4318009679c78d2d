"""The guidance law: Appendix C's figures as measured, its symmetry, its twins, and what it reaches."""

import itertools
import math

import numpy as np
import pytest

from vvc_bench import sim
from vvc_bench.experts import (
    APPENDIX_C,
    WEIGHT_COMPENSATED,
    Goal,
    PidParameters,
    pid_command,
    pid_commands,
)
from vvc_bench.experts.pid import load_factor_limit
from vvc_bench.goals import check_goals
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.fields import field_array
from vvc_bench.sim.task import Task, direction_error
from vvc_bench.sim.units import DEGREES_PER_RADIAN

SETTINGS = sim.Settings()
NORTH = Goal(200.0, 0.0, 0.0)


def goal_of(speed_mps, path_angle_deg, azimuth_deg):
    return Goal(speed_mps, path_angle_deg / DEGREES_PER_RADIAN, azimuth_deg / DEGREES_PER_RADIAN)


def command_at(goal, parameters=APPENDIX_C, **state):
    """The command in trimmed level flight to the north at 200 m/s and 5000 m, with some of the state changed."""
    row = sim.State(*sim.start(SETTINGS))._replace(**state)
    return sim.GuidanceCommand(*pid_commands(np.array([row]), [goal], parameters)[0])


def random_rows(count, seed=0):
    """States far and wide, as rows, and goals."""
    random = np.random.default_rng(seed)
    rows = np.tile(sim.start(SETTINGS), (count, 1))
    draws = {
        "airspeed": random.uniform(80, 400, count),
        "altitude": random.uniform(0, 12000, count),
        "roll": random.uniform(-math.pi, math.pi, count),
        "roll_rate": random.uniform(-3, 3, count),
        "path_angle": random.uniform(-1.5, 1.5, count),
        "azimuth": random.uniform(-math.pi, math.pi, count),
    }
    draws["speed"] = draws["airspeed"] + random.uniform(-20, 20, count)
    for name, values in draws.items():
        rows[:, sim.State._fields.index(name)] = values
    goals = np.stack([random.uniform(low, high, count) for low, high in ((100, 300), (-1.5, 1.5), (-3, 3))], axis=-1)
    return rows, goals


def reached(goals, parameters, steps=400):
    """Whether each flight from the paper's start had been in the task's bands long enough."""
    task = Task()
    states = np.tile(sim.start(SETTINGS), (len(goals), 1))
    run, done, alive = np.zeros(len(goals)), np.zeros(len(goals), bool), np.ones(len(goals), bool)
    for _ in range(steps):
        states = sim.step_many(states, pid_commands(states, goals, parameters), SETTINGS)
        state = sim.State(*states.T)
        wanted = Goal(*goals.T)
        cosine = np.sin(state.path_angle) * np.sin(wanted.path_angle) + np.cos(state.path_angle) * np.cos(
            wanted.path_angle
        ) * np.cos(state.azimuth - wanted.azimuth)
        near = (np.abs(state.speed - wanted.speed) < task.speed_band) & (cosine > math.cos(task.direction_band))
        alive &= state.altitude >= 0.0
        run = np.where(near, run + 1, 0)
        done |= alive & (run >= task.reach_steps)
    return done, states


# Figures measured on the paper's expert at 200 m/s and 5000 m (model.md, "Guidance expert (Appendix C)")


@pytest.mark.parametrize(
    ("turn_deg", "roll_rate_degps"), [(0, 0.0), (5, 23.007), (10, 40.339), (-10, -40.339), (90, 150)]
)
def test_roll_rate_is_the_experts(turn_deg, roll_rate_degps):
    assert command_at(goal_of(200, 0, turn_deg)).roll_rate * DEGREES_PER_RADIAN == pytest.approx(
        roll_rate_degps, abs=0.02
    )


@pytest.mark.parametrize(
    ("climb_deg", "turn_deg", "load_factor"), [(0, 0, 1.0), (5, 0, 1.9926), (0, 5, 1.0864), (0, 10, 1.3119)]
)
def test_load_factor_is_the_experts(climb_deg, turn_deg, load_factor):
    assert command_at(goal_of(200, climb_deg, turn_deg)).load_factor == pytest.approx(load_factor, abs=5e-3)


@pytest.mark.parametrize(
    ("speed_mps", "altitude_m", "load_factor"),
    [
        *((150, 5000, 1.5), (200, 5000, 2.51), (250, 5000, 4.08), (300, 5000, 5.30)),
        *((200, 0, 5.0), (200, 3000, 3.5), (200, 8000, 1.5), (200, 12000, 1.5)),
    ],
)
def test_load_factor_limit_is_the_experts(speed_mps, altitude_m, load_factor):
    density = air_at(altitude_m, 1.0).density
    assert load_factor_limit(speed_mps, density) == pytest.approx(load_factor, abs=0.02)
    command = command_at(goal_of(200, 80, 0), speed=float(speed_mps), altitude=float(altitude_m))
    assert command.load_factor == pytest.approx(load_factor, abs=0.02)


def test_the_limit_holds_for_pushing_too():
    assert command_at(goal_of(200, -80, 0)).load_factor == pytest.approx(-2.51, abs=0.02)
    least = sim.fields_of(sim.GuidanceCommand)["load_factor"].low
    assert command_at(goal_of(200, -80, 0), speed=300.0, altitude=0.0).load_factor == least


@pytest.mark.parametrize(("roll_rate", "expected_degps"), [(0.0, -50.0), (2.0, -150.0), (-2.0, -50.0)])
def test_roll_rate_is_full_where_the_bank_will_be_far_off(roll_rate, expected_degps):
    """At ε = −50°, a roll to the right adds 0.1 s · p to how far off it will be."""
    command = command_at(NORTH, roll=50.0 / DEGREES_PER_RADIAN, roll_rate=roll_rate)
    assert command.roll_rate * DEGREES_PER_RADIAN == pytest.approx(expected_degps)


@pytest.mark.parametrize(("missing_mps", "throttle"), [(0, 0.002), (10, 0.502), (50, 1.0), (-10, 0.0)])
def test_throttle(missing_mps, throttle):
    assert command_at(goal_of(200 + missing_mps, 0, 0)).throttle == pytest.approx(throttle)


def test_weight_compensation_adds_the_weight_along_the_path_and_nothing_in_level_flight():
    assert command_at(NORTH, WEIGHT_COMPENSATED) == command_at(NORTH)
    state = sim.State(*sim.start(SETTINGS))
    full_thrust = state.thrust / state.throttle
    expected = 0.002 + 9295.44 * 9.81 * math.sin(0.3) / full_thrust
    assert command_at(Goal(200.0, 0.3, 0.0), WEIGHT_COMPENSATED).throttle == pytest.approx(expected)


@pytest.mark.parametrize("side", [1, -1])
def test_it_turns_to_the_side_of_the_goal_by_the_shorter_way(side):
    assert side * command_at(goal_of(200, 0, 30 * side)).roll_rate > 0.0
    # From an azimuth of 170°, −160° lies 30° to the right.
    there = command_at(goal_of(200, 0, -160 * side), azimuth=side * 170 / DEGREES_PER_RADIAN)
    assert side * there.roll_rate > 0.0


# Symmetry, twins, totality


@pytest.mark.parametrize("parameters", [APPENDIX_C, WEIGHT_COMPENSATED])
def test_the_mirrored_flight_gets_the_mirrored_command(parameters):
    states, goals = random_rows(500)
    mirror_state, mirror_goal, mirror_command = (
        field_array(kind, "mirror") for kind in (sim.State, Goal, sim.GuidanceCommand)
    )
    expected = pid_commands(states, goals, parameters) * mirror_command
    mirrored = pid_commands(states * mirror_state, goals * mirror_goal, parameters)
    np.testing.assert_array_equal(mirrored, expected)
    assert (np.abs(expected[:, 0]) > 0.1).mean() > 0.9  # and it is not for want of commands


def test_many_is_one_is_uncompiled():
    states, goals = random_rows(50)
    many = pid_commands(states, goals, WEIGHT_COMPENSATED)
    for row, goal, command in zip(states, goals, many, strict=True):
        np.testing.assert_array_equal(pid_commands(row[None], goal[None], WEIGHT_COMPENSATED)[0], command)
        plain = pid_command(sim.State(*row.tolist()), Goal(*goal.tolist()), WEIGHT_COMPENSATED)
        np.testing.assert_allclose(plain, command, rtol=1e-13, atol=1e-13)


def test_commands_stay_in_bounds_in_any_state():
    states, goals = random_rows(200)
    states[:50] *= 1e6
    states[50:100] = np.nan
    states[100:150] = np.inf
    low, high = (field_array(sim.GuidanceCommand, bound) for bound in ("low", "high"))
    commands = pid_commands(states, goals)
    assert ((commands >= low) & (commands <= high)).all()


def test_rows_may_hold_commands_on_their_way():
    conditions = sim.make_conditions(delay_steps=3)
    row = sim.start(SETTINGS, conditions=conditions)
    assert len(row) > len(sim.State._fields)
    np.testing.assert_array_equal(
        pid_commands(row[None], [NORTH]), pid_commands(row[None, : len(sim.State._fields)], [NORTH])
    )


# What it reaches


def test_a_compensated_climbing_turn_arrives_and_the_papers_settles_slow():
    goals = np.array([goal_of(220, 20, -60)])
    assert reached(goals, WEIGHT_COMPENSATED)[0].all()
    done, states = reached(goals, APPENDIX_C)
    final = sim.State(*states[0])
    assert not done.any()
    assert 220.0 - final.speed == pytest.approx(12.5, abs=0.5)  # as the paper's expert: 207.4 m/s after 40 s
    assert direction_error(final.path_angle, final.azimuth, Goal(*goals[0])) < math.radians(0.1)


def test_share_of_goals_reached():
    random = np.random.default_rng(0)
    ranges = ((100, 300), (-85, 85), (-170, 170))
    goals = np.stack([random.uniform(low, high, 500) for low, high in ranges], axis=-1)
    goals[:, 1:] /= DEGREES_PER_RADIAN
    appendix_c, compensated = (reached(goals, parameters)[0].mean() for parameters in (APPENDIX_C, WEIGHT_COMPENSATED))
    assert 0.15 < appendix_c < 0.26  # model.md: 15–26 %
    assert compensated > appendix_c + 0.1


# Bad input


@pytest.mark.parametrize(
    ("states", "goals", "parameters", "message"),
    [
        (np.zeros(42), [[200.0, 0.0, 0.0]], APPENDIX_C, r"states must be \(N, 42\)"),
        (np.zeros((2, 41)), np.zeros((2, 3)), APPENDIX_C, r"got states \(2, 41\)"),
        (np.zeros((2, 42)), np.zeros((1, 3)), APPENDIX_C, r"goals \(1, 3\)"),
        (np.zeros((1, 42)), [[200.0, math.nan, 0.0]], APPENDIX_C, r"path_angle_deg must be .*\[-90, 90\], got nan"),
        (np.zeros((1, 42)), [[200.0, 0.0, 3.2]], APPENDIX_C, r"azimuth_deg must be .*\[-180, 180\], got 183\.3"),
        (np.zeros((1, 42)), [[math.inf, 0.0, 0.0]], APPENDIX_C, "speed_mps must be a finite number"),
        (
            np.zeros((1, 42)),
            [NORTH],
            PidParameters(azimuth_time_constant=0.0),
            "azimuth_time_constant must be positive",
        ),
        (np.zeros((1, 42)), [NORTH], PidParameters(speed_gain=math.nan), "parameters must be finite"),
    ],
)
def test_bad_input_is_named(states, goals, parameters, message):
    with pytest.raises(ValueError, match=message):
        pid_commands(states, goals, parameters)


def test_the_ends_of_a_goals_range_belong_to_it():
    for signs in itertools.product((1, -1), repeat=2):
        check_goals(np.array([0.0, signs[0] * 90 / DEGREES_PER_RADIAN, signs[1] * 180 / DEGREES_PER_RADIAN]))
