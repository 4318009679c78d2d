"""One flight for each goal: keep what is new, and the shorter of two (IRPO's update of its demonstrations)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes, concatenate


class Update(NamedTuple):
    """A set after others' flights were offered to it."""

    episodes: Episodes
    """In the order of speed, path angle and azimuth of their goals."""
    offered: int
    new: int
    """Goals that had no flight before."""
    shorter: int
    """Goals whose flight is now another one, strictly shorter."""


def update(kept: Episodes, offered: Episodes) -> Update:
    """Offer flights to a set: each is taken where its goal is new or it is strictly shorter than the flight there.

    Args:
        kept: the set.
        offered: flights of the same scenario that reached their goals.

    Raises:
        ValueError: for another scenario, or an offered flight that did not reach.
    """
    if not offered.reached.all():
        failed = int(np.flatnonzero(~offered.reached)[0])
        raise ValueError(f"flights must reach their goals to be kept; episode {failed} does not")
    both = concatenate([kept, offered])
    mine = np.arange(len(both)) < len(kept)
    best = _shortest_for_each_goal(both.goals, both.lengths)
    had = {goal.tobytes() for goal in kept.goals}
    new = sum(both.goals[e].tobytes() not in had for e in best if not mine[e])
    return Update(both.select(best), len(offered), new, int((~mine[best]).sum()) - new)


def _shortest_for_each_goal(goals: NDArray[np.float64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices, in the order of the goals; of equally short flights the first."""
    order = np.lexsort((np.arange(len(goals)), lengths, *goals.T[::-1]))
    ordered = goals[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    chosen: NDArray[np.int64] = order[first]
    return chosen
