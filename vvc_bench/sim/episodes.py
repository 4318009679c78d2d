"""Episodes of many aircraft at once: fly a step, judge it, observe it, in one compiled loop.

One call moves every aircraft by one time step and writes what a learner sees. Actions, observations and goals are in
the units of the outside world here (degrees, m/s, m, g); goals inside are `Goal` rows in SI units.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vvc_bench.jit import entry_point, inlined, kernel
from vvc_bench.sim.fields import Conditions, Goal, GuidanceCommand, Observation, State, SurfaceCommand, field_array
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.random_numbers import standard_normals
from vvc_bench.sim.rows import load_conditions, load_goal, load_memory, load_state, load_task, store_memory
from vvc_bench.sim.stepping import Scheme, advance_row, load_scheme
from vvc_bench.sim.task import (
    Memory,
    Task,
    as_seen,
    direction_error,
    distance_reward,
    fresh_memory,
    has_diverged,
    judge,
    judge_demonstration,
    judge_diverged,
    judge_publicly,
    wrapped,
)
from vvc_bench.sim.units import DEGREES_PER_RADIAN

_GUIDANCE_SCALE = field_array(GuidanceCommand, "scale")
_SURFACE_SCALE = field_array(SurfaceCommand, "scale")
_SCALE = field_array(Observation, "scale")
_LOW, _HIGH, _NOISE = (field_array(Observation, attribute) * _SCALE for attribute in ("low", "high", "noise"))
_NOISE_STREAM = 1 << 40  # counters from here on belong to the sensors, below to the gusts
_SENSORS = len(Observation._fields)
_GOALS = len(Goal._fields)
_FIRST_GOAL = Observation._fields.index(Goal._fields[0])
_MEMORY = len(Memory._fields)
_ROLL, _CLIPPED = (State._fields.index(name) for name in ("roll", "clipped_commands"))

REPORT = (
    *("reward", "speed_error_mps", "path_angle_error_deg", "azimuth_error_deg", "direction_error_deg"),
    *("load_factor_g", "clipped_commands", "steps"),
)
"""Columns of the report that `fly_rows` writes: the step's reward, errors (goal less achieved; the direction error is
an angle; NaN where a state has diverged), load factor, components of the command clipped in this step, and steps of the
episode so far."""


@kernel
def observe(
    state: State, conditions: Conditions, observations: NDArray[np.float32], achieved: NDArray[np.float32], i: int
) -> None:
    """Write what is seen of a state: `Observation`, clipped to its bounds, and the achieved goal, with sensor noise."""
    observations[i, 0] = state.roll * _SCALE[0]
    observations[i, 1] = state.pitch * _SCALE[1]
    observations[i, 2] = state.yaw * _SCALE[2]
    observations[i, 3] = state.speed * _SCALE[3]
    observations[i, 4] = state.path_angle * _SCALE[4]
    observations[i, 5] = state.azimuth * _SCALE[5]
    observations[i, 6] = state.roll_rate * _SCALE[6]
    observations[i, 7] = state.altitude * _SCALE[7]
    if conditions.sensor_noise > 0.0:
        counter = _NOISE_STREAM + _SENSORS * int(state.steps)
        for k in range(_SENSORS):
            error, _ = standard_normals(int(conditions.seed), counter + k)
            observations[i, k] += conditions.sensor_noise * _NOISE[k] * error
    for k in range(_SENSORS):
        observations[i, k] = clip(observations[i, k], _LOW[k], _HIGH[k])
    for k in range(_GOALS):
        achieved[i, k] = observations[i, _FIRST_GOAL + k]


@inlined
def fly_row(
    rows: NDArray[np.float64],
    memories: NDArray[np.float64],
    goals: NDArray[np.float64],
    commands: NDArray[np.float64],
    conditions: Conditions,
    scheme: Scheme,
    task: Task,
    observations: NDArray[np.float32],
    achieved: NDArray[np.float32],
    report: NDArray[np.float64],
    events: NDArray[np.int64],
    i: int,
) -> None:
    """Fly row i one step under ``commands[i]``, judge it and observe it, in place."""
    goal, memory = load_goal(goals, i), load_memory(memories, i)
    roll_before, clipped_before = rows[i, _ROLL], rows[i, _CLIPPED]
    after = advance_row(rows, commands, conditions, scheme, rows, i)
    if has_diverged(after):
        outcome = judge_diverged(task, memory)
    elif task.rules == 0.0:
        outcome = judge(task, memory, roll_before, after, goal)
    elif task.rules == 1.0:
        outcome = judge_publicly(task, memory, memories[:, _MEMORY:], i, roll_before, after, goal)
    else:
        outcome = judge_demonstration(task, memory, memories[:, _MEMORY:], i, roll_before, after, goal)
    store_memory(outcome.memory, memories, i)
    observe(after, conditions, observations, achieved, i)
    events[i] = outcome.events
    report[i, 0] = outcome.reward
    report[i, 1] = goal.speed - after.speed
    report[i, 2] = (goal.path_angle - after.path_angle) * DEGREES_PER_RADIAN
    report[i, 3] = wrapped(goal.azimuth - after.azimuth) * DEGREES_PER_RADIAN
    report[i, 4] = outcome.direction_error * DEGREES_PER_RADIAN
    report[i, 5] = after.load_factor
    report[i, 6] = after.clipped_commands - clipped_before
    report[i, 7] = outcome.memory.steps


@entry_point
def fly_rows(
    rows: NDArray[np.float64],
    memories: NDArray[np.float64],
    goals: NDArray[np.float64],
    actions: NDArray[np.float32],
    commands: NDArray[np.float64],
    conditions: NDArray[np.float64],
    scheme_row: NDArray[np.float64],
    task_row: NDArray[np.float64],
    observations: NDArray[np.float32],
    achieved: NDArray[np.float32],
    report: NDArray[np.float64],
    events: NDArray[np.int64],
    start: int,
    stop: int,
) -> bool:
    """Fly, judge and observe rows start ≤ i < stop in place; False, with nothing written, if an action is NaN.

    ``commands`` is scratch space for the actions in inside units.
    """
    width = actions.shape[1]
    for i in range(start, stop):
        for k in range(width):
            if math.isnan(actions[i, k]):
                return False
            commands[i, k] = actions[i, k] / (_GUIDANCE_SCALE[k] if width == 3 else _SURFACE_SCALE[k])
    scheme, task = load_scheme(scheme_row), load_task(task_row)
    shared = conditions.shape[0] == 1
    for i in range(start, stop):
        here = load_conditions(conditions, 0 if shared else i)
        fly_row(rows, memories, goals, commands, here, scheme, task, observations, achieved, report, events, i)
    return True


@entry_point
def begin_rows(
    rows: NDArray[np.float64],
    memories: NDArray[np.float64],
    goals: NDArray[np.float64],
    conditions: NDArray[np.float64],
    task_row: NDArray[np.float64],
    observations: NDArray[np.float32],
    achieved: NDArray[np.float32],
    which: NDArray[np.int64],
) -> None:
    """Begin an episode, from the state and goal in place, for the rows ``which``."""
    for i in which:
        state, goal = load_state(rows, i), load_goal(goals, i)
        task = load_task(task_row)
        memory = fresh_memory(task, state, goal)
        store_memory(memory, memories, i)
        if memories.shape[1] > _MEMORY:
            memories[i, _MEMORY] = abs(as_seen(goal).speed - as_seen(state).speed)
            memories[i, _MEMORY + 1] = memory.direction_error
        observe(state, load_conditions(conditions, i if conditions.shape[0] > 1 else 0), observations, achieved, i)


@entry_point
def judge_goals(
    achieved: NDArray[np.float64],
    desired: NDArray[np.float64],
    task_row: NDArray[np.float64],
    distances: NDArray[np.float64],
    near: NDArray[np.bool_],
) -> None:
    """For pairs of goal rows: the distance reward, and whether the achieved one lies inside the bands."""
    task = load_task(task_row)
    for i in range(achieved.shape[0]):
        here, goal = load_goal(achieved, i), load_goal(desired, i)
        speed_error = abs(goal.speed - here.speed)
        angle = direction_error(here.path_angle, here.azimuth, goal)
        distances[i] = distance_reward(speed_error, angle, task)
        near[i] = speed_error < task.speed_band and angle < task.direction_band
