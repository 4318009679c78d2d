"""Environments whose actions are scaled to ±1, as learners explore them."""

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class UnitActions(VecEnvWrapper):  # type: ignore[misc]  # whose types are not there without the extra
    """Actions from −1 to 1 in place of the action space's bounds; what lies beyond is clipped by the aircraft.

    Args:
        environments: whose actions.
        reward_scale: what rewards are multiplied by; returns in the infos are left as they are.
    """

    def __init__(self, environments: VecEnv, reward_scale: float = 1.0) -> None:
        self.bounds = environments.action_space
        self._reward_scale = np.float32(reward_scale)
        super().__init__(environments, action_space=unit_box(self.bounds))

    def reset(self) -> VecEnvObs:
        """Begin all episodes anew."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Fly one step."""
        self.venv.step_async(from_unit(actions, self.bounds))

    def step_wait(self) -> VecEnvStepReturn:
        """What came of it."""
        observed, rewards, dones, infos = self.venv.step_wait()
        return observed, rewards * self._reward_scale, dones, infos


def unit_box(bounds: spaces.Box) -> spaces.Box:
    """±1 for each component."""
    return spaces.Box(-1.0, 1.0, bounds.shape, np.float32)


def to_unit(actions: NDArray[np.float32], bounds: spaces.Box) -> NDArray[np.float32]:
    """Actions in their units, scaled to ±1."""
    scaled: NDArray[np.float32] = (2.0 * (actions - bounds.low) / (bounds.high - bounds.low) - 1.0).astype(np.float32)
    return scaled


def from_unit(actions: NDArray[np.float32], bounds: spaces.Box) -> NDArray[np.float32]:
    """And back."""
    scaled: NDArray[np.float32] = (bounds.low + (actions + 1.0) / 2.0 * (bounds.high - bounds.low)).astype(np.float32)
    return scaled
