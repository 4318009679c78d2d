"""The sets by name: each a value that says how it is made, so that it can be made again.

A name's meaning never changes: another figure is a new version.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.pid import PidParameters
from vvc_bench.goals import grid
from vvc_bench.rollout.scenario import Scenario


class Axis(NamedTuple):
    """Evenly spaced values, both ends included."""

    low: float
    high: float
    points: int

    @property
    def values(self) -> NDArray[np.float64]:
        """Shape (points,)."""
        return np.linspace(self.low, self.high, self.points)


class GoalGrid(NamedTuple):
    """Every combination of three axes, azimuth fastest."""

    speed_mps: Axis
    path_angle_deg: Axis
    azimuth_deg: Axis

    @property
    def goals(self) -> NDArray[np.float64]:
        """Shape (K, 3), in outside units."""
        return grid(*(axis.values.tolist() for axis in self)).goals


@dataclass(frozen=True)
class FlownByLaw:
    """Every goal of the grid flown by the guidance law of Appendix C; what reaches is kept."""

    grid: GoalGrid
    parameters: PidParameters


@dataclass(frozen=True)
class Mirrored:
    """Another set and its mirror image, left for right (Appendix D); of two flights to one goal the shorter is kept."""

    parent: str
    resimulate: bool
    """Fly the mirrored commands anew and keep what reaches, in place of mirroring what was recorded."""


@dataclass(frozen=True)
class Updated:
    """Another set, after a policy has flown every goal: its flights are kept where they are new or shorter (IRPO)."""

    grid: GoalGrid
    parent: str
    policy: str


Recipe: TypeAlias = FlownByLaw | Mirrored | Updated


class Published(NamedTuple):
    """What the paper says of the set of its own that a set stands for (Table 1), and where that is kept."""

    name: str
    openml_id: int
    coverage_percent: float | None = None
    episodes: int | None = None


@dataclass(frozen=True)
class Specification:
    """A set as a function of code, specification and seed."""

    name: str
    summary: str
    scenario: Scenario
    recipe: Recipe | None
    """None for a name that is reserved."""
    seed: int = 0
    published: Published | None = None


PAPER_GRID = GoalGrid(Axis(100.0, 300.0, 21), Axis(-85.0, 85.0, 35), Axis(-170.0, 170.0, 69))
"""Appendix D, Table 5: steps of 10 m/s, 5° and 5°, 50,715 goals."""
