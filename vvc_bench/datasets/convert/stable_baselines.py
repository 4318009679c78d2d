"""Flights in the replay buffers of Stable-Baselines3 (extra ``train``)."""

from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vvc_bench.datasets.transitions import dictionary, transitions_of
from vvc_bench.envs.options import make_spaces
from vvc_bench.rollout import Episodes

try:
    from stable_baselines3 import HerReplayBuffer
    from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer
except ImportError as error:
    raise ImportError("this takes Stable-Baselines3, which is missing: pip install vvc-bench[train]") from error


def to_replay_buffer(
    episodes: Episodes,
    buffer_class: type[ReplayBuffer] = DictReplayBuffer,
    *,
    buffer_size: int | None = None,
    **options: Any,
) -> ReplayBuffer:
    """A replay buffer that holds all transitions of flights, for one environment.

    Actions are scaled to [−1, 1] and clipped to it, as the off-policy algorithms store their own.

    Args:
        episodes: the flights.
        buffer_class: ``DictReplayBuffer``, ``HerReplayBuffer``, or ``ReplayBuffer``, for an environment whose
            observations were flattened by Gymnasium's ``FlattenObservation``.
        buffer_size: how many transitions it has room for; by default as many as there are.
        **options: further ones of the buffer, as ``device="cpu"``, or ``env=`` for ``HerReplayBuffer``.

    Raises:
        ValueError: if they do not fit in.
    """
    count = len(episodes.rewards)
    size = count if buffer_size is None else buffer_size
    if size < count:
        raise ValueError(f"a buffer of {size} has no room for {count} transitions")
    seen, action_space = cast(tuple[spaces.Dict, spaces.Box], make_spaces(episodes.scenario.settings))
    flat = not issubclass(buffer_class, DictReplayBuffer)
    buffer = buffer_class(size, spaces.flatten_space(seen) if flat else seen, action_space, **options)
    made = transitions_of(episodes)
    for place, observations in (
        (buffer.observations, dictionary(made.observations, made.goals)),
        (buffer.next_observations, dictionary(made.next_observations, made.goals)),
    ):
        if flat:
            place[:count, 0] = np.concatenate([observations[key] for key in seen.spaces], axis=1)
        else:
            for key, values in observations.items():
                place[key][:count, 0] = values
    buffer.actions[:count, 0] = _scaled(made.actions, action_space)
    buffer.rewards[:count, 0] = made.rewards
    buffer.dones[:count, 0] = made.terminated | made.truncated
    buffer.timeouts[:count, 0] = made.truncated & ~made.terminated
    buffer.pos, buffer.full = count % size, count == size
    if issubclass(buffer_class, HerReplayBuffer):
        buffer.ep_start[:count, 0] = np.repeat(episodes.offsets[:-1], episodes.lengths)
        buffer.ep_length[:count, 0] = np.repeat(episodes.lengths, episodes.lengths)
        buffer._current_ep_start[:] = buffer.pos
    return buffer


def _scaled(actions: NDArray[np.float32], space: spaces.Box) -> NDArray[np.float32]:
    """Actions as `stable_baselines3.common.policies.BasePolicy.scale_action` has them."""
    scaled = 2.0 * ((actions - space.low) / (space.high - space.low)) - 1.0
    return np.clip(scaled, -1.0, 1.0).astype(np.float32)
