"""What does not belong in a set: the same goal or flight twice, columns in which nothing happens."""

import hashlib
from typing import NamedTuple

import numpy as np

from vvc_bench.rollout import Episodes
from vvc_bench.rollout.episodes import PER_TRANSITION
from vvc_bench.sim.fields import Observation, SurfaceCommand, columns


class Integrity(NamedTuple):
    """Faults of a set."""

    repeated_goals: int
    """Episodes whose goal an earlier episode has too."""
    repeated_flights: int
    """Episodes whose start, observations and actions are those of an earlier episode, bit for bit."""
    constant_columns: dict[str, tuple[str, ...]]
    """Array of `Episodes` → its columns that have one value in all transitions; arrays without such are left out."""


def integrity(episodes: Episodes) -> Integrity:
    """Look for repetitions and dead columns."""
    distinct = len(np.unique(episodes.goals + 0.0, axis=0)) if len(episodes) else 0
    flights = {_digest(episodes, e) for e in range(len(episodes))}
    constant = {name: _constant_columns(episodes, name) for name in PER_TRANSITION}
    return Integrity(
        len(episodes) - distinct,
        len(episodes) - len(flights),
        {name: found for name, found in constant.items() if found},
    )


def _digest(episodes: Episodes, e: int) -> bytes:
    steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
    digest = hashlib.blake2b(episodes.starts[e].tobytes(), digest_size=16)
    digest.update(episodes.observations[steps].tobytes())
    digest.update(episodes.actions[steps].tobytes())
    return digest.digest()


def _constant_columns(episodes: Episodes, array: str) -> tuple[str, ...]:
    values = getattr(episodes, array)
    if not len(values):
        return ()
    kinds = {
        "observations": Observation,
        "actions": episodes.scenario.settings.command_fields,
        "deflections": SurfaceCommand,
    }
    names = tuple(columns(kinds[array])) if array in kinds else (array,)
    same = np.atleast_1d((values == values[0]).all(axis=0))
    return tuple(name for name, constant in zip(names, same, strict=True) if constant)
