"""How many goals a set covers by other criteria than the one that its flights were kept by.

What counts is each recorded flight's last second. A flight that was kept as soon as it met one criterion might have met
a stricter one had it gone on, so what is found for stricter ones is the least that its policy can do.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.goals import SCALE
from vvc_bench.jit import entry_point
from vvc_bench.metrics.accuracy import final_errors
from vvc_bench.metrics.coverage import find_goals, reached_goals
from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Goal, Observation, field_array
from vvc_bench.sim.rows import load_goal
from vvc_bench.sim.task import Task, direction_error
from vvc_bench.sim.units import DEGREES_PER_RADIAN

CRITERIA: Mapping[str, str] = {
    "coverage_components_percent": "mean errors within 10 m/s, 1° in path angle and 1° in azimuth",
    "coverage_direction_percent": "mean errors within 10 m/s and 1° between the velocity and the goal",
    "coverage_task_percent": "every report within 10 m/s and 3°, the task's own rule",
}
"""Over the last second, ten reports; the task's time limit is left out of account."""

_TASK = Task()
_BAND_DEG = 1.0
_SCALE = field_array(Observation, "scale")
_SPEED, _PATH_ANGLE, _AZIMUTH = (Observation._fields.index(name) for name in Goal._fields)


def coverage_by_criterion(episodes: Episodes, goals_flown: ArrayLike) -> dict[str, float]:
    """Goals that at least one flight ends at, of all that were flown, in percent, by the names of `CRITERIA`.

    Args:
        episodes: flights, whatever they were kept by.
        goals_flown: shape (G, 3), all goals that were tried, in outside units.

    Raises:
        ValueError: if an episode reached a goal that is not among them.
    """
    flown, _ = reached_goals(episodes, goals_flown)
    means, ends = final_errors(episodes), _last_errors(episodes, int(_TASK.reach_steps))
    direction = ends[..., 1]
    fast_enough = means[:, 0] < _TASK.speed_band
    every_report = (ends[..., 0] < _TASK.speed_band) & (direction < _TASK.direction_band * DEGREES_PER_RADIAN)
    inside = (
        fast_enough & (means[:, 1:] < _BAND_DEG).all(axis=1),
        fast_enough & (np.nanmean(direction, axis=1) < _BAND_DEG),
        every_report.all(axis=1),
    )
    return {name: _percent(episodes.goals[mask], flown) for name, mask in zip(CRITERIA, inside, strict=True)}


def _percent(goals: NDArray[np.float64], flown: NDArray[np.float64]) -> float:
    places = np.unique(find_goals(goals, flown))
    return 100.0 * int((places >= 0).sum()) / len(flown) if len(flown) else float("nan")


def _last_errors(episodes: Episodes, reports: int) -> NDArray[np.float64]:
    """Errors in speed, m/s, and direction, degrees, at the last reports, shape (E, reports, 2).

    NaN stands for reports that a shorter flight does not have; its start is none.
    """
    errors = np.full((len(episodes), reports, 2), np.nan)
    _measure(
        np.ascontiguousarray(episodes.observations),
        np.ascontiguousarray(episodes.final_observations),
        np.ascontiguousarray(episodes.offsets),
        np.ascontiguousarray(episodes.goals / SCALE),
        errors,
    )
    errors[..., 1] *= DEGREES_PER_RADIAN
    return errors


@entry_point
def _measure(
    observations: NDArray[np.float32],
    final_observations: NDArray[np.float32],
    offsets: NDArray[np.int64],
    goals: NDArray[np.float64],
    errors: NDArray[np.float64],
) -> None:
    """Errors in SI units, the last report first."""
    for e in range(goals.shape[0]):
        goal, length = load_goal(goals, e), offsets[e + 1] - offsets[e]
        for back in range(min(length, errors.shape[1])):
            seen = observations[offsets[e + 1] - back] if back else final_observations[e]
            errors[e, back, 0] = abs(seen[_SPEED] / _SCALE[_SPEED] - goal.speed)
            errors[e, back, 1] = direction_error(
                seen[_PATH_ANGLE] / _SCALE[_PATH_ANGLE], seen[_AZIMUTH] / _SCALE[_AZIMUTH], goal
            )
