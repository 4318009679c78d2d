"""What flights are worth: accuracy, coverage, smoothness, wear."""

from vvc_bench.metrics.accuracy import final_errors, returns
from vvc_bench.metrics.coverage import Coverage, Region, coverage, reached_goals
from vvc_bench.metrics.criteria import CRITERIA, coverage_by_criterion
from vvc_bench.metrics.integrity import Integrity, integrity
from vvc_bench.metrics.optimality import BestLengths, TimeOptimality, best_lengths, length_ratios, time_optimality
from vvc_bench.metrics.paired import RankInterval, holm, mcnemar, paired_difference, rank_intervals, sign_flip
from vvc_bench.metrics.published import PUBLISHED, PublishedFigures
from vvc_bench.metrics.response import Response, Responses, responses
from vvc_bench.metrics.smoothness import Smoothness, action_smoothness, observation_smoothness
from vvc_bench.metrics.statistics import (
    Estimate,
    Interval,
    Spread,
    bootstrap_interquartile_mean,
    interquartile_mean,
    spread,
    wilson_interval,
)
from vvc_bench.metrics.summary import Summary, Table1, Table12, VariableSmoothness, summary
from vvc_bench.metrics.wear import EpisodeWear, Wear, episode_wear, wear

__all__ = [
    "CRITERIA",
    "PUBLISHED",
    "BestLengths",
    "Coverage",
    "EpisodeWear",
    "Estimate",
    "Integrity",
    "Interval",
    "PublishedFigures",
    "RankInterval",
    "Region",
    "Response",
    "Responses",
    "Smoothness",
    "Spread",
    "Summary",
    "Table1",
    "Table12",
    "TimeOptimality",
    "VariableSmoothness",
    "Wear",
    "action_smoothness",
    "best_lengths",
    "bootstrap_interquartile_mean",
    "coverage",
    "coverage_by_criterion",
    "episode_wear",
    "final_errors",
    "holm",
    "integrity",
    "interquartile_mean",
    "length_ratios",
    "mcnemar",
    "observation_smoothness",
    "paired_difference",
    "rank_intervals",
    "reached_goals",
    "responses",
    "returns",
    "sign_flip",
    "spread",
    "summary",
    "time_optimality",
    "wear",
    "wilson_interval",
]
