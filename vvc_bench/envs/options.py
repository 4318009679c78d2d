"""What an environment can be asked for, in one place for the single and the vector environment."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from vvc_bench import sim
from vvc_bench.envs.fleet import Fleet
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.sim.fields import Observation, columns, field_array
from vvc_bench.sim.starting import DEFAULT_ALTITUDE_M, DEFAULT_SPEED_MPS
from vvc_bench.tasks import make_task, named_problem


class Spaces(NamedTuple):
    """What goes in and out of one aircraft's environment."""

    observation: spaces.Space[Any]
    action: spaces.Space[Any]


def make_fleet(
    count: int,
    *,
    task: str = "hard",
    control_mode: sim.ControlMode = "guidance",
    dynamics: sim.Dynamics = "reference",
    frequency_hz: float = 10.0,
    goals: object | None = None,
    altitude_m: float = DEFAULT_ALTITUDE_M,
    speed_mps: float = DEFAULT_SPEED_MPS,
    heading_deg: float = 0.0,
    conditions: Mapping[str, ArrayLike] | None = None,
    **task_fields: object,
) -> Fleet:
    """The aircraft behind an environment.

    Args:
        count: how many.
        task: a name from `vvc_bench.tasks.TASKS`.
        control_mode: ``"guidance"`` or ``"end_to_end"``.
        dynamics: ``"reference"`` or ``"accurate"``.
        frequency_hz: steps per second, 1 to 100; limits in steps stay as they are.
        goals: a distribution, a function of a generator, or a list of goals, in place of the task's own box.
        altitude_m: where episodes begin, in trim.
        speed_mps: true airspeed at the start.
        heading_deg: heading at the start.
        conditions: wind, gusts, offsets, lags, delay, sensor noise: arguments of `vvc_bench.sim.make_conditions`.
        **task_fields: any field of the task by its column name, as ``reach_steps=30`` or ``reward="sparse"``.

    Raises:
        ValueError: for an unknown name or an impossible value.
    """
    problem = named_problem(task)
    settings = sim.Settings(control_mode, dynamics, frequency_hz)
    table = sim.make_conditions(**(conditions or {}))
    if len(table) not in (1, count):
        raise ValueError(f"conditions must hold single values or {count} of each, got {len(table)}")
    start = sim.start(settings, altitude_m=altitude_m, speed_mps=speed_mps, heading_deg=heading_deg, conditions=table)
    return Fleet(
        count,
        make_task(problem.task, **task_fields),
        settings,
        problem.goals if goals is None else goals,
        start,
        table,
    )


def make_spaces(settings: sim.Settings) -> Spaces:
    """Observation and action space; float32, in the units that `Observation` and the commands have outside."""
    low, high = _bounds(Observation)
    goal = [list(columns(Observation)).index(name) for name in GOAL_COLUMNS]
    return Spaces(
        spaces.Dict(
            {
                "observation": spaces.Box(low, high, dtype=np.float32),
                "achieved_goal": spaces.Box(low[goal], high[goal], dtype=np.float32),
                "desired_goal": spaces.Box(low[goal], high[goal], dtype=np.float32),
            }
        ),
        spaces.Box(*_bounds(settings.command_fields), dtype=np.float32),
    )


def _bounds(fields: type[tuple[float, ...]]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    scale = field_array(fields, "scale")
    low, high = (field_array(fields, bound) * scale for bound in ("low", "high"))
    return low.astype(np.float32), high.astype(np.float32)


def seeds_for(count: int, seed: int | list[int | None] | None, generator: np.random.Generator) -> list[Any]:
    """One seed for each aircraft: ``seed + i`` as Gymnasium's own vector environments have it."""
    if seed is None:
        return [int(value) for value in generator.integers(2**31, size=count)]
    if isinstance(seed, int):
        return [seed + i for i in range(count)]
    if len(seed) != count:
        raise ValueError(f"a list of seeds must have one for each of {count} environments, got {len(seed)}")
    return list(seed)


def checked_options(options: dict[str, Any] | None, fleet: Fleet) -> dict[str, Any]:
    """Reset options that are known, with a state of the right shape.

    Raises:
        ValueError: for anything else.
    """
    options = dict(options or {})
    unknown = set(options) - {"goal", "state"}
    if unknown:
        raise ValueError(f"unknown reset option {min(unknown)!r}; known are 'goal' and 'state'")
    state = options.get("state")
    if state is not None and np.shape(state)[-1:] != fleet.start.shape:
        raise ValueError(f"options['state'] must be a row of {fleet.start.size} values, got shape {np.shape(state)}")
    return {name: value for name, value in options.items() if value is not None}
