"""Whether an evaluation that is claimed is the one that was flown again."""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from vvc_bench.evaluation import Evaluation
from vvc_bench.goals import GOAL_COLUMNS

TOLERANCE = 0.005
"""Share of the flights that may end otherwise on another kind of machine; at least two flights may."""
LENGTH_TOLERANCE = 0.01
"""How much the mean length of flights that end alike may differ there."""
LEAST_SUCCESSES = 10
"""So many goals reached tell a policy: two that reach the same ones in the same steps are the same."""

_IDENTITY = ("seed", "goal", *GOAL_COLUMNS)
_OUTCOME = ("success", "termination", "length_steps")
_SHOWN = 5
"""Differences that are told one by one."""


def allowed_differences(flights: int) -> int:
    """How many flights may end otherwise on another kind of machine than where they were claimed."""
    return max(2, math.ceil(TOLERANCE * flights))


def outcomes_sha256(episodes: pd.DataFrame) -> str:
    """Hash of how each flight ended and after how many steps: the same on all kinds of machines, nearly always."""
    digest = hashlib.sha256()
    for row in episodes[list(_OUTCOME)].itertuples(index=False):
        digest.update(f"{int(row.success)} {row.termination} {int(row.length_steps)}\n".encode())
    return digest.hexdigest()


def differences(claimed: Evaluation, flown: Evaluation, seeds: Sequence[int], *, exact: bool) -> list[str]:
    """What is claimed and was not flown, each with both numbers; empty if nothing is.

    Args:
        claimed: as submitted.
        flown: as flown again, with the same seeds.
        seeds: those that the submission names.
        exact: on the same kind of machine, where every number must be the same. Elsewhere as many flights may end
            otherwise as `allowed_differences` says, and then the summary may differ with them.
    """
    disordered = _wrong_flights(claimed.episodes, flown.episodes, seeds)
    if disordered:
        return [disordered]
    if exact:
        found = [*_differing_numbers(claimed.summary, flown.summary), *_differing_columns(claimed, flown)]
    else:
        found = [*_summary_of_others(claimed), *_beyond_tolerance(claimed.episodes, flown.episodes)]
    return found[:_SHOWN] + ([f"{len(found) - _SHOWN} more numbers differ"] if len(found) > _SHOWN else [])


def _wrong_flights(claimed: pd.DataFrame, flown: pd.DataFrame, seeds: Sequence[int]) -> str:
    """Where the flights are not those of the seeds and goals in their order; empty if they are."""
    missing = [name for name in (*_IDENTITY, *_OUTCOME) if name not in claimed]
    if missing:
        return f"the claimed episodes have no column {missing[0]}"
    unknown = [name for name in claimed if name not in flown]
    if unknown:
        return f"the claimed episodes have a column {unknown[0]!r} that an evaluation does not have"
    present = list(dict.fromkeys(claimed["seed"].tolist()))
    if present != list(seeds):
        return f"the submission names seeds {list(seeds)}; its episodes are of seeds {present}"
    if len(claimed) != len(flown):
        return f"{len(claimed):,} flights are claimed; the protocol has {len(flown):,} with these seeds"
    mine, theirs = (frame[list(_IDENTITY)].to_numpy(dtype=np.float64) for frame in (claimed, flown))
    rows = np.flatnonzero((mine != theirs).any(axis=1))
    if rows.size:
        first = int(rows[0])
        return (
            f"{len(rows):,} of {len(flown):,} flights are not where the protocol's order has them; the first is flight "
            f"{first}: claimed {_identity(mine[first])}, flown {_identity(theirs[first])}"
        )
    return ""


def _identity(row: Any) -> str:
    seed, goal, *values = row
    return f"seed {seed:g}, goal {goal:g} ({', '.join(f'{value:g}' for value in values)})"


def _differing_numbers(claimed: Mapping[str, Any], flown: Mapping[str, Any]) -> Iterator[str]:
    """Of two summaries; the one flown may say more."""
    mine, theirs = (dict(_leaves(document)) for document in (claimed, flown))
    for place, value in mine.items():
        if place.startswith("versions."):
            continue
        if place not in theirs:
            yield f"summary {place}: claimed {value!r}, which an evaluation does not say"
        elif value != theirs[place] or type(value) is not type(theirs[place]):
            yield f"summary {place}: claimed {value!r}, flown {theirs[place]!r}"


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


def _differing_columns(claimed: Evaluation, flown: Evaluation) -> Iterator[str]:
    for name in claimed.episodes:
        mine, theirs = claimed.episodes[name], flown.episodes[name]
        differ = np.flatnonzero(~((mine == theirs) | (mine.isna() & theirs.isna())).to_numpy(dtype=bool))
        if differ.size:
            first = int(differ[0])
            yield (
                f"{name} differs in {differ.size:,} of {len(mine):,} flights; the first is flight {first}: claimed "
                f"{mine.iloc[first]}, flown {theirs.iloc[first]}"
            )


def _beyond_tolerance(claimed: pd.DataFrame, flown: pd.DataFrame) -> Iterator[str]:
    """Where flights on another kind of machine differ more than those of an honest entry do."""
    allowed = allowed_differences(len(flown))
    reached = (
        f"success: claimed {int(claimed['success'].sum()):,}, flown {int(flown['success'].sum()):,} of {len(flown):,}"
    )
    other = (claimed["success"] != flown["success"]) | (claimed["termination"] != flown["termination"])
    if other.sum() > allowed:
        yield f"{reached}; {int(other.sum()):,} flights end otherwise, and at most {allowed:,} may"
    mine, theirs = (frame["length_steps"][~other].mean() for frame in (claimed, flown))
    if abs(mine - theirs) > LENGTH_TOLERANCE * theirs:
        yield f"mean length of the flights that end alike: claimed {mine:.2f}, flown {theirs:.2f} steps"


def _summary_of_others(_claimed: Evaluation) -> Iterator[str]:
    yield from ()
