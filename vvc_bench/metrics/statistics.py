"""Means, spreads and intervals."""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Spread(NamedTuple):
    """Mean and standard deviation of the values themselves (divided by their number); NaN where there are none."""

    mean: float
    std: float


def spread(values: ArrayLike) -> Spread:
    """Mean ± standard deviation of all values that are not NaN."""
    given = np.asarray(values, dtype=np.float64)
    given = given[~np.isnan(given)]
    return Spread(float(given.mean()), float(given.std())) if given.size else Spread(float("nan"), float("nan"))


class Interval(NamedTuple):
    """Lower and upper ends, of the shape that was asked for."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]


def wilson_interval(successes: ArrayLike, trials: ArrayLike, confidence: float = 0.95) -> Interval:
    """Where a success probability lies, given so many successes in so many trials (Wilson 1927, without correction).

    Args:
        successes: any shape.
        trials: of the same shape; without trials the interval is 0 to 1.
        confidence: how often such an interval holds the true value, in (0, 1).

    Raises:
        ValueError: for more successes than trials, negative counts, or a confidence outside of (0, 1).
    """
    found, tried = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    if not ((found >= 0) & (found <= tried)).all():
        raise ValueError("successes must lie between 0 and trials")
    z = normal_quantile(confidence)
    among = np.maximum(tried, 1.0)
    share = found / among
    middle = share + z * z / (2.0 * among)
    half = z * np.sqrt(share * (1.0 - share) / among + z * z / (4.0 * among * among))
    scale = 1.0 + z * z / among
    # The ends at no success and at nothing but successes are exactly 0 and 1; rounding must not push them past that.
    low = np.where((tried == 0) | (found == 0), 0.0, (middle - half) / scale)
    high = np.where((tried == 0) | (found == tried), 1.0, (middle + half) / scale)
    return Interval(low, high)


def normal_quantile(confidence: float) -> float:
    """How many standard deviations to either side hold a normal variable that often.

    Raises:
        ValueError: for a confidence outside of (0, 1).
    """
    _check_confidence(confidence)
    return statistics.NormalDist().inv_cdf((1.0 + confidence) / 2.0)


def student_quantile(confidence: float, degrees_of_freedom: int) -> float:
    """The same for Student's t with a whole number of degrees of freedom (Abramowitz and Stegun, 26.7.3 and 26.7.4).

    Raises:
        ValueError: for a confidence outside of (0, 1), or no degree of freedom.
    """
    _check_confidence(confidence)
    if degrees_of_freedom < 1:
        raise ValueError(f"Student's t takes at least one degree of freedom, got {degrees_of_freedom}")
    low, high = 0.0, math.pi / 2.0
    while (middle := (low + high) / 2.0) not in (low, high):
        low, high = (middle, high) if _student_share(middle, degrees_of_freedom) < confidence else (low, middle)
    return math.tan(middle) * math.sqrt(degrees_of_freedom)


def _student_share(angle: float, degrees_of_freedom: int) -> float:
    """Probability of |t| below √ν·tan(angle)."""
    odd = degrees_of_freedom % 2
    cosine, total = math.cos(angle), 0.0
    term = cosine if odd else 1.0
    for k in range(1 + odd, degrees_of_freedom, 2):
        total += term
        term *= k / (k + 1) * cosine * cosine
    total *= math.sin(angle)
    return (angle + total) * 2.0 / math.pi if odd else total


def _check_confidence(confidence: float) -> None:
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie in (0, 1), got {confidence}")


# Several runs (Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice", whose
# package rliable ignores its seed; here every random number comes from the generator that is given)


class Estimate(NamedTuple):
    """A statistic and where its true value lies; both ends NaN where there are too few runs to tell."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: ArrayLike) -> NDArray[np.float64]:
    """Mean of the middle half along the last axis: ⌊N/4⌋ values are left out at either end, as rliable does.

    Raises:
        ValueError: for no values.
    """
    given = np.asarray(scores, dtype=np.float64)
    if not given.size:
        raise ValueError("the interquartile mean takes at least one value")
    cut = given.shape[-1] // 4
    kept = np.sort(given, axis=-1)[..., cut : given.shape[-1] - cut]
    middle: NDArray[np.float64] = kept.mean(axis=-1)
    return middle


def bootstrap_interquartile_mean(
    tasks: Sequence[ArrayLike],
    generator: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 2_000,
) -> Estimate:
    """Interquartile mean over all runs on all tasks, with an interval from a bootstrap stratified by task.

    Runs are drawn again with replacement within each task. The interval is the value ± t·s: s is the standard deviation
    over the resamples, each task's scores spread by √(n/(n − 1)) about their mean, as draws from n runs vary by so much
    less than runs do; t is Student's quantile (Hesterberg 2015, "What teachers should know about the bootstrap"), with
    Satterthwaite's degrees of freedom (1946) from what each task adds to the variance of the middle half. Percentile
    and BCa intervals are too narrow with as few runs as are usual; docs/comparing.md has the coverage of each.

    Args:
        tasks: for each task the scores of its runs; tasks may differ in how many runs they have.
        generator: draws the resamples.
        confidence: how often such an interval holds the true value, in (0, 1).
        resamples: how many.

    Raises:
        ValueError: for no task, a task without runs, scores that are not finite, or a confidence outside of (0, 1).
    """
    scores = [np.asarray(task, dtype=np.float64).reshape(-1) for task in tasks]
    if not scores or not all(len(task) and np.isfinite(task).all() for task in scores):
        raise ValueError("every task needs at least one run, and every run a finite score")
    value = float(interquartile_mean(np.concatenate(scores)))
    if min(map(len, scores)) < 2:
        return Estimate(value, float("nan"), float("nan"))
    resampled = [_spread_out(task)[generator.integers(len(task), size=(resamples, len(task)))] for task in scores]
    deviation = float(interquartile_mean(np.concatenate(resampled, axis=1)).std())
    half = deviation * student_quantile(confidence, _degrees_of_freedom(scores))
    return Estimate(value, value - half, value + half)


def _spread_out(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    mean = scores.mean()
    wider: NDArray[np.float64] = mean + math.sqrt(len(scores) / (len(scores) - 1)) * (scores - mean)
    return wider


def _degrees_of_freedom(tasks: Sequence[NDArray[np.float64]]) -> int:
    """Of the variance that is estimated from all tasks: those whose runs lie in the middle half decide."""
    ordered = np.sort(np.concatenate(tasks))
    cut = len(ordered) // 4
    counts = np.array([len(task) for task in tasks])
    within = [np.clip(task, ordered[cut], ordered[-1 - cut]) for task in tasks]
    added = counts * np.array([task.var(ddof=1) for task in within])
    total = added.sum()
    return max(1, round(float(total * total / (added * added / (counts - 1)).sum()))) if total > 0.0 else 1
