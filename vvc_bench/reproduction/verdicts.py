"""Whether figures of ours agree with the paper's."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from vvc_bench.metrics import Estimate, Spread
from vvc_bench.page import number, significant

AGREE, DIFFER = "agree", "differ"
NOT_RUN, NO_FIGURE = "not run at this budget", "no paper figure at hand"

COVERAGE_TOLERANCE = 0.5
"""Points: a fifth of the smallest step between two neighbouring sets of IRPO in Table 1 (76.22 to 78.55 %)."""
SPREAD_TOLERANCE = 0.1
"""Of the paper's standard deviation over flights, by which means may be apart: half of what Cohen calls a small effect
(0.2; "Statistical power analysis for the behavioral sciences", 1988)."""
OTHER_TOLERANCE = 0.02
"""Of the paper's figure, for counts, and for means of unknown deviation. The same flights with the paper's binaries
differ in their counts by less than 0.1 % (`vvc_bench.metrics.PUBLISHED`), but ours come of another guidance law."""


class Verdict(NamedTuple):
    """What is found of a row."""

    verdict: str
    """One of `AGREE`, `DIFFER`, `NOT_RUN`, `NO_FIGURE`."""
    detail: str = ""
    """By how much, or why."""

    def __str__(self) -> str:
        return f"{self.verdict}: {self.detail}" if self.detail else self.verdict


class Measure(NamedTuple):
    """A column of Table 1 for people."""

    title: str
    unit: str
    decimals: int


TABLE_1: Mapping[str, Measure] = {
    "trajectories": Measure("trajectories", "", 0),
    "coverage_percent": Measure("coverage", "%", 2),
    "length_steps": Measure("length", "steps", 1),
    "transitions": Measure("transitions", "", 0),
    "speed_error_mps": Measure("speed error", "m/s", 2),
    "path_angle_error_deg": Measure("path angle error", "°", 2),
    "azimuth_error_deg": Measure("azimuth error", "°", 2),
}
_POINTS = "coverage_percent"


def judge_set(ours: Mapping[str, Any], paper: Mapping[str, float | Spread], *, run: bool) -> Verdict:
    """A set's row of Table 1 beside the paper's.

    A set is what it is: its figures have no interval, and a mean agrees with the paper's if it is near by the
    tolerances of this module.

    Args:
        ours: column → figure, or mean and deviation as ``{"mean": …, "std": …}``.
        paper: column → figure; columns may be missing.
        run: whether ours is the whole set.
    """
    if not paper:
        return Verdict(NO_FIGURE)
    if not run:
        return Verdict(NOT_RUN)
    apart = [_apart(column, _mean(ours[column]), figure) for column, figure in paper.items()]
    differing = "; ".join(filter(None, apart))
    return Verdict(DIFFER, differing) if differing else Verdict(AGREE)


def _mean(figure: Any) -> float:
    return float(figure["mean"] if isinstance(figure, Mapping) else figure)


def _apart(column: str, ours: float, paper: float | Spread) -> str:
    """By how much two figures differ, if they do."""
    theirs = paper.mean if isinstance(paper, Spread) else paper
    by = ours - theirs
    if abs(by) <= tolerance(column, paper):
        return ""
    title, unit, decimals = TABLE_1[column]
    shown = _points(by) if column == _POINTS else f"{_unsigned(by, decimals)} {unit}".strip().replace(" °", "°")
    return f"{title} {_side(by)} by {shown}"


def tolerance(column: str, paper: float | Spread) -> float:
    """By how much a figure of Table 1 may differ from the paper's and still agree with it."""
    if column == _POINTS:
        return COVERAGE_TOLERANCE
    if isinstance(paper, Spread) and not math.isnan(paper.std):
        return SPREAD_TOLERANCE * paper.std
    return OTHER_TOLERANCE * (paper.mean if isinstance(paper, Spread) else paper)


def judge_smoothness(ours: Sequence[float], paper: Sequence[float] | None, *, run: bool) -> Verdict:
    """A variable's row of Table 12, s1 and s2, beside the paper's, where NaN stands for what is not known."""
    if paper is None:
        return Verdict(NO_FIGURE)
    if not run:
        return Verdict(NOT_RUN)
    pairs = zip(("s1", "s2"), ours, paper, strict=True)
    differing = "; ".join(
        f"{name} {_side(mine - theirs)} by {significant(abs(mine - theirs))}"
        for name, mine, theirs in pairs
        if abs(mine - theirs) > OTHER_TOLERANCE * theirs  # never for NaN
    )
    return Verdict(DIFFER, differing) if differing else Verdict(AGREE)


def judge_learner(ours: Estimate, paper_percent: float | None, *, run: bool) -> Verdict:
    """A learner's share of goals reached beside the paper's: they agree where the paper's lies in our 95 % interval.

    Args:
        ours: in percent.
        paper_percent: None where it is not at hand.
        run: whether ours was trained as the paper's.
    """
    if paper_percent is None:
        return Verdict(NO_FIGURE)
    if not run:
        return Verdict(NOT_RUN)
    if ours.low <= paper_percent <= ours.high:
        return Verdict(AGREE)
    by = ours.value - paper_percent
    return Verdict(DIFFER, f"{_side(by)} by {_points(by)}")


def _side(by: float) -> str:
    return "above" if by > 0.0 else "below"


def _points(by: float) -> str:
    return f"{_unsigned(by, 2)} points"


def _unsigned(by: float, decimals: int) -> str:
    return number(abs(by), decimals)
