"""What flights are worth: accuracy, coverage, smoothness, wear."""

from vvc_bench.metrics.accuracy import final_errors, returns
from vvc_bench.metrics.coverage import Coverage, Region, coverage, reached_goals
from vvc_bench.metrics.integrity import Integrity, integrity
from vvc_bench.metrics.optimality import BestLengths, TimeOptimality, best_lengths, length_ratios, time_optimality
from vvc_bench.metrics.published import PUBLISHED, PublishedFigures
from vvc_bench.metrics.response import Response, Responses, responses
from vvc_bench.metrics.smoothness import Smoothness, action_smoothness, observation_smoothness
from vvc_bench.metrics.statistics import Interval, Spread, spread, wilson_interval
from vvc_bench.metrics.summary import Summary, Table1, Table12, VariableSmoothness, summary
from vvc_bench.metrics.wear import EpisodeWear, Wear, episode_wear, wear

__all__ = [
    "PUBLISHED",
    "BestLengths",
    "Coverage",
    "EpisodeWear",
    "Integrity",
    "Interval",
    "PublishedFigures",
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
    "coverage",
    "episode_wear",
    "final_errors",
    "integrity",
    "length_ratios",
    "observation_smoothness",
    "reached_goals",
    "responses",
    "returns",
    "spread",
    "summary",
    "time_optimality",
    "wear",
    "wilson_interval",
]
