"""Whether an evaluation that is claimed can be, and is the one that was flown again."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_string_dtype

from vvc_bench.evaluation import Evaluation, Protocol
from vvc_bench.evaluation.columns import (
    ERRORS,
    GOAL,
    GOAL_OF_EPISODE,
    LENGTH,
    RETURN,
    SEED,
    SUCCESS,
    TERMINATION,
    episode_columns,
)
from vvc_bench.evaluation.summary import summarise

SUCCESS_TOLERANCE, ENDING_TOLERANCE = 0.005, 0.02
"""Shares of the flights that may reach or not, or end by another event, on another kind of machine; two may anyway."""
MEAN_TOLERANCE = 0.01
"""How much a mean over the flights that end alike may differ there, relative to it or to 1."""

SAME_FLIGHTS, LEAST_REACHED = 0.95, 10
"""Policies are the same if so large a share of the goals that either reaches, of so many at least, are reached by both
in the same number of steps. On another machine up to 3 % of the flights take a step more or less."""

_IDENTITY = (SEED, GOAL, *GOAL_OF_EPISODE)
_ROUNDING = 1e-8
"""Between summaries of the same flights, which have floats to nine digits."""
_SHOWN = 5
"""Differences that are told one by one."""


def same_flights(first: pd.DataFrame, second: pd.DataFrame) -> bool:
    """Whether two evaluations on one protocol are of the same policy, as far as flights tell; see `SAME_FLIGHTS`."""
    first, second = (frame[frame[SEED] == frame[SEED].iloc[0]].reset_index(drop=True) for frame in (first, second))
    if len(first) != len(second):
        return False
    either, both = first[SUCCESS] | second[SUCCESS], first[SUCCESS] & second[SUCCESS]
    same = (both & (first[LENGTH] == second[LENGTH])).sum()
    return bool(either.sum() >= LEAST_REACHED and same >= SAME_FLIGHTS * either.sum())


def unfounded(
    claimed: Evaluation, protocol: Protocol, policy: Mapping[str, str | None], seeds: Sequence[int]
) -> list[str]:
    """What is wrong with an evaluation that is claimed, as far as can be told without flying.

    Its flights must be those of the seeds and of the protocol's goals, in their order, and its summary must follow from
    them.

    Args:
        claimed: as submitted.
        protocol: that of the submission.
        policy: what the policy says of itself.
        seeds: those that the submission names.
    """
    disordered = _wrong_flights(claimed.episodes, protocol, seeds)
    if disordered:
        return [disordered]
    again = summarise(claimed.episodes, protocol, policy, seeds)
    found = [
        f"summary {place}: {mine!r} is claimed, {theirs!r} follows from the claimed episodes"
        for place, mine, theirs in _differing_leaves(claimed.summary, again)
    ]
    return _shortened(found)


def differences(claimed: Evaluation, flown: Evaluation, *, exact: bool) -> list[str]:
    """What is claimed and was not flown, each with both numbers; empty if nothing is.

    Args:
        claimed: as submitted, and not `unfounded`.
        flown: as flown again, with the same seeds.
        exact: on the same kind of machine, where every number must be the same. Elsewhere `SUCCESS_TOLERANCE`,
            `ENDING_TOLERANCE` and `MEAN_TOLERANCE` hold.
    """
    if not exact:
        return list(_beyond_tolerance(claimed.episodes, flown.episodes))
    numbers = [
        f"summary {place}: claimed {mine!r}, flown {theirs!r}"
        for place, mine, theirs in _differing_leaves(claimed.summary, flown.summary)
    ]
    return _shortened([*numbers, *_differing_columns(claimed.episodes, flown.episodes)])


def _shortened(found: list[str]) -> list[str]:
    """The success rate first, and not all of the rest."""
    found.sort(key=lambda each: not each.startswith("summary success."))
    return found[:_SHOWN] + ([f"and {len(found) - _SHOWN} more"] if len(found) > _SHOWN else [])


def _wrong_flights(claimed: pd.DataFrame, protocol: Protocol, seeds: Sequence[int]) -> str:
    """Where the flights are not those of the seeds and goals in their order; empty if they are."""
    known = episode_columns(protocol.scenario.settings)
    odd = sorted(set(map(str, claimed)) ^ set(known))
    if odd:
        return f"the claimed episodes {'lack' if odd[0] in known else 'have a foreign'} column {odd[0]}"
    wrong = [name for name, column in known.items() if not _holds(claimed[name], column.dtype)]
    if wrong:
        return f"column {wrong[0]} of the claimed episodes holds {claimed[wrong[0]].dtype}, not {known[wrong[0]].dtype}"
    present = claimed[SEED].unique().tolist()
    if present != list(seeds):
        return f"the submission names seeds {list(seeds)}; its episodes are of seeds {present}"
    goals = np.arange(len(protocol))
    theirs = np.concatenate([np.column_stack([np.full(len(goals), seed), goals, protocol.goals]) for seed in seeds])
    if len(claimed) != len(theirs):
        return f"{len(claimed):,} flights are claimed; the protocol has {len(theirs):,} with these seeds"
    mine = claimed[list(_IDENTITY)].to_numpy(dtype=np.float64)
    rows = np.flatnonzero((mine != theirs).any(axis=1))
    if not rows.size:
        return ""
    first = int(rows[0])
    return (
        f"{len(rows):,} of {len(theirs):,} flights are not where the protocol's order has them; the first is flight "
        f"{first}: claimed {_identity(mine[first])}, in its order {_identity(theirs[first])}"
    )


def _holds(column: "pd.Series[Any]", kind: str) -> bool:
    """Whether a column is of a type; pandas has several for strings."""
    return bool(is_string_dtype(column) if kind == "string" else column.dtype == np.dtype(kind))


def _identity(row: Any) -> str:
    seed, goal, *values = row
    return f"seed {seed:g}, goal {goal:g} ({', '.join(f'{value:g}' for value in values)})"


def _differing_leaves(claimed: Mapping[str, Any], known: Mapping[str, Any]) -> Iterator[tuple[str, object, object]]:
    """Where two summaries differ, and both values; versions do not count."""
    mine, theirs = (dict(_leaves(document)) for document in (claimed, known))
    for place in mine | theirs:
        value, other = mine.get(place, "nothing"), theirs.get(place, "nothing")
        if not place.startswith("versions.") and not _same(value, other):
            yield place, value, other


def _same(first: object, second: object) -> bool:
    if type(first) is float and type(second) is float:
        return math.isclose(first, second, rel_tol=_ROUNDING, abs_tol=_ROUNDING)
    return type(first) is type(second) and first == second


def _leaves(document: object, place: str = "") -> Iterator[tuple[str, object]]:
    """Every value of a document, and where it is."""
    if isinstance(document, Mapping) and document:
        for name, value in document.items():
            yield from _leaves(value, f"{place}.{name}" if place else str(name))
    elif isinstance(document, list) and document:
        for k, value in enumerate(document):
            yield from _leaves(value, f"{place}[{k}]")
    else:
        yield place, document


def _differing_columns(claimed: pd.DataFrame, flown: pd.DataFrame) -> Iterator[str]:
    for name in flown:
        mine, theirs = claimed[name], flown[name]
        differ = np.flatnonzero(~((mine == theirs) | (mine.isna() & theirs.isna())).to_numpy(dtype=bool))
        if differ.size:
            first = int(differ[0])
            yield (
                f"{name} differs in {differ.size:,} of {len(mine):,} flights; the first is flight {first}: claimed "
                f"{mine.iloc[first]}, flown {theirs.iloc[first]}"
            )


def _beyond_tolerance(claimed: pd.DataFrame, flown: pd.DataFrame) -> Iterator[str]:
    """Where flights on another kind of machine differ more than those of an honest entry do."""
    for name, tolerance in ((SUCCESS, SUCCESS_TOLERANCE), (TERMINATION, ENDING_TOLERANCE)):
        differ, allowed = int((claimed[name] != flown[name]).sum()), max(2, math.ceil(tolerance * len(flown)))
        if differ > allowed:
            reached = [int(frame[SUCCESS].sum()) for frame in (claimed, flown)]
            yield (
                f"success.count: claimed {reached[0]:,}, flown {reached[1]:,} of {len(flown):,}; {name} differs in "
                f"{differ:,} flights, and may in {allowed:,}"
            )
    other = (claimed[[SUCCESS, TERMINATION]] != flown[[SUCCESS, TERMINATION]]).any(axis=1)
    for name in (LENGTH, RETURN, *ERRORS):
        mine, theirs = (frame[name][~other].mean() for frame in (claimed, flown))
        if abs(mine - theirs) > MEAN_TOLERANCE * max(abs(theirs), 1.0):
            yield f"mean {name} of the flights that end alike: claimed {mine:.6g}, flown {theirs:.6g}"
