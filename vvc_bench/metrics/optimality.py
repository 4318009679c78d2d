"""How much longer flights take than the shortest known flight to the same goal."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.metrics.coverage import find_goals
from vvc_bench.metrics.statistics import Spread, spread
from vvc_bench.rollout import Episodes


class BestLengths(NamedTuple):
    """The shortest known flight to each goal."""

    goals: NDArray[np.float64]
    """Shape (K, 3), each once, in outside units."""
    steps: NDArray[np.int64]
    """Shape (K,)."""


class TimeOptimality(NamedTuple):
    """A set against the shortest known flights."""

    compared: int
    """Flights that reached a goal for which one is known."""
    ratio: Spread
    """Length over the shortest known one."""
    shortest_percent: float
    """Flights that are as short as the shortest known one, or shorter."""


def best_lengths(sets: Iterable[Episodes]) -> BestLengths:
    """The shortest flight to every goal that any of the sets reached.

    All must take steps of the same duration for this to say anything.
    """
    goals, lengths = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for episodes in sets:
        goals.append(episodes.goals[episodes.reached] + 0.0)
        lengths.append(episodes.lengths[episodes.reached])
    distinct, which = np.unique(np.concatenate(goals), axis=0, return_inverse=True)
    shortest = np.full(len(distinct), np.iinfo(np.int64).max)
    np.minimum.at(shortest, which.reshape(-1), np.concatenate(lengths))
    return BestLengths(distinct, shortest)


def length_ratios(episodes: Episodes, best: BestLengths) -> NDArray[np.float64]:
    """Length over the shortest known one, shape (E,); NaN where none is known or the goal was not reached."""
    places = find_goals(episodes.goals, best.goals)
    known = (places >= 0) & episodes.reached
    ratios = np.full(len(episodes), np.nan)
    ratios[known] = episodes.lengths[known] / best.steps[places[known]]
    return ratios


def time_optimality(episodes: Episodes, best: BestLengths) -> TimeOptimality:
    """How near a set is to the shortest known flights."""
    ratios = length_ratios(episodes, best)
    ratios = ratios[~np.isnan(ratios)]
    shortest = 100.0 * int((ratios <= 1.0).sum()) / len(ratios) if len(ratios) else float("nan")
    return TimeOptimality(len(ratios), spread(ratios), shortest)
