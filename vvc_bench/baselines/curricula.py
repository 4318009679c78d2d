"""Curricula: goals drawn from where the aircraft has already been, in place of the task's box.

Each is a `vvc_bench.goals.GoalDistribution`, so that any environment takes it as ``goals``; whoever trains tells it
what is achieved (`Curriculum.observe`). The three differ in which of the achieved goals they prefer, as they stand side
by side in Pitis et al. (2020), "Maximum Entropy Gain Exploration for Long Horizon Multi-goal Reinforcement Learning":

- `Rig`: goals from the density of what was achieved. Nair et al. (2018) fit an autoencoder to images for that; three
  numbers take a kernel density estimate.
- `Discern`: uniform over what was achieved, rare and frequent alike: achieved goals, weighted by one over their
  density. Warde-Farley et al. (2019) keep a buffer of goals that is made diverse.
- `Mega`: the achieved goal of the least density among some drawn at random.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.neighbors import KernelDensity

from vvc_bench.goals import UniformBox

_OFFERED = 100
"""Candidates that `Mega` chooses from."""
_BANDWIDTH = 0.05
"""Of the kernels, Gaussian, in sides of the box."""


class Curriculum:
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


class Rig(Curriculum):
    """Goals as they were achieved."""

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        kernel = self._pool[generator.integers(len(self._pool))]
        drawn = kernel + _BANDWIDTH * self._width * generator.standard_normal(3)
        goal: NDArray[np.float64] = np.clip(drawn, self._box.low, self._box.high)
        return goal


class Discern(Curriculum):
    """Goals uniform over what was achieved."""

    def _renew(self) -> None:
        super()._renew()
        weights = np.exp(self._log_density.min() - self._log_density)
        self._cumulative = np.cumsum(weights) / weights.sum()

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        place = np.searchsorted(self._cumulative[:-1], generator.random(), side="right")
        goal: NDArray[np.float64] = self._pool[place].copy()
        return goal


class Mega(Curriculum):
    """Goals that were achieved least."""

    def _choose(self, generator: np.random.Generator) -> NDArray[np.float64]:
        offered = generator.integers(len(self._pool), size=_OFFERED)
        goal: NDArray[np.float64] = self._pool[offered[self._log_density[offered].argmin()]].copy()
        return goal


CURRICULA: Mapping[str, type[Curriculum]] = MappingProxyType({"rig": Rig, "discern": Discern, "mega": Mega})
"""By name."""
