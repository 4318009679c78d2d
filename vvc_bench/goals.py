"""Where goals come from: distributions that an environment draws from at each reset, and that a curriculum may replace.

A goal is three numbers in outside units: speed in m/s, path angle and azimuth in degrees. A distribution is anything
with ``sample(generator) -> goal``; a plain function of a generator will do too (`as_distribution`).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.sim.fields import Goal, columns, field_array

GOAL_COLUMNS = tuple(columns(Goal))
"""Names of a goal's components with their units."""

_LOW, _HIGH, SCALE = (field_array(Goal, attribute) for attribute in ("low", "high", "scale"))
_ROUNDING = 1e-12  # relative, of a bound on its way to other units and back


def check_goals(goals: NDArray[np.float64]) -> None:
    """Refuse goals that are not finite or out of bounds.

    Args:
        goals: shape (..., 3), in SI units and radians.

    Raises:
        ValueError: names the first component that is out of bounds, in outside units.
    """
    outside = ~((goals >= _LOW * (1.0 + _ROUNDING)) & (goals <= _HIGH * (1.0 + _ROUNDING)))
    if not outside.any():
        return
    first = tuple(np.argwhere(outside)[0])
    k = first[-1]
    raise ValueError(
        f"goal {GOAL_COLUMNS[k]} must be a finite number in [{_LOW[k] * SCALE[k]:g}, {_HIGH[k] * SCALE[k]:g}], "
        f"got {goals[first] * SCALE[k]:g}"
    )


def checked_goals(goals: ArrayLike) -> NDArray[np.float64]:
    """One goal or several, as float64.

    Args:
        goals: shape (3,) or (N, 3): speed in m/s, path angle and azimuth in degrees.

    Raises:
        ValueError: for another shape, NaN, or a value out of bounds (0..1000 m/s, ±90°, ±180°).
    """
    array = np.array(goals, dtype=np.float64)
    if array.ndim not in (1, 2) or array.shape[-1] != len(GOAL_COLUMNS):
        raise ValueError(f"a goal is ({', '.join(GOAL_COLUMNS)}), shape (3,) or (N, 3); got shape {array.shape}")
    check_goals(array / SCALE)
    return array


class GoalDistribution(Protocol):
    """Anything that goals can be drawn from."""

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal, shape (3,), in outside units."""
        ...


@dataclass(frozen=True)
class UniformBox:
    """Goals uniform in a box: ``UniformBox((100, -85, -170), (300, 85, 170))``."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        low, high = checked_goals(self.low), checked_goals(self.high)
        if (low > high).any():
            raise ValueError(f"a box needs low ≤ high, got {self.low} and {self.high}")

    @functools.cached_property
    def _corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return np.array(self.low), np.array(self.high) - self.low

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal, each component uniform on its own."""
        low, width = self._corners
        goal: NDArray[np.float64] = low + width * generator.random(3)
        return goal


class GoalList:
    """Goals from a list, with weights if given."""

    def __init__(self, goals: ArrayLike, weights: ArrayLike | None = None) -> None:
        self.goals = np.atleast_2d(checked_goals(goals))
        self.goals.flags.writeable = False
        self._cumulative = _cumulative(weights, len(self.goals))

    def __len__(self) -> int:
        return len(self.goals)

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One of the goals."""
        goal: NDArray[np.float64] = self.goals[np.searchsorted(self._cumulative, generator.random(), side="right")]
        return goal.copy()


def grid(speeds_mps: Sequence[float], path_angles_deg: Sequence[float], azimuths_deg: Sequence[float]) -> GoalList:
    """Every combination of three axes, azimuth fastest."""
    axes = np.meshgrid(speeds_mps, path_angles_deg, azimuths_deg, indexing="ij")
    return GoalList(np.stack(axes, axis=-1).reshape(-1, 3))


class Mixture:
    """Each goal from one of several distributions, chosen with the given weights."""

    def __init__(self, parts: Sequence[object], weights: ArrayLike | None = None) -> None:
        if not parts:
            raise ValueError("a mixture needs at least one part")
        self.parts = tuple(as_distribution(part) for part in parts)
        self._cumulative = _cumulative(weights, len(self.parts))

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """One goal of one of the parts."""
        part = self.parts[np.searchsorted(self._cumulative, generator.random(), side="right")]
        return part.sample(generator)


@dataclass(frozen=True)
class FromFunction:
    """Goals from a function of a generator."""

    function: Callable[[np.random.Generator], ArrayLike]

    def sample(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """What the function returns, checked."""
        return checked_goals(self.function(generator))


def as_distribution(source: object) -> GoalDistribution:
    """A distribution from one, from a function of a generator, or from one goal or a list of goals.

    Raises:
        TypeError: for anything else.
        ValueError: for goals that are none.
    """
    if hasattr(source, "sample"):
        return cast(GoalDistribution, source)
    if callable(source):
        return FromFunction(source)
    if isinstance(source, (list, tuple, np.ndarray)):
        return GoalList(source)
    raise TypeError(f"goals must be a distribution, a function of a generator or a list of goals, got {source!r}")


def _cumulative(weights: ArrayLike | None, count: int) -> NDArray[np.float64]:
    share = np.ones(count) if weights is None else np.array(weights, dtype=np.float64)
    if share.shape != (count,) or not np.isfinite(share).all() or (share < 0).any() or share.sum() <= 0:
        raise ValueError(f"weights must be {count} numbers, none negative, not all zero; got {weights!r}")
    total: NDArray[np.float64] = np.cumsum(share) / share.sum()
    total[-1] = 1.0
    return total
