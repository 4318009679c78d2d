"""Several runs of a method as one figure: mean ± std as the paper prints it, interquartile mean with its interval."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.evaluate import Evaluation
from vvc_bench.evaluation.methods import protocol_name
from vvc_bench.metrics import Estimate, Spread, bootstrap_interquartile_mean, spread


class Aggregate(NamedTuple):
    """A score over runs; see `aggregate`."""

    runs: dict[str, int]
    """Name of the protocol → how many runs."""
    over: str
    """What a run is: ``policies``, or ``seeds`` of one policy."""
    mean_std: Spread
    """Over all runs; the deviation is that from the mean of each run's protocol."""
    interquartile_mean: Estimate


SCORES = {"success_percent": names.SUCCESS, "return": names.RETURN}
"""What is aggregated, and the column that it is the mean of."""


def aggregate(evaluations: Sequence[Evaluation], score: str, generator: np.random.Generator) -> Aggregate:
    """One score of a method over its runs on one or more protocols.

    A run is an evaluated policy, all its seeds together. Where there is but one policy for each protocol it is a seed:
    the spread is then that of the flights' conditions, not of training.

    Args:
        evaluations: of the runs of one method.
        score: one of `SCORES`.
        generator: draws the bootstrap's resamples, stratified by protocol.

    Raises:
        ValueError: for no evaluation, or an unknown score.
    """
    if score not in SCORES or not evaluations:
        raise ValueError(f"need at least one evaluation and one of the scores {', '.join(SCORES)}; got {score!r}")
    protocols: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        protocols.setdefault(protocol_name(evaluation), []).append(evaluation)
    by_seed = all(len(runs) == 1 for runs in protocols.values())
    tasks = {
        name: _seed_scores(runs[0], score) if by_seed else [float(np.mean(_seed_scores(run, score))) for run in runs]
        for name, runs in protocols.items()
    }
    middle = bootstrap_interquartile_mean(list(tasks.values()), generator)
    if score.endswith("_percent"):
        middle = Estimate(*(float(np.clip(part, 0.0, 100.0)) for part in middle))
    return Aggregate(
        {name: len(scores) for name, scores in tasks.items()},
        "seeds" if by_seed else "policies",
        _spread_within(list(tasks.values())),
        middle,
    )


def _seed_scores(evaluation: Evaluation, score: str) -> list[float]:
    """The score of each seed."""
    scale = 100.0 if score.endswith("_percent") else 1.0
    return [scale * float(value) for value in evaluation.episodes.groupby(names.SEED)[SCORES[score]].mean()]


def _spread_within(tasks: Sequence[Sequence[float]]) -> Spread:
    deviations = [value - np.mean(scores) for scores in tasks for value in scores]
    return Spread(spread([value for scores in tasks for value in scores]).mean, spread(deviations).std)
