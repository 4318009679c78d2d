"""Means, spreads and intervals."""

import statistics
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
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie in (0, 1), got {confidence}")
    z = statistics.NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    among = np.maximum(tried, 1.0)
    share = found / among
    middle = share + z * z / (2.0 * among)
    half = z * np.sqrt(share * (1.0 - share) / among + z * z / (4.0 * among * among))
    scale = 1.0 + z * z / among
    # The ends at no success and at nothing but successes are exactly 0 and 1; rounding must not push them past that.
    low = np.where((tried == 0) | (found == 0), 0.0, (middle - half) / scale)
    high = np.where((tried == 0) | (found == tried), 1.0, (middle + half) / scale)
    return Interval(low, high)
