"""Fly one aircraft and keep everything: the start, every state after it, every command."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.goals import check_goals
from vvc_bench.sim import Conditions, Field, Settings, State, columns, step
from vvc_bench.sim.fields import Goal
from vvc_bench.sim.stepping import STILL_ROW

if TYPE_CHECKING:
    import pandas as pd

Pilot: TypeAlias = Callable[[NDArray[np.float64]], ArrayLike]
"""From a state, one row, to a command: the components of ``settings.command_fields`` in SI units and radians."""

_STATE_WIDTH = len(State._fields)


def _still() -> NDArray[np.float64]:
    return STILL_ROW.copy()


@dataclass(frozen=True)
class Flight:
    """One flight, whole: flying ``commands`` from ``states[0]`` under ``settings`` and ``conditions`` gives ``states``.

    Args:
        settings: how it was flown.
        goal: the components of `vvc_bench.experts.Goal` in SI units and radians, shape (3,), or None.
        states: shape (T + 1, F): the start, then the state after each command. The first columns are the fields of
            `vvc_bench.sim.State`; with control delay the commands on their way follow.
        commands: shape (T, w): ``commands[i]`` led from ``states[i]`` to ``states[i + 1]``.
        conditions: what it was flown in, shape (1, C), from `vvc_bench.sim.make_conditions`.

    Raises:
        ValueError: for shapes that do not fit together, or a goal that is out of bounds.
    """

    settings: Settings
    goal: NDArray[np.float64] | None
    states: NDArray[np.float64]
    commands: NDArray[np.float64]
    conditions: NDArray[np.float64] = field(default_factory=_still)

    def __post_init__(self) -> None:
        steps, width = max(0, len(self.states) - 1), self.settings.command_width
        shapes = (self.states.ndim, self.commands.shape, self.conditions.shape)
        if shapes != (2, (steps, width), (1, len(Conditions._fields))) or self.states.shape[1] < _STATE_WIDTH:
            raise ValueError(
                f"a flight of T steps needs states (T + 1, {_STATE_WIDTH}) or wider, commands (T, {width}) and "
                f"conditions (1, {len(Conditions._fields)}); got states {self.states.shape}, "
                f"commands {self.commands.shape} and conditions {self.conditions.shape}"
            )
        if self.goal is None:
            return
        if self.goal.shape != (len(Goal._fields),):
            raise ValueError(f"goal must be {', '.join(Goal._fields)}, shape (3,), got shape {self.goal.shape}")
        check_goals(self.goal)

    @property
    def time(self) -> NDArray[np.float64]:
        """Seconds since the start of each state, shape (T + 1,)."""
        return np.arange(len(self.states)) / self.settings.frequency_hz

    @property
    def history(self) -> State:
        """The states by name: each field an array of shape (T + 1,), in SI units and radians."""
        return State(*self.states[:, :_STATE_WIDTH].T)


def fly(
    settings: Settings,
    state: NDArray[np.float64],
    pilot: Pilot,
    seconds: float,
    *,
    goal: ArrayLike | None = None,
    conditions: NDArray[np.float64] | None = None,
    stop: Callable[[NDArray[np.float64]], bool] | None = None,
) -> Flight:
    """Fly one aircraft.

    The flight ends early, before the first state that is not finite, if the simulation diverges: the reference's Euler
    steps can, in violent motion.

    Args:
        settings: how to fly.
        state: where to begin: one row from `vvc_bench.sim.start` or `vvc_bench.sim.start_from`.
        pilot: says the command in each state. It is given a copy, so that it cannot change the flight's record.
        seconds: how long, to the nearest time step and for at least one.
        goal: what the pilot is after, for the record: `vvc_bench.experts.Goal`.
        conditions: what to fly in: one row from `vvc_bench.sim.make_conditions`, shape (1, C); still air by default.
        stop: ends the flight early, after the first state for which it is true.

    Returns:
        The flight. Commands are recorded as the pilot gave them, before any clipping to their bounds.

    Raises:
        ValueError: for a duration that is not positive and finite, a state that is not one finite row, a command of the
            wrong shape or with NaN, or a goal that is out of bounds.
    """
    if not (math.isfinite(seconds) and seconds > 0.0):
        raise ValueError(f"seconds must be positive and finite, got {seconds!r}")
    if np.ndim(state) != 1 or not np.isfinite(state).all():
        raise ValueError(f"state must be one row of finite values, as sim.start makes it for one aircraft; got {state}")
    beginning = Flight(  # refuses what does not fit before anything is flown
        settings,
        None if goal is None else np.array(goal, dtype=np.float64),
        np.array([state], dtype=np.float64),
        np.empty((0, settings.command_width)),
        _still() if conditions is None else conditions,
    )
    states, commands = list(beginning.states), list(beginning.commands)
    for _ in range(max(1, round(seconds * settings.frequency_hz))):
        command = np.array(pilot(states[-1].copy()), dtype=np.float64)
        after = step(states[-1], command, settings, beginning.conditions)
        if not np.isfinite(after).all():
            break
        states.append(after)
        commands.append(command)
        if stop is not None and stop(after):
            break
    return replace(beginning, states=np.stack(states), commands=np.reshape(commands, (-1, settings.command_width)))


def table_fields(flight: Flight) -> dict[str, Field | None]:
    """The columns of a flight's table, in order, with what is known of each; None for the time."""
    fields: dict[str, Field | None] = {"time_s": None}
    fields |= columns(State)
    fields |= {f"command_{name}": known for name, known in columns(flight.settings.command_fields).items()}
    if flight.goal is not None:
        fields |= {f"goal_{name}": known for name, known in columns(Goal).items()}
    return fields


def table(flight: Flight) -> dict[str, NDArray[np.float64]]:
    """A flight's columns in outside units, each of shape (T + 1,); see `to_frame`."""
    last = np.full((1, flight.settings.command_width), np.nan)
    inside = [flight.time[:, None], flight.states[:, :_STATE_WIDTH], np.concatenate([flight.commands, last])]
    if flight.goal is not None:
        inside.append(np.broadcast_to(flight.goal, (len(flight.states), len(flight.goal))))
    values = np.concatenate(inside, axis=1)
    known = table_fields(flight)
    scales = np.array([1.0 if column is None else column.unit.scale for column in known.values()])
    return dict(zip(known, (values * scales).T, strict=True))


def to_frame(flight: Flight) -> pd.DataFrame:
    """A flight as a table in outside units.

    Returns:
        T + 1 rows: ``time_s``; every column of ``vvc_bench.sim.columns(State)``; the command given in that state, as
        ``command_`` and the columns of the command, NaN in the last row; and if there is a goal, ``goal_speed_mps``,
        ``goal_path_angle_deg`` and ``goal_azimuth_deg``.
    """
    import pandas as pd

    return pd.DataFrame(table(flight))
