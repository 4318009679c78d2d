"""A table of flights in a few numbers, the same wherever the flights are."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.protocols import Protocol
from vvc_bench.metrics import coverage, spread, wilson_interval
from vvc_bench.metrics.documents import plain
from vvc_bench.version import __version__


def summarise(
    episodes: pd.DataFrame,
    protocol: Protocol,
    policy: Mapping[str, str | None],
    seeds: Sequence[int],
    training_set: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The document ``summary.json``: plain values, floats to nine digits.

    Lengths, time ratios and errors are those of the flights that reached their goals; the rest is of all.

    Args:
        episodes: columns as in `vvc_bench.evaluation.columns`.
        protocol: what was flown.
        policy: what the agent says of itself.
        seeds: those of the evaluation.
        training_set: ``name`` and ``hash``, where the table says which goals were in it.
    """
    reached = episodes[episodes[names.SUCCESS]]
    every_wear = [name for name in names.episode_columns(protocol.scenario.settings) if name not in names.ALWAYS]
    document: dict[str, Any] = {
        "protocol": {"name": protocol.name, "hash": protocol.hash, "episodes": len(protocol)},
        "policy": dict(policy),
        "seeds": list(seeds),
        "versions": {"vvc_bench": __version__},
        "success": _success(episodes),
        "terminations": {str(name): int(count) for name, count in episodes[names.TERMINATION].value_counts().items()},
        names.LENGTH: spread(reached[names.LENGTH]),
        names.TIME_RATIO: spread(reached[names.TIME_RATIO]),
        names.RETURN: spread(episodes[names.RETURN]),
        **{name: spread(reached[name]) for name in names.ERRORS},
        **{name: spread(episodes[name]) for name in (names.MINIMUM_ALTITUDE, names.MAXIMUM_LOAD, names.CLIPPED)},
        "wear": {name: spread(episodes[name]) for name in every_wear},
        "regions": _regions(episodes, protocol.edges),
        "conditions": [_success(part) for _, part in episodes.groupby(names.CONDITION)],
        "by_seed": [{"seed": seed, **_success(episodes[episodes[names.SEED] == seed])} for seed in seeds],
    }
    if protocol.sub_goals:
        counts = episodes[names.SUB_GOALS_REACHED]
        document[names.SUB_GOALS_REACHED] = [int((counts > k).sum()) for k in range(len(protocol.sub_goals))]
    if training_set is not None:
        document["training_set"] = dict(training_set)
        document["seen"] = _success(episodes[episodes[names.SEEN]])
        document["unseen"] = _success(episodes[~episodes[names.SEEN]])
    summary: dict[str, Any] = plain(document)
    return summary


def _success(episodes: pd.DataFrame) -> dict[str, Any]:
    """How many flights reached, and the 95 % interval (Wilson) of the share."""
    count, flown = int(episodes[names.SUCCESS].sum()), len(episodes)
    interval = wilson_interval(count, flown)
    return {
        "count": count,
        "episodes": flown,
        "rate": count / flown if flown else None,
        "low": float(interval.low),
        "high": float(interval.high),
    }


def _regions(episodes: pd.DataFrame, edges: tuple[NDArray[np.float64], ...] | None) -> dict[str, Any]:
    """Success in slabs along each axis of the goal space."""
    goals = episodes[list(names.GOAL_OF_EPISODE)].to_numpy()
    cells = coverage(goals, episodes[names.SUCCESS].to_numpy(dtype=np.bool_), edges)
    regions = {}
    for axis, name in enumerate(names.GOAL_OF_EPISODE):
        slab = cells.along(axis)
        regions[name] = {
            "edges": cells.edges[axis],
            "episodes": slab.flown,
            "count": slab.reached,
            **slab.interval._asdict(),
        }
    return regions
