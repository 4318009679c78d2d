"""How far a flight is from its goal, and when it got there: the task's criterion, applied to a whole flight."""

import math

import numpy as np
from numpy.typing import NDArray

from vvc_bench.flight.recording import Flight
from vvc_bench.sim.fields import Goal, State
from vvc_bench.sim.task import Task, direction_error

DEFAULT_TASK = Task()
"""The paper's: 10 m/s and 3° between the velocity vectors, for 10 steps in a row."""


def goal_errors(flight: Flight) -> Goal:
    """Speed, path angle and azimuth of every state less the goal's, in SI units and radians.

    Returns:
        Each component an array of shape (T + 1,); the azimuth's is by the shorter way round, within ±π.

    Raises:
        ValueError: if the flight has no goal.
    """
    goal = wanted(flight)
    names = [State._fields.index(name) for name in Goal._fields]
    errors = (flight.states[:, names] - np.array(goal)).T
    azimuth = Goal._fields.index("azimuth")
    errors[azimuth] = np.arctan2(np.sin(errors[azimuth]), np.cos(errors[azimuth]))
    return Goal(*errors)


def direction_errors(flight: Flight) -> NDArray[np.float64]:
    """Angle between the velocity vector and the goal's in every state, rad, shape (T + 1,).

    Raises:
        ValueError: if the flight has no goal.
    """
    goal, history = wanted(flight), flight.history
    pairs = zip(np.asarray(history.path_angle).tolist(), np.asarray(history.azimuth).tolist(), strict=True)
    return np.array([direction_error(path_angle, azimuth, goal) for path_angle, azimuth in pairs])


def time_to_reach(flight: Flight, task: Task = DEFAULT_TASK) -> float:
    """Seconds until the flight had been near its goal for ``task.reach_steps`` steps in a row; infinite if never.

    Near is within ``task.speed_band`` and, as an angle between the velocity vectors, ``task.direction_band``. The start
    itself does not count: it took no step.

    Raises:
        ValueError: if the flight has no goal.
    """
    near = (np.abs(goal_errors(flight).speed) < task.speed_band) & (direction_errors(flight) < task.direction_band)
    run = 0
    for i, is_near in enumerate(near[1:], start=1):
        run = run + 1 if is_near else 0
        if run >= task.reach_steps:
            return i / flight.settings.frequency_hz
    return math.inf


def wanted(flight: Flight) -> Goal:
    """The goal by name.

    Raises:
        ValueError: if the flight has none.
    """
    if flight.goal is None:
        raise ValueError("this flight has no goal; give one to fly(..., goal=...)")
    return Goal(*flight.goal.tolist())
