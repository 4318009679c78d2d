"""Fly every trajectory of a set again and compare every value; and compare two sets goal by goal."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.mirror import is_mirrored, mirror
from vvc_bench.rollout import Episodes, replay
from vvc_bench.rollout.episodes import PER_TRANSITION


class Divergence(NamedTuple):
    """Where a trajectory first differs from its flight."""

    episode: int
    step: int
    column: str
    """Of `Episodes`; ``lengths`` where the flight ended earlier, ``final_observations`` after its last step."""
    recorded: float
    flown: float


class Verification(NamedTuple):
    """What flying a set again showed."""

    episodes: int
    transitions: int
    mirrored: int
    """Episodes that were compared after mirroring them back."""
    divergences: tuple[Divergence, ...]

    @property
    def passed(self) -> bool:
        """Whether every value is what the aircraft flies."""
        return not self.divergences


def fly_again(episodes: Episodes, threads: int | None = None) -> Verification:
    """Fly every episode's actions from its start, and compare observations, rewards, events and deflections bit by bit.

    A mirrored record is mirrored back first: the aircraft is not exactly symmetric. Numbers are the same to the last
    bit on one machine and its like; another processor's sine may differ in the last bit, and long flights then do.
    """
    mirrored = is_mirrored(episodes)
    divergences: list[Divergence] = []
    for which, image in ((np.flatnonzero(~mirrored), False), (np.flatnonzero(mirrored), True)):
        if which.size:
            recorded = mirror(episodes.select(which)) if image else episodes.select(which)
            divergences += [found._replace(episode=int(which[found.episode])) for found in _compare(recorded, threads)]
    return Verification(len(episodes), len(episodes.rewards), int(mirrored.sum()), tuple(sorted(divergences)))


def _compare(recorded: Episodes, threads: int | None) -> list[Divergence]:
    flown = replay(
        recorded.scenario,
        recorded.goals,
        recorded.actions,
        recorded.offsets,
        seeds=recorded.seeds,
        sources=recorded.sources,
        starts=recorded.starts,
        threads=threads,
    )
    shorter = np.flatnonzero(flown.lengths < recorded.lengths)
    ends = [_ended_early(recorded, flown, int(e)) for e in shorter]
    whole = np.flatnonzero(flown.lengths == recorded.lengths)
    same_length = recorded.select(whole), flown.select(whole)
    return ends + [found._replace(episode=int(whole[found.episode])) for found in _first_differences(*same_length)]


def _ended_early(recorded: Episodes, flown: Episodes, e: int) -> Divergence:
    return Divergence(e, int(flown.lengths[e]), "lengths", float(recorded.lengths[e]), float(flown.lengths[e]))


def _first_differences(recorded: Episodes, flown: Episodes) -> list[Divergence]:
    """The first difference of each episode that has one; both have the same lengths."""
    owner = recorded.transition_episodes()
    found: dict[int, Divergence] = {}
    for name in (*PER_TRANSITION, "final_observations"):
        mine, theirs = (getattr(each, name).reshape(len(getattr(each, name)), -1) for each in (recorded, flown))
        rows, columns = np.nonzero(mine != theirs)
        for row, column in zip(*_first_of_each(rows, columns, owner, name), strict=True):
            e = int(row) if name == "final_observations" else int(owner[row])
            step = int(recorded.lengths[e]) if name == "final_observations" else int(row - recorded.offsets[e])
            here = Divergence(e, step, name, float(mine[row, column]), float(theirs[row, column]))
            found[e] = min(found.get(e, here), here, key=lambda each: each.step)
    return list(found.values())


def _first_of_each(
    rows: NDArray[np.int64], columns: NDArray[np.int64], owner: NDArray[np.int64], name: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of differences in the order of their rows, the first of each episode."""
    episodes = rows if name == "final_observations" else owner[rows]
    _, first = np.unique(episodes, return_index=True)
    return rows[first], columns[first]


class Difference(NamedTuple):
    """Two sets, goal by goal; goals of shape (K, 3) in outside units."""

    gained: NDArray[np.float64]
    """Goals that only the second has."""
    lost: NDArray[np.float64]
    """Goals that only the first has."""
    shortened: NDArray[np.float64]
    lengthened: NDArray[np.float64]
    changed: NDArray[np.float64]
    """Goals with another flight of the same length."""
    same: int


def difference(first: Episodes, second: Episodes) -> Difference:
    """What became of each goal from one set to another; a goal's shortest flight stands for it."""
    mine, theirs = _shortest(first), _shortest(second)
    common = sorted(mine.keys() & theirs.keys())
    pairs = [(mine[goal], theirs[goal]) for goal in common]
    lengths = np.array([(first.lengths[a], second.lengths[b]) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
    equal = np.array([np.array_equal(_actions(first, a), _actions(second, b)) for a, b in pairs], dtype=np.bool_)
    both, shorter, longer = (
        np.array(common).reshape(-1, 3),
        lengths[:, 1] < lengths[:, 0],
        lengths[:, 1] > lengths[:, 0],
    )
    return Difference(
        gained=np.array(sorted(theirs.keys() - mine.keys())).reshape(-1, 3),
        lost=np.array(sorted(mine.keys() - theirs.keys())).reshape(-1, 3),
        shortened=both[shorter],
        lengthened=both[longer],
        changed=both[~shorter & ~longer & ~equal],
        same=int(equal.sum()),
    )


def _shortest(episodes: Episodes) -> dict[tuple[float, ...], int]:
    order = np.argsort(-episodes.lengths, kind="stable")  # the shortest is written last
    return {tuple(episodes.goals[e].tolist()): int(e) for e in order}


def _actions(episodes: Episodes, e: int) -> NDArray[np.float32]:
    return episodes.actions[episodes.offsets[e] : episodes.offsets[e + 1]]
