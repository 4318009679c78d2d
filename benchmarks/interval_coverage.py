"""How often 95 % intervals hold the true value: Wilson's for success rates, the bootstrap's for interquartile means.

    python benchmarks/interval_coverage.py [--quick] [--seed 0]

Beside the interval of `vvc_bench.metrics.bootstrap_interquartile_mean` the stratified percentile and BCa intervals of
the same kind of resamples. Scores are success rates, beta-distributed over runs with means that differ by task, from
0.3 to 0.9 (0.7 where there is one task), and standard deviations of 0.1 to 0.17.
"""

import argparse
import statistics
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vvc_bench.metrics import bootstrap_interquartile_mean, interquartile_mean, wilson_interval

RUNS = (3, 5, 10)
TASKS = (1, 4, 12)
RESAMPLES = 400
CONCENTRATION = 8.0

Array = NDArray[np.float64]
NORMAL = statistics.NormalDist()


def wilson_rows(repeats: int, generator: np.random.Generator) -> Iterator[list[str]]:
    for trials in (100, 1000):
        cells = []
        for chance in (0.01, 0.05, 0.2, 0.5, 0.9):
            interval = wilson_interval(generator.binomial(trials, chance, size=repeats), np.full(repeats, trials))
            cells.append(f"{100.0 * ((interval.low <= chance) & (chance <= interval.high)).mean():.1f}")
        yield [f"{trials} goals", *cells]


def scores_of(runs: int, means: Array, generator: np.random.Generator) -> Array:
    """Shape (runs, tasks)."""
    return generator.beta(CONCENTRATION * means, CONCENTRATION * (1.0 - means), size=(runs, len(means)))


def percentile(resampled: Array, *shares: float) -> Array:
    return np.quantile(resampled, shares)


def bca(scores: Array, value: float, resampled: Array) -> Array:
    """Efron (1987), the acceleration from a jackknife within each task."""
    runs, flat = len(scores), scores.ravel()
    below = ((resampled < value).mean() + (resampled <= value).mean()) / 2.0
    bias = NORMAL.inv_cdf(min(max(below, 1e-4), 1.0 - 1e-4))
    kept = ~np.eye(len(flat), dtype=bool)
    without = interquartile_mean(np.broadcast_to(flat, kept.shape)[kept].reshape(len(flat), -1)).reshape(scores.shape)
    influence = (runs - 1) * (without.mean(axis=0) - without)
    spread = float((influence**2).sum())
    acceleration = float((influence**3).sum()) / (6.0 * spread**1.5) if spread else 0.0
    z = [bias + NORMAL.inv_cdf(share) for share in (0.025, 0.975)]
    return percentile(resampled, *(NORMAL.cdf(bias + each / (1.0 - acceleration * each)) for each in z))


def bootstrap_coverage(runs: int, means: Array, repeats: int, generator: np.random.Generator) -> list[str]:
    truth = float(interquartile_mean(scores_of(2_000_000 // len(means), means, generator).ravel()))
    held = np.zeros(3)
    for _ in range(repeats):
        scores = scores_of(runs, means, generator)
        drawn = generator.integers(runs, size=(RESAMPLES, *scores.shape))
        resampled = interquartile_mean(scores[drawn, np.arange(len(means))].reshape(RESAMPLES, -1))
        ours = bootstrap_interquartile_mean(list(scores.T), generator, resamples=RESAMPLES)
        ends = [percentile(resampled, 0.025, 0.975), bca(scores, ours.value, resampled), (ours.low, ours.high)]
        held += [low <= truth <= high for low, high in ends]
    return [f"{100.0 * share:.1f}" for share in held / repeats]


def print_table(header: list[str], rows: Iterator[list[str]]) -> None:
    print("| " + " | ".join(header) + " |\n|---|" + "---:|" * (len(header) - 1))
    for cells in rows:
        print("| " + " | ".join(cells) + " |", flush=True)
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    generator = np.random.default_rng(options.seed)
    repeats = 500 if options.quick else 10_000
    print(f"Coverage of 95 % intervals in percent, {repeats:,} repeats (Wilson: {100 * repeats:,})\n")
    print_table(
        ["success rate of", *(f"{100 * chance:g} %" for chance in (0.01, 0.05, 0.2, 0.5, 0.9))],
        wilson_rows(100 * repeats, generator),
    )
    print_table(
        ["runs × tasks", "percentile", "BCa", "vvc-bench"],
        (
            [f"{runs} × {tasks}", *bootstrap_coverage(runs, means, repeats, generator)]
            for tasks, means in (
                (tasks, np.linspace(0.3, 0.9, tasks) if tasks > 1 else np.array([0.7])) for tasks in TASKS
            )
            for runs in RUNS
        ),
    )


if __name__ == "__main__":
    main()
