"""Curricula: goals drawn where there is most to learn, in place of evenly from the task's box.

Each is a `vvc_bench.goals.GoalDistribution`, so that any environment takes it as ``goals``; whoever trains tells it
what is achieved (`Curriculum.observe`) and which goals were reached (`Curriculum.conclude`). Three draw goals from
where the aircraft has been, and differ in which of these they prefer, as they stand side by side in Pitis et al.
(2020), "Maximum Entropy Gain Exploration for Long Horizon Multi-goal Reinforcement Learning":

- `Rig`: goals from the density of what was achieved. Nair et al. (2018) fit an autoencoder to images for that; three
  numbers take a kernel density estimate.
- `Discern`: uniform over what was achieved, rare and frequent alike: achieved goals, weighted by one over their
  density. Warde-Farley et al. (2019) keep a buffer of goals that is made diverse.
- `Mega`: the achieved goal of the least density among some drawn at random.

The fourth asks how often goals are reached:

- `Intermediate`: goals that are reached sometimes, neither always nor never. Florensa et al. (2018), "Automatic Goal
  Generation for Reinforcement Learning Agents", train a generator for that; three numbers take a table of cells.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from sklearn.neighbors import KernelDensity

from vvc_bench.baselines.configurations import CURRICULA, DISCERN, INTERMEDIATE, MEGA, RIG
from vvc_bench.goals import UniformBox

_OFFERED = 100
"""Candidates that `Mega` chooses from."""
_BANDWIDTH = 0.05
"""Of the kernels, Gaussian, in sides of the box."""


class Curriculum:
    """Goals that follow what is learned; a curriculum listens to what it needs."""

    def observe(self, achieved: NDArray[Any]) -> None:
        """Take note of goals that were achieved on the way, shape (N, 3), in outside units."""

    def conclude(self, goals: NDArray[Any], reached: NDArray[np.bool_]) -> None:
        """Take note of episodes that ended: goals, shape (N, 3), in outside units, and which were reached, (N,)."""

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal, shape (3,), in outside units."""
        raise NotImplementedError


