"""Every measure of a set in one value."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics.accuracy import final_errors, returns
from vvc_bench.metrics.coverage import Coverage, coverage, reached_goals
from vvc_bench.metrics.documents import plain
from vvc_bench.metrics.integrity import Integrity, integrity
from vvc_bench.metrics.optimality import BestLengths, TimeOptimality, time_optimality
from vvc_bench.metrics.response import DEFAULT_TASK, Response, ResponseSummary, responses, summarise
from vvc_bench.metrics.smoothness import Smoothness, action_smoothness, observation_smoothness, wraps
from vvc_bench.metrics.statistics import Spread, spread
from vvc_bench.metrics.wear import Wear, wear
from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Observation, columns
from vvc_bench.sim.units import DEGREES_PER_RADIAN


class Table1(NamedTuple):
    """One row of the paper's Table 1."""

    trajectories: int
    coverage_percent: float
    """Goals reached of all goals flown."""
    length_steps: Spread
    transitions: int
    speed_error_mps: Spread
    """Means over the last second, then mean ± std over trajectories; so are the next two."""
    path_angle_error_deg: Spread
    azimuth_error_deg: Spread


class VariableSmoothness(NamedTuple):
    """One variable's entries in Table 12, over trajectories; see `vvc_bench.metrics.smoothness`."""

    s1: Spread
    """In the variable's unit."""
    s2: Spread
    """In the variable's unit for each step."""


class Table12(NamedTuple):
    """One row of the paper's Table 12, by column name."""

    observations: dict[str, VariableSmoothness]
    """Angles as they are, with their jumps of 360°, as in the paper."""
    unwrapped: dict[str, VariableSmoothness]
    """The angles that jump, followed past ±180°."""
    actions: dict[str, VariableSmoothness]


class Summary(NamedTuple):
    """What the flights of a set are worth."""

    table_1: Table1
    table_12: Table12
    returns: Spread
    speed_response: ResponseSummary
    direction_response: ResponseSummary
    wear: Wear
    integrity: Integrity
    coverage: Coverage
    """Cell by cell."""
    time_optimality: TimeOptimality | None
    """Where best lengths were given."""

    def to_json(self) -> dict[str, Any]:
        """The same as a document: plain numbers, units in the names, coverage along each axis of the goal space."""
        document: dict[str, Any] = plain({**self._asdict(), "coverage": _marginals(self.coverage)})
        return document


def summary(episodes: Episodes, goals_flown: ArrayLike, best: BestLengths | None = None) -> Summary:
    """Measure a set.

    Args:
        episodes: its flights.
        goals_flown: shape (G, 3), all goals that were tried, in outside units.
        best: the shortest known flights, to compare with.

    Raises:
        ValueError: if an episode reached a goal that is not among them.
    """
    speed, direction = responses(episodes)
    reached = coverage(*reached_goals(episodes, goals_flown))
    return Summary(
        table_1(episodes, reached),
        table_12(episodes),
        spread(returns(episodes)),
        _summarised(speed, DEFAULT_TASK.speed_band),
        _summarised(direction, DEFAULT_TASK.direction_band * DEGREES_PER_RADIAN),
        wear(episodes),
        integrity(episodes),
        reached,
        None if best is None else time_optimality(episodes, best),
    )


def table_1(episodes: Episodes, reached: Coverage) -> Table1:
    """A set's row of Table 1."""
    errors = final_errors(episodes)
    return Table1(
        len(episodes),
        reached.percent,
        spread(episodes.lengths),
        len(episodes.rewards),
        *(spread(errors[:, k]) for k in range(len(GOAL_COLUMNS))),
    )


def table_12(episodes: Episodes) -> Table12:
    """A set's row of Table 12."""
    unwrapped = _by_column(observation_smoothness(episodes, unwrapped=True))
    jumping = [name for name, field in columns(Observation).items() if wraps(field)]
    return Table12(
        _by_column(observation_smoothness(episodes)),
        {name: unwrapped[name] for name in jumping},
        _by_column(action_smoothness(episodes)),
    )


def _by_column(smoothness: Smoothness) -> dict[str, VariableSmoothness]:
    return {
        name: VariableSmoothness(spread(smoothness.s1[:, k]), spread(smoothness.s2[:, k]))
        for k, name in enumerate(smoothness.columns)
    }


def _summarised(response: Response, band: float) -> ResponseSummary:
    return summarise(response, round(band, 6))


def _marginals(reached: Coverage) -> dict[str, dict[str, NDArray[np.float64] | NDArray[np.int64]]]:
    """Goals flown and reached along each axis, and the 95 % interval of the share."""
    slabs = {name: reached.along(axis) for axis, name in enumerate(GOAL_COLUMNS)}
    return {name: {**slab._asdict(), **slab.interval._asdict()} for name, slab in slabs.items()}
