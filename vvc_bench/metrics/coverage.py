"""Which goals were reached, over the whole goal space and region by region."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics.statistics import Interval, wilson_interval
from vvc_bench.rollout import Episodes

MOST_VALUES = 100
"""An axis of the goal space with more distinct values than these is cut into 20 equal cells."""
_CELLS = 20


class Region(NamedTuple):
    """Slabs of the goal space along one axis; each array has one entry for a slab."""

    values: NDArray[np.float64]
    """Middles of the slabs, in the axis' outside unit."""
    flown: NDArray[np.int64]
    reached: NDArray[np.int64]

    @property
    def interval(self) -> Interval:
        """Share reached, with 95 % confidence, were the goals drawn at random from each slab."""
        return wilson_interval(self.reached, self.flown)


class Coverage(NamedTuple):
    """Goals flown and reached in each cell of the goal space."""

    edges: tuple[NDArray[np.float64], ...]
    """Bounds of the cells along each axis, one more than there are cells."""
    values: tuple[NDArray[np.float64], ...]
    """Middles of the cells along speed (m/s), path angle and azimuth (degrees)."""
    flown: NDArray[np.int64]
    """Shape (A, B, C)."""
    reached: NDArray[np.int64]
    """Shape (A, B, C)."""

    @property
    def percent(self) -> float:
        """Goals reached of all goals flown, in percent: Table 1's goal-space coverage. NaN for no goal."""
        return 100.0 * int(self.reached.sum()) / int(self.flown.sum()) if self.flown.any() else float("nan")

    def along(self, axis: int) -> Region:
        """The marginal distribution along speed (0), path angle (1) or azimuth (2)."""
        others = tuple(other for other in range(len(self.values)) if other != axis)
        return Region(self.values[axis], self.flown.sum(axis=others), self.reached.sum(axis=others))


def find_goals(goals: NDArray[np.float64], among: NDArray[np.float64]) -> NDArray[np.int64]:
    """Where each goal stands in a list, −1 where it does not; exact, with −0 the same as 0.

    Args:
        goals: shape (E, 3).
        among: shape (K, 3), each goal once.
    """
    _, which = np.unique(np.concatenate([among, goals]) + 0.0, axis=0, return_inverse=True)
    which = which.reshape(-1)
    place = np.full(len(which), -1, dtype=np.int64)
    place[which[: len(among)]] = np.arange(len(among))
    found: NDArray[np.int64] = place[which[len(among) :]]
    return found


def reached_goals(episodes: Episodes, goals_flown: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The distinct goals flown, and which of them at least one episode reached.

    Args:
        episodes: flights, those that failed among them or not.
        goals_flown: shape (G, 3), all goals that were tried: speed in m/s, path angle and azimuth in degrees.

    Returns:
        Goals of shape (K, 3) in ascending order, and a mask of shape (K,).

    Raises:
        ValueError: if an episode reached a goal that is not among them.
    """
    flown = np.unique(np.asarray(goals_flown, dtype=np.float64).reshape(-1, 3) + 0.0, axis=0)
    wanted = episodes.goals[episodes.reached]
    places = find_goals(wanted, flown)
    if (places < 0).any():
        stranger = ", ".join(f"{value:g}" for value in wanted[places < 0][0])
        raise ValueError(f"goal ({stranger}) was reached but is not among the {len(flown)} goals flown; pass them all")
    reached = np.zeros(len(flown), dtype=np.bool_)
    reached[places] = True
    return flown, reached


def coverage(
    goals: NDArray[np.float64], reached: NDArray[np.bool_], edges: Sequence[ArrayLike] | None = None
) -> Coverage:
    """Count goals cell by cell.

    Args:
        goals: shape (K, 3), in outside units.
        reached: shape (K,).
        edges: ascending bounds of the cells along each of the three axes, for regions of one's own choice; goals
            outside of them do not count. By default every value of a grid has its cell.

    Raises:
        ValueError: for edges that are not three ascending lists.
    """
    cells = [_cells(goals[:, k]) for k in range(len(GOAL_COLUMNS))] if edges is None else list(map(_own_cells, edges))
    if len(cells) != len(GOAL_COLUMNS):
        raise ValueError(f"edges are needed along {', '.join(GOAL_COLUMNS)}; got {len(cells)} lists")
    bounds, middles = zip(*cells, strict=True)
    flown, _ = np.histogramdd(goals, bounds)
    found, _ = np.histogramdd(goals[reached], bounds)
    return Coverage(bounds, middles, flown.astype(np.int64), found.astype(np.int64))


class _Cells(NamedTuple):
    edges: NDArray[np.float64]
    values: NDArray[np.float64]


def _own_cells(edges: ArrayLike) -> _Cells:
    bound = np.asarray(edges, dtype=np.float64)
    if bound.ndim != 1 or len(bound) < 2 or not (np.diff(bound) > 0).all():
        raise ValueError(f"edges of cells must ascend, at least two of them; got {bound.tolist()}")
    return _Cells(bound, _middles(bound))


def _cells(values: NDArray[np.float64]) -> _Cells:
    """A cell around each value where these are few, else equal ones."""
    distinct = np.unique(values)
    if len(distinct) > MOST_VALUES:
        return _own_cells(np.linspace(distinct[0], distinct[-1], _CELLS + 1))
    if len(distinct) < 2:
        middle = distinct if len(distinct) else np.zeros(1)
        return _Cells(np.concatenate([middle - 0.5, middle + 0.5]), middle)
    between = _middles(distinct)
    ends = 2.0 * distinct[[0, -1]] - between[[0, -1]]
    return _Cells(np.concatenate([ends[:1], between, ends[1:]]), distinct)


def _middles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    middles: NDArray[np.float64] = (values[:-1] + values[1:]) / 2.0
    return middles