class Achieved(Curriculum):
    """Goals from those achieved within a box, which is the task's own; from the box until enough were.

    Args:
        box: what is achieved outside it is passed over.
        seed: of which achieved goals are remembered.
        capacity: goals remembered; the newest ones.
        fitted: goals that a density is fitted to, drawn from those.
        renewed: observed goals after which it is fitted anew.
        remembered: share of what is observed that is remembered.
    """

    def __init__(
        self,
        box: UniformBox,
        seed: int,
        *,
        capacity: int = 50_000,
        fitted: int = 1000,
        renewed: int = 100_000,
        remembered: float = 0.05,
    ) -> None:
        self._box = box
        self._low, self._width = np.array(box.low), np.array(box.high) - box.low
        self._generator = np.random.default_rng(seed)
        self._achieved = np.empty((capacity, 3))
        self._count = 0
        self._fitted, self._renewed, self._remembered = fitted, renewed, remembered
        self._unseen = 0
        self._pool = np.empty((0, 3))
        self._log_density = np.empty(0)

    def observe(self, achieved: NDArray[Any]) -> None:
        """Remember some of the goals that were achieved, shape (N, 3), in outside units."""
        inside = ((achieved >= self._box.low) & (achieved <= self._box.high)).all(axis=1)
        chosen = achieved[inside & (self._generator.random(len(achieved)) < self._remembered)]
        places = (self._count + np.arange(len(chosen))) % len(self._achieved)
        self._achieved[places] = chosen
        self._count += len(chosen)
        self._unseen += len(achieved)
        if self._unseen >= self._renewed and self._count >= self._fitted:
            self._renew()

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal, shape (3,), in outside units."""
        return self._choose(generator) if len(self._pool) else self._box.sample(generator)

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        raise NotImplementedError

    def _renew(self) -> None:
        """Fit the density to some of what is remembered, which are the candidates too.

        Each has a kernel of its own, so that none is rarer than one among so many.
        """
        known = self._achieved[: min(self._count, len(self._achieved))]
        self._pool = known[self._generator.choice(len(known), self._fitted, replace=False)]
        scaled = (self._pool - self._low) / self._width
        self._log_density = KernelDensity(bandwidth=_BANDWIDTH).fit(scaled).score_samples(scaled)
        self._unseen = 0


class Rig(Achieved):
    """Goals as they were achieved."""

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        kernel = self._pool[generator.integers(len(self._pool))]
        drawn = kernel + _BANDWIDTH * self._width * generator.standard_normal(3)
        goal: NDArray[np.float64] = np.clip(drawn, self._box.low, self._box.high)
        return goal


class Discern(Achieved):
    """Goals uniform over what was achieved."""

    def _renew(self) -> None:
        super()._renew()
        weights = np.exp(self._log_density.min() - self._log_density)
        self._cumulative = np.cumsum(weights) / weights.sum()

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        place = np.searchsorted(self._cumulative[:-1], generator.random(), side="right")
        goal: NDArray[np.float64] = self._pool[place].copy()
        return goal


class Mega(Achieved):
    """Goals that were achieved least."""

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        offered = generator.integers(len(self._pool), size=_OFFERED)
        goal: NDArray[np.float64] = self._pool[offered[self._log_density[offered].argmin()]].copy()
        return goal


class Intermediate(Curriculum):
    """Goals that are reached sometimes: a cell of the box is drawn as p (1 − p) says, p being its share of successes.

    Shares are smoothed over neighbouring cells, so that next to reached goals those that are not are drawn too, and old
    episodes count less and less. Some goals are drawn evenly from the box, as nothing else would show what has become
    possible, or was forgotten.

    Args:
        box: where goals come from.
        among: goals, shape (K, 3), in outside units: goals are drawn from cells that hold one of these; by default from
            all.
        cells: of each component.
        even: share of goals drawn evenly.
        smoothing: standard deviation of the smoothing, in cells.
        renewed: episodes after which shares are reckoned anew.
        kept: what an episode still counts after that.

    Raises:
        ValueError: if the box holds none of the goals.
    """

    def __init__(
        self,
        box: UniformBox,
        *,
        among: NDArray[np.float64] | None = None,
        cells: tuple[int, int, int] = (10, 17, 17),
        even: float = 0.3,
        smoothing: float = 0.7,
        renewed: int = 2000,
        kept: float = 0.9,
    ) -> None:
        self._box, self._cells, self._even = box, cells, even
        self._low, self._width = np.array(box.low), (np.array(box.high) - box.low) / cells
        self._smoothing, self._renewed, self._kept = smoothing, renewed, kept
        self._reached, self._flown = np.zeros(cells), np.zeros(cells)
        self._unseen = 0
        self._open = np.ones(cells)
        if among is not None:
            self._open = np.zeros(cells)
            self._open[self._cells_of(among)[1]] = 1.0
            if not self._open.any():
                raise ValueError(f"there is no goal to learn: none of {len(among)} lies in {box}")
        self._cumulative_open, self._cumulative = _cumulative(self._open), np.empty(0)

    def covers(self, goals: NDArray[Any]) -> NDArray[np.bool_]:
        """Which goals, shape (K, 3), lie in cells that are drawn from; shape (K,)."""
        covered, cells = self._cells_of(goals)
        covered[covered] = self._open[cells] > 0.0
        return covered

    def _cells_of(self, goals: NDArray[Any]) -> tuple[NDArray[np.bool_], tuple[NDArray[np.int64], ...]]:
        """Which goals lie in the box, and the cells of these."""
        cells = np.floor((goals - self._low) / self._width).astype(np.int64)
        inside: NDArray[np.bool_] = ((cells >= 0) & (cells <= self._cells)).all(axis=1)
        return inside, tuple(np.minimum(cells[inside], np.array(self._cells) - 1).T)

    def conclude(self, goals: NDArray[Any], reached: NDArray[np.bool_]) -> None:
        """Count the goals of the box by cell."""
        inside, where = self._cells_of(goals)
        np.add.at(self._flown, where, 1.0)
        np.add.at(self._reached, where, reached[inside])
        self._unseen += len(goals)
        if self._unseen >= self._renewed:
            self._renew()

    def shares(self) -> NDArray[np.float64]:
        """Share of the goals of each cell that is reached; a half where nothing is known."""
        reached, flown = (
            gaussian_filter(counts, self._smoothing, mode="nearest") for counts in (self._reached, self._flown)
        )
        share: NDArray[np.float64] = (reached + 0.5) / (flown + 1.0)
        return share

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal, shape (3,), in outside units."""
        evenly = not len(self._cumulative) or generator.random() < self._even
        if evenly and self._open.all():
            return self._box.sample(generator)
        cumulative = self._cumulative_open if evenly else self._cumulative
        cell = np.unravel_index(np.searchsorted(cumulative, generator.random(), side="right"), self._cells)
        goal: NDArray[np.float64] = self._low + (cell + generator.random(3)) * self._width
        return goal

    def _renew(self) -> None:
        share = self.shares()
        self._cumulative = _cumulative(share * (1.0 - share) * self._open)
        self._reached *= self._kept
        self._flown *= self._kept
        self._unseen = 0


def _cumulative(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where each cell's share of all weight ends, but for the last one."""
    ends = np.cumsum(weights)
    shares: NDArray[np.float64] = ends[:-1] / ends[-1]
    return shares


ACHIEVED: Mapping[str, type[Achieved]] = MappingProxyType({RIG: Rig, DISCERN: Discern, MEGA: Mega})
"""Those that draw from where the aircraft has been, by name."""


def make_curriculum(name: str, box: UniformBox, seed: int) -> Curriculum:
    """One of `CURRICULA`.

    Args:
        name: which.
        box: where goals come from.
        seed: of what is remembered.

    Raises:
        ValueError: for an unknown name.
    """
    if name == INTERMEDIATE:
        return Intermediate(box)
    if name not in ACHIEVED:
        raise ValueError(f"unknown curriculum {name!r}; known are {', '.join(CURRICULA)}")
    return ACHIEVED[name](box, seed)
