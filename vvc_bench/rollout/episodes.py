"""Many flights at once, whole: what was seen, commanded, rewarded and flown, step by step."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.rollout.scenario import Scenario
from vvc_bench.sim.task import Event, outcomes


@dataclass(frozen=True)
class Episodes:
    """E episodes with N transitions in all, one after another; transition ``offsets[e]`` is the first of episode e.

    What has a unit has the outside one, as stored. Flying ``actions`` from ``starts`` gives all the rest
    (`vvc_bench.rollout.replay`).

    Args:
        scenario: rules, settings, start and conditions.
        goals: shape (E, 3): speed in m/s, path angle and azimuth in degrees.
        seeds: shape (E,): of gusts and sensor noise.
        sources: shape (E,): where each flight came from.
        starts: shape (E, F): full states in SI units, as `vvc_bench.sim.start` makes them.
        offsets: shape (E + 1,).
        observations: shape (N, 8), float32: what was seen before each action (`vvc_bench.sim.fields.Observation`).
        final_observations: shape (E, 8), float32: what was seen at the end.
        actions: shape (N, 3) or (N, 4), float32, in the units of the action space.
        rewards: shape (N,), float32.
        events: shape (N,), uint8: `Event` bits of each step; none but on last steps.
        deflections: shape (N, 4), float32: aileron, elevator, rudder in degrees and throttle, as flown in the step.
        load_factors: shape (N,), float32: normal load factor in g during the step.
    """

    scenario: Scenario
    goals: NDArray[np.float64]
    seeds: NDArray[np.int64]
    sources: NDArray[np.str_]
    starts: NDArray[np.float64]
    offsets: NDArray[np.int64]
    observations: NDArray[np.float32]
    final_observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]
    events: NDArray[np.uint8]
    deflections: NDArray[np.float32]
    load_factors: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.goals)

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Transitions of each episode, shape (E,)."""
        return np.diff(self.offsets)

    @property
    def final_events(self) -> NDArray[np.uint8]:
        """`Event` bits that each episode ended with, 0 where its actions ran out first; shape (E,)."""
        return self.events[self.offsets[1:] - 1]

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Whether each episode ended by reaching its goal, shape (E,)."""
        reached: NDArray[np.bool_] = (self.final_events & int(Event.REACH_TARGET)) != 0
        return reached

    @property
    def ends(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``terminated`` and ``truncated`` of every transition, shape (N,) each."""
        terminated, truncated = outcomes(self.scenario.task, self.events)
        return terminated, truncated

    @property
    def next_observations(self) -> NDArray[np.float32]:
        """What was seen after each action, shape (N, 8)."""
        after = np.roll(self.observations, -1, axis=0)
        after[self.offsets[1:] - 1] = self.final_observations
        return after

    def transition_episodes(self) -> NDArray[np.int64]:
        """Which episode each transition belongs to, shape (N,)."""
        return np.repeat(np.arange(len(self)), self.lengths)

    def select(self, which: ArrayLike) -> "Episodes":
        """Some of the episodes, by index or mask, in the order given."""
        indices = np.asarray(which)
        chosen = np.arange(len(self))[indices if indices.size else indices.astype(np.int64)]
        lengths = self.lengths[chosen]
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        rows = np.arange(offsets[-1]) + np.repeat(self.offsets[chosen] - offsets[:-1], lengths)
        parts: dict[str, Any] = {name: getattr(self, name)[rows] for name in PER_TRANSITION}
        parts |= {name: getattr(self, name)[chosen] for name in PER_EPISODE}
        return dataclasses.replace(self, offsets=offsets, **parts)


PER_EPISODE = ("goals", "seeds", "sources", "starts", "final_observations")
PER_TRANSITION = ("observations", "actions", "rewards", "events", "deflections", "load_factors")


def concatenate(parts: Sequence[Episodes]) -> Episodes:
    """Episodes of one scenario, one part after another.

    Raises:
        ValueError: for no part, or parts of different scenarios.
    """
    if not parts or any(part.scenario != parts[0].scenario for part in parts):
        raise ValueError(f"need at least one part, all of the same scenario; got {len(parts)} parts")
    offsets = np.concatenate([[0], np.cumsum(np.concatenate([part.lengths for part in parts]))])
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in (*PER_EPISODE, *PER_TRANSITION)
    }
    return dataclasses.replace(parts[0], offsets=offsets, **joined)
