"""Two or more policies on the same goals: which differences are more than chance, and what ranks they allow."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.metrics.statistics import Estimate, normal_quantile

_LEAST = 1e-12


def mcnemar(first_only: int, second_only: int) -> float:
    """Exact two-sided p-value of McNemar's test (1947): a fair coin for each goal that only one of two reaches.

    Args:
        first_only: goals that only the first reaches.
        second_only: goals that only the second reaches.

    Raises:
        ValueError: for negative counts.
    """
    if min(first_only, second_only) < 0:
        raise ValueError(f"counts must not be negative, got {first_only} and {second_only}")
    tossed = first_only + second_only
    all_ways = math.lgamma(tossed + 1) - tossed * math.log(2.0)
    tail = math.fsum(
        math.exp(all_ways - math.lgamma(heads + 1) - math.lgamma(tossed - heads + 1))
        for heads in range(min(first_only, second_only) + 1)
    )
    return min(1.0, 2.0 * tail)


def sign_flip(differences: ArrayLike) -> float:
    """Exact two-sided p-value of the paired permutation test (Fisher 1935): every difference may have either sign.

    Where all differences have the same size it is McNemar's test; so it is what that becomes where each goal is flown
    several times. The distribution of the sum over all 2ⁿ signs comes from its characteristic function, a product of
    cosines; what comes out below 1e-12 cannot be told from rounding and is returned as that.

    Args:
        differences: whole numbers, one for each goal, such as flights that reached less those of the other policy.
    """
    given = np.asarray(differences, dtype=np.int64)
    sizes, counts = np.unique(np.abs(given[given != 0]), return_counts=True)
    if len(sizes) < 2:
        return mcnemar(int((given > 0).sum()), int((given < 0).sum()))
    sizes = sizes // np.gcd.reduce(sizes)
    observed = int(abs(given.sum()) // np.gcd.reduce(np.abs(given)))
    furthest = int((sizes * counts).sum())
    places = 2 * furthest + 1
    turns = 2.0 * np.pi / places * np.arange(places)
    characteristic = np.ones(places)
    for size, count in zip(sizes, counts, strict=True):
        characteristic *= np.cos(turns * size) ** count
    chances = np.clip(np.fft.fft(characteristic).real / places, 0.0, None)  # of 0, 1, …, furthest, −furthest, …, −1
    beyond = 2.0 * float(chances[observed : furthest + 1].sum()) if observed else 1.0
    return min(1.0, max(beyond, _LEAST))


def paired_difference(differences: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean difference of two success rates on the same goals, with an interval over goals.

    Bonett and Price (2012, "Adjusted Wald confidence interval for a difference of binomial proportions based on paired
    data"): one goal more that only the first reaches, and one that only the second does, so that the interval has a
    width even where both reach the same goals.

    Args:
        differences: for each goal the share of its flights that reached it less the other policy's, in [−1, 1].
        confidence: how often such an interval holds the true value, in (0, 1).

    Raises:
        ValueError: for no goals, or a confidence outside of (0, 1).
    """
    given = np.asarray(differences, dtype=np.float64)
    if not given.size:
        raise ValueError("a difference takes at least one goal")
    count = len(given) + 2
    middle = float(given.sum()) / count
    variance = (float((given * given).sum()) + 2.0) / count - middle * middle
    half = normal_quantile(confidence) * math.sqrt(variance / count)
    return Estimate(float(given.mean()), max(middle - half, -1.0), min(middle + half, 1.0))


def holm(p_values: ArrayLike) -> NDArray[np.float64]:
    """P-values adjusted for how many there are (Holm 1979): those below α keep the chance of any false finding below α.

    Args:
        p_values: shape (M,).
    """
    given = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    adjusted = np.empty_like(given)
    adjusted[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(len(given), 0, -1)), 1.0)
    return adjusted


class RankInterval(NamedTuple):
    """First and last rank that a policy may have; 1 is the best."""

    low: int
    high: int


def rank_intervals(better: ArrayLike) -> list[RankInterval]:
    """Ranks that pairwise findings leave open.

    A policy stands behind all that are found better than it and before all that it is found better than. Where the
    chance of any false finding is below α, as after `holm`, all intervals hold the true ranks at once with a confidence
    of 1 − α (Mogstad, Romano, Shaikh and Wilhelm 2024, "Inference for ranks", Review of Economic Studies 91).

    Args:
        better: shape (K, K), whether the policy of the row has been found better than that of the column.

    Raises:
        ValueError: unless it is square.
    """
    found = np.asarray(better, dtype=np.bool_)
    if found.ndim != 2 or found.shape[0] != found.shape[1]:
        raise ValueError(f"findings must have the shape (K, K), got {found.shape}")
    ahead, behind = found.sum(axis=0), found.sum(axis=1)
    return [RankInterval(1 + int(a), len(found) - int(b)) for a, b in zip(ahead, behind, strict=True)]
