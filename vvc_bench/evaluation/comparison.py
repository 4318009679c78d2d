"""Policies on the same goals, goal by goal: who reaches more, where, and whether that is more than chance."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.aggregate import SCORES, Aggregate, aggregate
from vvc_bench.evaluation.evaluate import Evaluation
from vvc_bench.evaluation.methods import Method, protocol_hash, protocol_name
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics import (
    Estimate,
    RankInterval,
    coverage,
    holm,
    paired_difference,
    rank_intervals,
    sign_flip,
    wilson_interval,
)
from vvc_bench.metrics.documents import plain

SIGNIFICANT = 0.05
"""Chance of any false finding among all pairs, below which differences count."""

_SLABS = 4  # of the goal box along each axis, in which wins are counted


class Contender(NamedTuple):
    """How one method did."""

    label: str
    policies: int
    flights: int
    """To each goal: policies times seeds."""
    reached: NDArray[np.int64]
    """Flights that reached each goal, shape (N,)."""
    success: Estimate
    """Rate, with the 95 % Wilson interval of as many trials as there are goals."""
    rank: RankInterval
    aggregates: dict[str, Aggregate]
    """By score."""

    @property
    def shares(self) -> NDArray[np.float64]:
        """Share of the flights to each goal that reached it, shape (N,)."""
        return self.reached / self.flights


class Pair(NamedTuple):
    """One method against another."""

    first: str
    second: str
    first_only: int
    """Goals that the first reaches more often."""
    second_only: int
    difference: Estimate
    """Success rate of the first less that of the second, with a 95 % interval over goals."""
    p_value: float
    """Exact, two-sided: McNemar's test, or with several flights to each goal its generalisation `sign_flip`."""
    adjusted_p_value: float
    """For all pairs that were compared (Holm)."""

    @property
    def better(self) -> str:
        """The one that is found better, or "" for none."""
        if self.adjusted_p_value >= SIGNIFICANT:
            return ""
        return self.first if self.difference.value > 0.0 else self.second


@dataclass(frozen=True)
class Comparison:
    """What `compare` found.

    Args:
        protocol: name and hash.
        goals: shape (N, 3), in outside units.
        contenders: by success rate, the best first.
        pairs: every one of the K(K − 1)/2, the contender that stands before the other first.
    """

    protocol: dict[str, str]
    goals: NDArray[np.float64]
    contenders: tuple[Contender, ...]
    pairs: tuple[Pair, ...]

    def wins(self, pair: Pair) -> NDArray[np.float64]:
        """Share of flights that the first reached each goal with less that of the second, shape (N,)."""
        shares = {contender.label: contender.shares for contender in self.contenders}
        return np.asarray(shares[pair.first] - shares[pair.second])

    def to_json(self) -> dict[str, Any]:
        """The same as a document: plain numbers, and where each of a pair wins along each axis of the goal box."""
        document: dict[str, Any] = plain(
            {
                "protocol": self.protocol | {"goals": len(self.goals)},
                "contenders": [_contender_document(contender) for contender in self.contenders],
                "pairs": [{**pair._asdict(), "better": pair.better, "where": self._where(pair)} for pair in self.pairs],
            }
        )
        return document

    def _where(self, pair: Pair) -> dict[str, dict[str, NDArray[np.float64] | NDArray[np.int64]]]:
        """Goals that either reaches more often, in equal slabs along each axis."""
        wins = self.wins(pair)
        edges = [np.linspace(low, high, _SLABS + 1) for low, high in goal_box(self.goals)]
        counts = [coverage(self.goals, won, edges) for won in (wins > 0, wins < 0)]
        slabs = {name: [count.along(axis) for count in counts] for axis, name in enumerate(GOAL_COLUMNS)}
        return {
            name: {
                "edges": edges[axis],
                "goals": first.flown,
                "first_only": first.reached,
                "second_only": second.reached,
            }
            for axis, (name, (first, second)) in enumerate(slabs.items())
        }


def _contender_document(contender: Contender) -> dict[str, Any]:
    document = contender._asdict() | {"reached": int(contender.reached.sum())}
    document["flights"] = contender.flights * len(contender.reached)
    return document


