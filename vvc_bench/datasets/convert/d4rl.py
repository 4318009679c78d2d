"""The dictionary of arrays that D4RL made customary."""

from typing import Any

from numpy.typing import NDArray

from vvc_bench.datasets.transitions import transitions_of
from vvc_bench.rollout import Episodes


def to_d4rl(episodes: Episodes) -> dict[str, NDArray[Any]]:
    """Flights as ``observations``, ``actions``, ``rewards``, ``next_observations``, ``terminals`` and ``timeouts``.

    The goal of each transition is ``infos/goal``, as in D4RL's AntMaze. Every episode ends with one of the two flags.
    """
    made = transitions_of(episodes)
    return {
        "observations": made.observations,
        "actions": made.actions,
        "rewards": made.rewards,
        "next_observations": made.next_observations,
        "terminals": made.terminated,
        "timeouts": made.truncated & ~made.terminated,
        "infos/goal": made.goals,
    }
