"""How flights settle: when they first come near their goals, how far they swing out again, when they stay."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.goals import SCALE
from vvc_bench.jit import entry_point
from vvc_bench.metrics.statistics import Spread, spread
from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Goal, Observation, field_array
from vvc_bench.sim.rows import load_goal
from vvc_bench.sim.task import Task, direction_error
from vvc_bench.sim.units import DEGREES_PER_RADIAN

DEFAULT_TASK = Task()
"""Whose bands count unless others are asked for: the paper's 10 m/s and 3°, the same for every set."""

_SCALE = field_array(Observation, "scale")
_SPEED, _PATH_ANGLE, _AZIMUTH = (Observation._fields.index(name) for name in Goal._fields)
_NEVER = -1


class Response(NamedTuple):
    """Each of shape (E,), for one of speed and direction."""

    arrival_s: NDArray[np.float64]
    """When the error was first inside its band; NaN for never."""
    overshoot: NDArray[np.float64]
    """How far outside of the band it came again after that, m/s or degrees; 0 if it stayed, NaN if never inside."""
    settling_s: NDArray[np.float64]
    """From when on it stayed inside to the end; NaN if it is outside at the end."""


class Responses(NamedTuple):
    """Both parts of the goal."""

    speed: Response
    """Error |v − v_c|, in m/s."""
    direction: Response
    """Angle between the velocity vector and the goal's, in degrees."""


class ResponseSummary(NamedTuple):
    """One `Response` in short."""

    band: float
    """m/s or degrees."""
    arrival_s: Spread
    overshoot: Spread
    """In the unit of the band; over the flights that were inside."""
    overshooting_percent: float
    """Flights that came outside again, of those that were inside."""
    settling_s: Spread
    settled_percent: float
    """Flights that are inside at their ends."""


def responses(episodes: Episodes, task: Task = DEFAULT_TASK) -> Responses:
    """When and how every episode comes to its goal.

    Args:
        episodes: E flights.
        task: whose ``speed_band`` and ``direction_band`` count.
    """
    shape = (len(episodes), len(Responses._fields))
    first, last = np.full(shape, _NEVER), np.full(shape, _NEVER)
    swing = np.zeros(shape)
    bands = np.array([task.speed_band, task.direction_band])
    _respond(
        np.ascontiguousarray(episodes.observations),
        np.ascontiguousarray(episodes.final_observations),
        np.ascontiguousarray(episodes.offsets),
        np.ascontiguousarray(episodes.goals / SCALE),
        *(bands, first, last, swing),
    )
    step, lengths = episodes.scenario.settings.time_step, episodes.lengths[:, None]
    outside_units = np.array([1.0, DEGREES_PER_RADIAN])
    never = first == _NEVER
    arrival = np.where(never, np.nan, first * step)
    overshoot = np.where(never, np.nan, np.maximum(swing - bands, 0.0) * outside_units)
    settling = np.where(last == lengths, np.nan, (last + 1) * step)
    return Responses(*(Response(arrival[:, k], overshoot[:, k], settling[:, k]) for k in range(shape[1])))


def summarise(response: Response, band: float) -> ResponseSummary:
    """A response's means and shares; ``band`` in m/s or degrees."""
    inside = ~np.isnan(response.arrival_s)
    return ResponseSummary(
        band,
        spread(response.arrival_s),
        spread(response.overshoot),
        _percent(response.overshoot[inside] > 0.0),
        spread(response.settling_s),
        _percent(~np.isnan(response.settling_s)),
    )


def _percent(which: NDArray[np.bool_]) -> float:
    return 100.0 * int(which.sum()) / which.size if which.size else float("nan")


@entry_point
def _respond(
    observations: NDArray[np.float32],
    final_observations: NDArray[np.float32],
    offsets: NDArray[np.int64],
    goals: NDArray[np.float64],
    bands: NDArray[np.float64],
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    swing: NDArray[np.float64],
) -> None:
    """First state inside each band, last state outside, and the largest error after the first; all (E, 2)."""
    for e in range(goals.shape[0]):
        goal, length = load_goal(goals, e), offsets[e + 1] - offsets[e]
        for k in range(length + 1):
            seen = observations[offsets[e] + k] if k < length else final_observations[e]
            speed_error = abs(seen[_SPEED] / _SCALE[_SPEED] - goal.speed)
            angle = direction_error(seen[_PATH_ANGLE] / _SCALE[_PATH_ANGLE], seen[_AZIMUTH] / _SCALE[_AZIMUTH], goal)
            for part in range(2):
                error = speed_error if part == 0 else angle
                if error >= bands[part]:
                    last[e, part] = k
                elif first[e, part] == _NEVER:
                    first[e, part] = k
                if first[e, part] != _NEVER:
                    swing[e, part] = max(swing[e, part], error)
