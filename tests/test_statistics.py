"""Intervals hold what they say as often as they say; tests agree with enumeration; ranks claim no more than that."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from vvc_bench import metrics
from vvc_bench.metrics.statistics import student_quantile

# Several runs


def test_the_interquartile_mean_is_rliables() -> None:
    # scipy.stats.trim_mean(values, 0.25), which rliable calls, on the same numbers.
    assert metrics.interquartile_mean([0.0, 1.0, 5.0, 100.0]) == 3.0
    assert metrics.interquartile_mean([0.0, 1.0, 5.0, 6.0, 100.0]) == 4.0
    assert metrics.interquartile_mean([2.0, 0.0, 100.0]) == 34.0
    np.testing.assert_array_equal(metrics.interquartile_mean(np.arange(24.0).reshape(3, 8)), [3.5, 11.5, 19.5])
    with pytest.raises(ValueError, match="at least one value"):
        metrics.interquartile_mean([])


def test_students_quantiles_are_the_tables() -> None:
    # Abramowitz and Stegun, table 26.10.
    for freedom, value in ((1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (10, 2.228), (30, 2.042), (120, 1.980)):
        assert student_quantile(0.95, freedom) == pytest.approx(value, abs=6e-4)
    assert student_quantile(0.99, 9) == pytest.approx(3.250, abs=6e-4)
    with pytest.raises(ValueError, match="one degree of freedom"):
        student_quantile(0.95, 0)


def test_the_bootstrap_follows_its_generator_alone() -> None:
    tasks = [[0.1, 0.4, 0.3], [0.8, 0.9, 0.95, 0.7]]

    def drawn(seed: int) -> metrics.Estimate:
        return metrics.bootstrap_interquartile_mean(tasks, np.random.default_rng(seed))

    first = drawn(1)
    np.random.seed(7)  # noqa: NPY002  (what must not matter)
    assert drawn(1) == first
    assert drawn(2) != first
    assert drawn(2).value == first.value
    assert first.low < first.value < first.high


def test_runs_are_drawn_within_their_task() -> None:
    """Tasks of different difficulty widen no interval: only runs differ by chance."""
    alike = [np.full(5, score) for score in (0.1, 0.5, 0.9)]
    estimate = metrics.bootstrap_interquartile_mean(alike, np.random.default_rng(0))
    assert estimate == (pytest.approx(0.5),) * 3


def test_one_run_has_no_interval() -> None:
    estimate = metrics.bootstrap_interquartile_mean([[0.5], [0.2, 0.3]], np.random.default_rng(0))
    assert estimate.value == pytest.approx(1 / 3)
    assert math.isnan(estimate.low)
    assert math.isnan(estimate.high)
    for tasks in ([], [[]], [[0.5, math.nan]]):
        with pytest.raises(ValueError, match="at least one run"):
            metrics.bootstrap_interquartile_mean(tasks, np.random.default_rng(0))


# Coverage


def wilson_coverage(trials: int, chance: float, repeats: int, generator: np.random.Generator) -> float:
    interval = metrics.wilson_interval(generator.binomial(trials, chance, size=repeats), np.full(repeats, trials))
    return float(((interval.low <= chance) & (chance <= interval.high)).mean())


def bootstrap_coverage(runs: int, means: list[float], repeats: int, generator: np.random.Generator) -> float:
    """How often the interval holds the interquartile mean of normal scores, of as many tasks as there are means."""
    truth = metrics.interquartile_mean(np.add.outer(_normal_scores(200_001), means).reshape(-1))
    found = 0
    for _ in range(repeats):
        tasks = [mean + 0.1 * generator.standard_normal(runs) for mean in means]
        estimate = metrics.bootstrap_interquartile_mean(tasks, generator, resamples=400)
        found += estimate.low <= truth <= estimate.high
    return found / repeats


def _normal_scores(count: int) -> np.ndarray:
    import statistics

    normal = statistics.NormalDist(0.0, 0.1)
    return np.array([normal.inv_cdf((k + 0.5) / count) for k in range(count)])


FOUR_TASKS = [0.3, 0.5, 0.7, 0.9]


@pytest.mark.parametrize("chance", [0.02, 0.2, 0.5, 0.9])
def test_wilson_intervals_cover(chance: float) -> None:
    assert wilson_coverage(1000, chance, 100_000, np.random.default_rng(1)) == pytest.approx(0.95, abs=0.01)


def test_bootstrap_intervals_cover() -> None:
    # 1,500 repeats leave a standard error of 0.6 %.
    assert bootstrap_coverage(5, FOUR_TASKS, 1500, np.random.default_rng(2)) == pytest.approx(0.95, abs=0.016)


@pytest.mark.slow
@pytest.mark.parametrize(("runs", "means"), [(5, FOUR_TASKS), (10, FOUR_TASKS), (20, [0.7])])
def test_bootstrap_intervals_cover_within_one_percent(runs: int, means: list[float]) -> None:
    assert bootstrap_coverage(runs, means, 20_000, np.random.default_rng(3)) == pytest.approx(0.95, abs=0.01)


def test_paired_differences_cover() -> None:
    generator = np.random.default_rng(4)
    chances = [0.05, 0.12, 0.83]  # only the first reaches, only the second, neither or both
    drawn = generator.multinomial(1000, chances, size=2000)
    estimates = [metrics.paired_difference(np.repeat([1.0, -1.0, 0.0], counts)) for counts in drawn]
    covered = np.mean([estimate.low <= -0.07 <= estimate.high for estimate in estimates])
    assert covered == pytest.approx(0.95, abs=0.015)


def test_equal_outcomes_leave_a_difference_open() -> None:
    estimate = metrics.paired_difference(np.zeros(100))
    assert estimate.value == 0.0
    assert estimate.low == -estimate.high < 0.0
    assert estimate.high < 0.06
    with pytest.raises(ValueError, match="at least one goal"):
        metrics.paired_difference([])


# Tests


def test_mcnemars_test_is_exact() -> None:
    assert metrics.mcnemar(0, 0) == 1.0
    assert metrics.mcnemar(3, 3) == 1.0
    assert metrics.mcnemar(0, 5) == pytest.approx(2 / 32)
    assert metrics.mcnemar(1, 9) == metrics.mcnemar(9, 1) == pytest.approx(2 * 11 / 1024)
    # Agresti, Categorical Data Analysis (2013), table 11.1: 86 and 150 of 1600 changed their mind.
    exact = 2 * sum(math.comb(236, k) for k in range(87)) / 2**236
    assert metrics.mcnemar(86, 150) == pytest.approx(exact, rel=1e-10)
    assert metrics.mcnemar(30_000, 20_000) < 1e-300
    with pytest.raises(ValueError, match="negative"):
        metrics.mcnemar(-1, 2)


def test_sign_flips_are_what_enumeration_finds() -> None:
    generator = np.random.default_rng(5)
    for _ in range(60):
        differences = generator.integers(-4, 5, size=generator.integers(1, 11))
        sums = [abs(sum(d * s for d, s in zip(differences, signs, strict=True)))
                for signs in itertools.product((-1, 1), repeat=len(differences))]  # fmt: skip
        expected = np.mean(np.array(sums) >= abs(differences.sum()))
        assert metrics.sign_flip(differences) == pytest.approx(expected, abs=1e-11)


def test_one_flight_a_goal_makes_sign_flips_mcnemars() -> None:
    differences = np.repeat([1, -1, 0], [20, 41, 900])
    assert metrics.sign_flip(differences) == metrics.mcnemar(20, 41)
    assert metrics.sign_flip(3 * differences) == metrics.mcnemar(20, 41)


def test_no_test_finds_more_than_it_may() -> None:
    """Two equal policies differ at p < 0.05 in at most 5 % of the cases."""
    generator = np.random.default_rng(6)
    draws: tuple[Callable[[], np.ndarray], ...] = (
        lambda: generator.integers(0, 2, 200) - generator.integers(0, 2, 200),
        lambda: generator.binomial(3, 0.4, 200) - generator.binomial(3, 0.4, 200),
    )
    for draw in draws:
        assert np.mean([metrics.sign_flip(draw()) < 0.05 for _ in range(1500)]) < 0.065


def test_holms_correction() -> None:
    # Holm's step-down by hand: 4·0.01, 3·0.02, then never less than the one before.
    np.testing.assert_allclose(metrics.holm([0.02, 0.01, 0.03, 0.9]), [0.06, 0.04, 0.06, 0.9])
    np.testing.assert_allclose(metrics.holm([0.6, 0.7]), [1.0, 1.0])
    assert metrics.holm([]).shape == (0,)


def test_ranks_claim_what_was_found() -> None:
    nothing = np.zeros((3, 3), dtype=bool)
    assert metrics.rank_intervals(nothing) == [(1, 3)] * 3
    first_beats_last = nothing.copy()
    first_beats_last[0, 2] = True
    assert metrics.rank_intervals(first_beats_last) == [(1, 2), (1, 3), (2, 3)]
    assert metrics.rank_intervals(np.triu(np.ones((3, 3)), 1)) == [(1, 1), (2, 2), (3, 3)]
    with pytest.raises(ValueError, match=r"\(K, K\)"):
        metrics.rank_intervals([[True, False]])


def test_rank_intervals_hold_all_true_ranks_at_once() -> None:
    generator = np.random.default_rng(7)
    rates = np.array([0.6, 0.55, 0.55, 0.4])
    held = 0
    for _ in range(300):
        reached = generator.random((4, 400)) < rates[:, None]
        pairs = list(itertools.combinations(range(4), 2))
        differences = [reached[i].astype(int) - reached[j] for i, j in pairs]
        adjusted = metrics.holm([metrics.sign_flip(difference) for difference in differences])
        better = np.zeros((4, 4), dtype=bool)
        for (i, j), difference, p in zip(pairs, differences, adjusted, strict=True):
            better[(i, j) if difference.sum() > 0 else (j, i)] = p < 0.05
        ranks = metrics.rank_intervals(better)
        held += all(ranks[k].low <= 1 + (rates > rates[k]).sum() and ranks[k].high >= (rates >= rates[k]).sum()
                    for k in range(4))  # fmt: skip
    assert held / 300 >= 0.93
