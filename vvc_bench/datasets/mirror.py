"""The mirror image of flights, left for right (the paper's Appendix D), with every sign as `Field.mirror` says."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes, Scenario, replay
from vvc_bench.sim.fields import Goal, Observation, State, SurfaceCommand, field_array

MIRRORED = "/mirrored"
"""Added to the source of a flight whose record was mirrored."""
REFLOWN = "/mirrored-reflown"
"""Added to the source of a flight whose mirrored commands were flown."""


def is_mirrored(episodes: Episodes) -> NDArray[np.bool_]:
    """Which episodes are mirrored records, and so not what the aircraft would fly to the last bit; shape (E,)."""
    mirrored: NDArray[np.bool_] = np.char.endswith(episodes.sources, MIRRORED)
    return mirrored


def mirror(episodes: Episodes) -> Episodes:
    """The recorded flights, mirrored. The aircraft is nearly symmetric, so these are nearly what it would fly.

    Mirroring twice gives the same flights, but for their sources. Rewards and events stay as they are.
    """
    command = field_array(episodes.scenario.settings.command_fields, "mirror")
    seen = field_array(Observation, "mirror").astype(np.float32)
    return dataclasses.replace(
        episodes,
        goals=_mirrored_goals(episodes),
        sources=np.char.add(episodes.sources, MIRRORED),
        starts=_mirrored_starts(episodes, command),
        observations=episodes.observations * seen,
        final_observations=episodes.final_observations * seen,
        actions=episodes.actions * command.astype(np.float32),
        deflections=episodes.deflections * field_array(SurfaceCommand, "mirror").astype(np.float32),
    )


def mirror_and_fly(episodes: Episodes, threads: int | None = None) -> Episodes:
    """The mirrored commands, flown: what reaches its goal, to the step where it does."""
    command = field_array(episodes.scenario.settings.command_fields, "mirror")
    flown = replay(
        episodes.scenario,
        _mirrored_goals(episodes),
        episodes.actions * command.astype(np.float32),
        episodes.offsets,
        seeds=episodes.seeds,
        sources=np.char.add(episodes.sources, REFLOWN),
        starts=_mirrored_starts(episodes, command),
        threads=threads,
    )
    return flown.select(flown.reached)


def fly_under(episodes: Episodes, scenario: Scenario, threads: int | None = None) -> Episodes:
    """Recorded commands, flown under other rules: what reaches its goal, to the step where it does.

    A mirrored record becomes a flight of its own by this, and is labelled so.
    """
    sources = [
        source.removesuffix(MIRRORED) + REFLOWN if source.endswith(MIRRORED) else source
        for source in episodes.sources.tolist()
    ]
    flown = replay(
        scenario,
        episodes.goals,
        episodes.actions,
        episodes.offsets,
        seeds=episodes.seeds,
        sources=sources,
        starts=episodes.starts,
        threads=threads,
    )
    return flown.select(flown.reached)


def _mirrored_goals(episodes: Episodes) -> NDArray[np.float64]:
    goals: NDArray[np.float64] = episodes.goals * field_array(Goal, "mirror") + 0.0  # −0 is 0
    return goals


def _mirrored_starts(episodes: Episodes, command: NDArray[np.float64]) -> NDArray[np.float64]:
    """States, and after them the commands still on their way where there is control delay."""
    state = field_array(State, "mirror")
    waiting = (episodes.starts.shape[1] - state.size) // command.size
    starts: NDArray[np.float64] = episodes.starts * np.concatenate([state, np.tile(command, waiting)]) + 0.0
    return starts
