"""The pilots that need no training, by number: what the compiled loops ask for an action."""

from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.experts.manoeuvre import WIDTH, Caution, Manoeuvre, load_manoeuvre, manoeuvre_command, manoeuvre_row
from vvc_bench.experts.pid import PidParameters, load_pid, pid_command
from vvc_bench.experts.pursuit import PursuitParameters
from vvc_bench.jit import kernel
from vvc_bench.sim.fields import Goal, GuidanceCommand, Observation, field_array
from vvc_bench.sim.task import Memory

_OBSERVATION_SCALE = field_array(Observation, "scale")
_GUIDANCE_SCALE = field_array(GuidanceCommand, "scale")
_STEPS, _MOVING_AWAY, _NEGATIVE_LOAD = (
    Memory._fields.index(name) for name in ("steps", "steps_moving_away", "steps_negative_load")
)


class Law(IntEnum):
    """Who commands."""

    RECORDED = 0
    """Nobody: the actions are there."""
    PID = 1
    MANOEUVRE = 2
    """Pursuit is one without preparation."""


_PID = int(Law.PID)


class Pilot(NamedTuple):
    """A law with its figures."""

    law: Law
    rows: NDArray[np.float64]
    """Shape (1, P) for all episodes alike, or (E, P)."""
    source: str = ""
    """What its flights are labelled with."""


RECORDED = Pilot(Law.RECORDED, np.zeros((1, 0)))
Figures: TypeAlias = PidParameters | PursuitParameters | ArrayLike
"""A law's parameters, or rows of manoeuvres (`vvc_bench.experts.manoeuvre`)."""


def make_pilot(figures: Figures) -> Pilot:
    """Who flies with these figures.

    Raises:
        ValueError: for manoeuvres of another width, or numbers that are not finite.
    """
    if isinstance(figures, PidParameters):
        return Pilot(Law.PID, np.array([figures], dtype=np.float64), "pid")
    if isinstance(figures, PursuitParameters):
        return Pilot(Law.MANOEUVRE, manoeuvre_row(Manoeuvre(pursuit=figures))[None], "pursuit")
    rows = np.ascontiguousarray(np.atleast_2d(figures), dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != WIDTH or not np.isfinite(rows).all():
        raise ValueError(f"manoeuvres must be finite numbers of shape (E, {WIDTH}), got shape {rows.shape}")
    return Pilot(Law.MANOEUVRE, rows, "manoeuvre")


@kernel
def read_observation(seen: NDArray[np.float32], i: int) -> Observation:
    """What aircraft i sees, in SI units and radians."""
    return Observation(
        seen[i, 0] / _OBSERVATION_SCALE[0],
        seen[i, 1] / _OBSERVATION_SCALE[1],
        seen[i, 2] / _OBSERVATION_SCALE[2],
        seen[i, 3] / _OBSERVATION_SCALE[3],
        seen[i, 4] / _OBSERVATION_SCALE[4],
        seen[i, 5] / _OBSERVATION_SCALE[5],
        seen[i, 6] / _OBSERVATION_SCALE[6],
        seen[i, 7] / _OBSERVATION_SCALE[7],
    )


@kernel
def write_command(command: GuidanceCommand, actions: NDArray[np.float32], place: int) -> None:
    """Write a command as an action, in the units of the action space."""
    actions[place, 0] = command.roll_rate * _GUIDANCE_SCALE[0]
    actions[place, 1] = command.load_factor * _GUIDANCE_SCALE[1]
    actions[place, 2] = command.throttle * _GUIDANCE_SCALE[2]


@kernel
def write_action(
    law: int,
    rows: NDArray[np.float64],
    row: int,
    seen: NDArray[np.float32],
    i: int,
    goal: Goal,
    memories: NDArray[np.float64],
    time_step: float,
    actions: NDArray[np.float32],
    place: int,
) -> None:
    """Write a law's answer to what aircraft i sees, ``memories[i]`` being the task's `Memory` of its flight."""
    view = read_observation(seen, i)
    if law == _PID:
        command = pid_command(view, goal, load_pid(rows, row))
    else:
        seconds = memories[i, _STEPS] * time_step
        counters = Caution(memories[i, _MOVING_AWAY], memories[i, _NEGATIVE_LOAD])
        command = manoeuvre_command(view, goal, seconds, counters, load_manoeuvre(rows, row))
    write_command(command, actions, place)
