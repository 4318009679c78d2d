"""Flights for the library ``imitation`` (extra ``train``)."""

from vvc_bench.datasets.transitions import dictionary, seen
from vvc_bench.rollout import Episodes

try:
    from imitation.data.rollout import flatten_trajectories_with_rew
    from imitation.data.types import DictObs, TrajectoryWithRew, TransitionsWithRew
except ImportError as error:
    raise ImportError("this takes imitation, which is missing: pip install vvc-bench[train]") from error


def to_trajectories(episodes: Episodes) -> list[TrajectoryWithRew]:
    """Flights as trajectories, observations as the environments' dictionaries.

    A record that stops before the task ends the episode is not ``terminal``.
    """
    return [_trajectory(episodes, e) for e in range(len(episodes))]


def to_transitions(episodes: Episodes) -> TransitionsWithRew:
    """Flights as transitions, as imitation flattens trajectories."""
    return flatten_trajectories_with_rew(to_trajectories(episodes))


def _trajectory(episodes: Episodes, e: int) -> TrajectoryWithRew:
    steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
    return TrajectoryWithRew(
        obs=DictObs(dictionary(seen(episodes, e), episodes.goals[e])),
        acts=episodes.actions[steps],
        infos=None,
        terminal=bool(episodes.final_events[e]),
        rews=episodes.rewards[steps],
    )
