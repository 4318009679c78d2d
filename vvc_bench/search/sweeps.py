"""Sweeps over a grid of goals: each looks for better plans for every goal, from its own and its neighbours' last ones.

A sweep reads only what the one before it has found, so the result is a function of scenario, goals, budget and seed.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.manoeuvre import WIDTH
from vvc_bench.goals import SCALE
from vvc_bench.rollout.scenario import Scenario
from vvc_bench.search.flights import FAILED, NICHES, improve
from vvc_bench.sim.fields import Conditions, GuidanceCommand
from vvc_bench.sim.parallel import available_threads
from vvc_bench.sim.task import Memory, window_width
from vvc_bench.tasks import task_row

_BLOCK = 64
"""Goals that a thread takes at a time: a second's work or less."""
_STILL = tuple(k for k, name in enumerate(Conditions._fields) if name != "seed")


class Budget(NamedTuple):
    """How much is tried for each goal."""

    sweeps: int
    generations: int
    """In each sweep; the later ones vary what the earlier ones found."""
    population: int
    """Plans flown side by side in each generation."""
    ways: int = 1
    """Niches kept apart for each goal, 1 or `vvc_bench.search.NICHES`: ended higher or lower, to the right or left."""
    patience: float = 1.0
    """How many times as long as the shortest flight another one may be to be kept."""

    @property
    def candidates(self) -> int:
        """Plans tried for each goal."""
        return self.sweeps * self.generations * self.population


class Found(NamedTuple):
    """What is known after some sweeps."""

    plans: NDArray[np.float64]
    """Shape (G, ways, `WIDTH`): rows of manoeuvres."""
    scores: NDArray[np.float64]
    """Shape (G, ways): steps and a fraction (`vvc_bench.search.flights`), at least `FAILED` where the goal was not
    reached, infinite where there is no plan."""

    @property
    def best(self) -> NDArray[np.int64]:
        """Way of each goal's shortest flight, or of the nearest miss; shape (G,)."""
        best: NDArray[np.int64] = np.argmin(self.scores, axis=1)
        return best

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Steps of each goal's shortest flight, NaN where none reached; shape (G,)."""
        least = self.scores.min(axis=1)
        return np.where(least < FAILED, np.floor(least), np.nan)

    def kept(self, patience: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Goal and way of what is worth flying, goal by goal: where none reaches, the nearest miss.

        Args:
            patience: how many times as long as the shortest flight another one may be.
        """
        longest = np.where(self.lengths > 0.0, patience * self.lengths, 0.0)
        keep = np.floor(self.scores) <= longest[:, None]
        keep[np.arange(len(keep)), self.best] = True
        goals, ways = np.nonzero(keep)
        return goals, ways


def nothing_found(goals: int, ways: int) -> Found:
    """The state before the first sweep."""
    return Found(np.zeros((goals, ways, WIDTH)), np.full((goals, ways), np.inf))


class Neighbours(NamedTuple):
    """Whose plans a goal tries."""

    goals: NDArray[np.int64]
    """Shape (G, 7): the next goals along each axis, and the mirror image; −1 where there is none."""
    mirrored: NDArray[np.bool_]
    """Shape (7,)."""


def neighbours(shape: tuple[int, int, int], symmetric: bool) -> Neighbours:
    """The neighbours of each goal of a grid with so many speeds, path angles and azimuths, azimuth fastest.

    Args:
        shape: points along each axis.
        symmetric: whether the azimuths are the same to the left as to the right.
    """
    index = np.pad(np.arange(np.prod(shape)).reshape(shape), 1, constant_values=-1)
    inner = (slice(1, -1),) * 3
    columns = [np.roll(index, shift, axis)[inner].ravel() for axis in range(3) for shift in (1, -1)]
    image = index[inner][:, :, ::-1].ravel()
    columns.append(image if symmetric else np.full_like(image, -1))
    return Neighbours(np.ascontiguousarray(np.stack(columns, axis=1)), np.array([False] * 6 + [True]))


def check_searchable(scenario: Scenario, budget: Budget) -> None:
    """Refuse what cannot be searched.

    Raises:
        ValueError: for another control mode, weather, or a budget that is none.
    """
    if scenario.settings.command_fields is not GuidanceCommand:
        raise ValueError(f"the search needs control_mode='guidance', got {scenario.settings.control_mode!r}")
    if any(scenario.conditions[k] for k in _STILL):
        raise ValueError("the search flies in still conditions; leave wind, gusts, offsets, actuators and delay out")
    if min(budget.sweeps, budget.generations, budget.population) < 1 or budget.patience < 1.0:
        raise ValueError(f"sweeps, generations, population and patience must be at least 1, got {budget}")
    if budget.ways not in (1, NICHES):
        raise ValueError(f"ways must be 1 or {NICHES}, got {budget.ways}")


def sweep(
    scenario: Scenario,
    goals: NDArray[np.float64],
    near: Neighbours,
    found: Found,
    budget: Budget,
    *,
    seed: int,
    number: int,
    threads: int | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Found:
    """One sweep.

    Args:
        scenario: rules, settings and start.
        goals: shape (G, 3), in outside units.
        near: their neighbours.
        found: what the sweep before has found.
        budget: how much to try.
        seed: of the whole search.
        number: of this sweep, from 0.
        threads: at most so many; by default all cores. The result does not depend on them.
        progress: told how many goals are done since it was last told.
    """
    after = Found(found.plans.copy(), found.scores.copy())
    inside = (
        scenario.start,
        goals / SCALE,
        goals.astype(np.float32) / SCALE,
        found.plans,
        found.scores,
        near.goals,
        near.mirrored,
        scenario.condition_rows(np.zeros(1, dtype=np.int64)),
        scenario.settings.row,
        task_row(scenario.task),
        len(Memory._fields) + window_width(scenario.task),
        seed,
        number,
        budget.generations,
        budget.population,
        budget.patience,
    )

    def work(first: int) -> int:
        last = min(first + _BLOCK, len(goals))
        improve(*inside, *after, first, last)
        return last - first

    with ThreadPoolExecutor(threads or available_threads()) as pool:
        for count in pool.map(work, range(0, len(goals), _BLOCK)):
            progress(count)
    return after
