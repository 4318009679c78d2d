"""Transitions side by side, as offline learners take them, in memory or mapped from a training cache."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.datasets.folders import replaced_folder
from vvc_bench.datasets.schema import OBSERVED
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.rollout import Episodes

_MARKER = "complete.json"
_GOAL_OBSERVED = [OBSERVED.index(name) for name in GOAL_COLUMNS]


class Transitions(NamedTuple):
    """N transitions; every episode ends in one that is terminated or truncated."""

    observations: NDArray[np.float32]
    """Shape (N, 8)."""
    actions: NDArray[np.float32]
    """Shape (N, 3) or (N, 4), in the units of the action space."""
    rewards: NDArray[np.float32]
    """Shape (N,)."""
    next_observations: NDArray[np.float32]
    """Shape (N, 8); after an episode's last action, its final observation."""
    terminated: NDArray[np.bool_]
    """Shape (N,)."""
    truncated: NDArray[np.bool_]
    """Shape (N,); also where the record of an episode stops before the task ends it."""
    goals: NDArray[np.float32]
    """Shape (N, 3): speed in m/s, path angle and azimuth in degrees, as environments show them."""

    def batch(self, rows: ArrayLike) -> "Transitions":
        """Some transitions, by index or mask, copied."""
        chosen = np.asarray(rows)
        return Transitions(*(np.asarray(column[chosen]) for column in self))

    def sample(self, generator: np.random.Generator, size: int) -> "Transitions":
        """Transitions drawn at random, with replacement."""
        return self.batch(generator.integers(len(self.rewards), size=size))


def transitions_of(episodes: Episodes) -> Transitions:
    """The transitions of flights."""
    terminated, truncated = episodes.ends
    last = episodes.offsets[1:] - 1
    truncated[last] |= ~terminated[last]
    return Transitions(
        episodes.observations,
        episodes.actions,
        episodes.rewards,
        episodes.next_observations,
        terminated,
        truncated,
        np.repeat(episodes.goals.astype(np.float32), episodes.lengths, axis=0),
    )


def dictionary(observations: NDArray[np.float32], goals: ArrayLike) -> dict[str, NDArray[np.float32]]:
    """Observations as the environments give them: ``observation``, ``achieved_goal`` and ``desired_goal``.

    Args:
        observations: shape (N, 8).
        goals: shape (3,) or (N, 3), in outside units.
    """
    achieved = observations[:, _GOAL_OBSERVED]
    desired = np.broadcast_to(np.asarray(goals, dtype=np.float32), achieved.shape)
    return {"observation": observations, "achieved_goal": achieved, "desired_goal": desired}


def seen(episodes: Episodes, e: int) -> NDArray[np.float32]:
    """All that was seen in one flight, the end included, shape (T + 1, 8)."""
    steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
    return np.concatenate([episodes.observations[steps], episodes.final_observations[e : e + 1]])


def write_cache(folder: Path, transitions: Transitions) -> None:
    """Keep transitions as uncompressed arrays, one file for each, that appear together.

    Raises:
        OSError: if they cannot be written.
    """
    with replaced_folder(folder, _MARKER) as place:
        for name, values in transitions._asdict().items():
            np.save(place / f"{name}.npy", values)
        sums = {name: _sha256(place / f"{name}.npy") for name in Transitions._fields}
        (place / _MARKER).write_text(json.dumps(sums), encoding="utf-8")


def map_cache(folder: Path) -> Transitions | None:
    """Transitions that `write_cache` kept, mapped into memory read-only; None if they are not there, or damaged."""
    try:
        sums = json.loads((folder / _MARKER).read_text(encoding="utf-8"))
        with ThreadPoolExecutor() as pool:
            found = list(pool.map(lambda name: _sha256(folder / f"{name}.npy"), Transitions._fields))
        if sums != dict(zip(Transitions._fields, found, strict=True)):
            return None
        return Transitions(*(np.load(folder / f"{name}.npy", mmap_mode="r") for name in Transitions._fields))
    except (OSError, ValueError):
        return None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