def goal_box(goals: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Bounds of goals along each axis; never of no width."""
    low, high = goals.min(axis=0), goals.max(axis=0)
    return [(float(a), float(b)) if a < b else (float(a) - 0.5, float(b) + 0.5) for a, b in zip(low, high, strict=True)]


def compare(methods: Sequence[Method], generator: np.random.Generator) -> Comparison:
    """Compare methods on the goals of one protocol.

    The findings are about the policies given, over goals drawn as the protocol's were. For what runs of a method would
    do that were not made, see each contender's interquartile means.

    Args:
        methods: at least two, all evaluated on the same protocol.
        generator: draws the resamples of the interquartile means' intervals.

    Raises:
        ValueError: for fewer than two, labels that occur twice, or evaluations of different protocols.
    """
    protocol, goals = _common_protocol(methods)
    if len(methods) < 2 or len({method.label for method in methods}) < len(methods):
        labels = ", ".join(method.label for method in methods)
        raise ValueError(f"comparing takes two or more evaluations with labels of their own; got {labels}")
    unranked = sorted((_contender(method, len(goals), generator) for method in methods), key=_worst_last)
    pairs = _pairs(unranked)
    places = {contender.label: k for k, contender in enumerate(unranked)}
    better = np.zeros((len(places), len(places)), dtype=np.bool_)
    for pair in pairs:
        if pair.better:
            better[places[pair.better], places[pair.first if pair.better == pair.second else pair.second]] = True
    contenders = (found._replace(rank=rank) for found, rank in zip(unranked, rank_intervals(better), strict=True))
    return Comparison(protocol, goals, tuple(contenders), pairs)


def _worst_last(contender: Contender) -> float:
    return -contender.success.value


def _contender(method: Method, goals: int, generator: np.random.Generator) -> Contender:
    """A method's figures, its rank left open."""
    reached = np.zeros(goals, dtype=np.int64)
    flights = 0
    for evaluation in method.evaluations:
        rows = evaluation.episodes
        reached += np.bincount(rows[names.GOAL], weights=rows[names.SUCCESS], minlength=goals).astype(np.int64)
        flights += len(rows) // goals
    return Contender(
        method.label,
        len(method.evaluations),
        flights,
        reached,
        success_rate(reached / flights),
        RankInterval(1, 1),
        {score: aggregate(method.evaluations, score, generator) for score in SCORES},
    )


def success_rate(shares: NDArray[np.float64]) -> Estimate:
    """Success rate with its 95 % Wilson interval.

    Flights to the same goal tell less than flights to as many goals: the interval is that of one trial for each goal.

    Args:
        shares: share of the flights to each goal that reached it, shape (N,).
    """
    interval = wilson_interval(shares.sum(), len(shares))
    return Estimate(float(shares.mean()), float(interval.low), float(interval.high))


def _pairs(contenders: Sequence[Contender]) -> tuple[Pair, ...]:
    """Every contender against every one behind it."""
    pairs = []
    for first, second in itertools.combinations(contenders, 2):
        differences = first.reached * second.flights - second.reached * first.flights
        estimate = paired_difference(first.shares - second.shares)
        wins = int((differences > 0).sum()), int((differences < 0).sum())
        pairs.append(Pair(first.label, second.label, *wins, estimate, sign_flip(differences), 1.0))
    adjusted = holm([pair.p_value for pair in pairs])
    return tuple(pair._replace(adjusted_p_value=float(p)) for pair, p in zip(pairs, adjusted, strict=True))


def _common_protocol(methods: Sequence[Method]) -> tuple[dict[str, str], NDArray[np.float64]]:
    """Name and hash of the protocol, and its goals.

    Raises:
        ValueError: if there are several protocols.
    """
    every = [evaluation for method in methods for evaluation in method.evaluations]
    flown = {protocol_hash(evaluation): protocol_name(evaluation) for evaluation in every}
    if len(flown) != 1:
        known = ", ".join(f"{name} ({digest[:12]})" for digest, name in flown.items())
        raise ValueError(f"only evaluations of the same protocol can be compared; these are of {known or 'none'}")
    goals = [protocol_goals(evaluation) for evaluation in every]
    if any(not np.array_equal(goals[0], other) for other in goals[1:]):
        raise ValueError("evaluations of the same protocol hold different goals; evaluate again what was changed")
    return {"name": protocol_name(every[0]), "hash": protocol_hash(every[0])}, goals[0]


def protocol_goals(evaluation: Evaluation) -> NDArray[np.float64]:
    """The goals that were flown, in the protocol's order, shape (N, 3)."""
    rows = evaluation.episodes
    first = rows[rows[names.SEED] == rows[names.SEED].iloc[0]]
    return np.asarray(first[list(names.GOAL_OF_EPISODE)], dtype=np.float64)
