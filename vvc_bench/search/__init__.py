"""Near-optimal flights: for every goal, the plan that takes the fewest steps of all that were tried."""

from vvc_bench.search.flights import FAILED, NICHES
from vvc_bench.search.sweeps import Budget, Found, Neighbours, check_searchable, neighbours, nothing_found, sweep

__all__ = [
    "FAILED",
    "NICHES",
    "Budget",
    "Found",
    "Neighbours",
    "check_searchable",
    "neighbours",
    "nothing_found",
    "sweep",
]
