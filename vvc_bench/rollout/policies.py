"""Fly every goal by any policy: a function from what is observed to actions."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.envs.fleet import Fleet
from vvc_bench.goals import checked_goals
from vvc_bench.rollout.episodes import concatenate
from vvc_bench.rollout.replay import Flown, replay
from vvc_bench.rollout.scenario import Scenario
from vvc_bench.sim.task import Event

Policy: TypeAlias = Callable[[dict[str, NDArray[np.float32]]], ArrayLike]
"""From a batch of observations, as the vector environment gives them, to a batch of actions in its action space."""

_BLOCK = 8192
"""Episodes flown side by side, which bounds the memory."""


def fly_policy(
    scenario: Scenario,
    goals: ArrayLike,
    policy: Policy,
    *,
    seeds: ArrayLike = 0,
    source: str = "policy",
    threads: int | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Flown:
    """Fly every goal by a policy, and keep the flights that reach.

    Args:
        scenario: rules, settings, start and conditions.
        goals: shape (E, 3): speed in m/s, path angle and azimuth in degrees.
        policy: asked once a step for all aircraft that still fly.
        seeds: one for all or shape (E,).
        source: what the episodes are labelled with.
        threads: at most so many; by default all cores.
        progress: told how many goals have been flown since it was last told.

    Raises:
        ValueError: for goals that are none, or actions of another shape or with NaN.
    """
    targets = np.atleast_2d(checked_goals(goals))
    every_seed = np.broadcast_to(np.asarray(seeds, dtype=np.int64), len(targets))
    parts, events = [], []
    for first in range(0, len(targets), _BLOCK):
        block = slice(first, first + _BLOCK)
        actions, lengths, last_events = _fly_block(scenario, targets[block], policy, every_seed[block], threads)
        reached = np.flatnonzero(last_events & int(Event.REACH_TARGET))
        flown = np.concatenate([actions[: lengths[e], e] for e in reached] or [actions[:0, 0]])
        offsets = np.concatenate([[0], np.cumsum(lengths[reached])])
        kept = targets[block][reached], flown, offsets
        parts.append(replay(scenario, *kept, seeds=every_seed[block][reached], sources=source, threads=threads))
        events.append(last_events)
        progress(len(last_events))
    return Flown(concatenate(parts), np.concatenate(events))


def _fly_block(
    scenario: Scenario, goals: NDArray[np.float64], policy: Policy, seeds: NDArray[np.int64], threads: int | None
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """Actions, shape (T, E, w), and each flight's length and last events."""
    count = len(goals)
    fleet = Fleet(count, scenario.task, scenario.settings, goals, scenario.start, scenario.condition_rows(seeds))
    fleet.begin(np.arange(count), goals)
    lengths, last_events = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    flying = np.arange(count)
    history: list[NDArray[np.float32]] = []
    while flying.size and len(history) < scenario.task.step_limit:
        observed = {
            "observation": fleet.observations[flying],
            "achieved_goal": fleet.achieved[flying],
            "desired_goal": fleet.desired[flying],
        }
        actions = np.zeros((count, scenario.settings.command_width), dtype=np.float32)
        actions[flying] = policy(observed)
        fleet.step(actions, threads)
        history.append(actions)
        lengths[flying] += 1
        last_events[flying] = fleet.events[flying]
        flying = flying[fleet.events[flying] == 0]
    return np.stack(history), lengths, last_events
