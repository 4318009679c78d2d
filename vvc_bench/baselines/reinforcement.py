"""Learners of Stable-Baselines3 that can be stopped after every few steps, and go on as if they had not been."""

import random
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from vvc_bench.baselines.curricula import Curriculum

_PLAIN = ("num_timesteps", "_n_updates", "_episode_num", "_last_obs", "_last_episode_starts", "_last_original_obs")
"""Attributes of `BaseAlgorithm` that learning goes on from, besides networks, optimisers, replay buffer and chance."""


class Reinforcement:
    """A learner that takes a number of steps at a time.

    Stable-Baselines3's own files leave out environments, replay buffer and random numbers; `state` holds these too, so
    that a learner which goes on from it does exactly what it would have done. What is not kept are the means over the
    last hundred episodes that are logged.

    Args:
        algorithm: the learner, on `UnitActions` around a `VelocityVectorVecEnv`.
        steps: of each environment, taken at a time.
    """

    unit = "steps"

    def __init__(self, algorithm: BaseAlgorithm, steps: int) -> None:
        self.algorithm = algorithm
        self._steps = steps * algorithm.n_envs

    @property
    def policy(self) -> Any:
        """What is learned."""
        return self.algorithm.policy

    @property
    def done(self) -> int:
        """Steps flown, of all environments together."""
        return int(self.algorithm.num_timesteps)

    def advance(self, logger: Logger) -> None:
        """Fly some steps, and learn."""
        self.algorithm.set_logger(logger)
        distribution = self.algorithm.env.get_attr("goals", 0)[0]
        callback = _Watched(distribution) if isinstance(distribution, Curriculum) else None
        self.algorithm.learn(self._steps, callback=callback, reset_num_timesteps=self.done == 0)

    def state(self) -> dict[str, Any]:
        """All that learning goes on from."""
        algorithm = self.algorithm
        variables = algorithm._get_torch_save_params()[1]
        return {
            "parameters": algorithm.get_parameters(),
            "variables": {name: getattr(algorithm, name).detach() for name in variables},
            "plain": {name: getattr(algorithm, name) for name in _PLAIN},
            "environments": algorithm.env.venv,
            "replay_buffer": algorithm.replay_buffer if isinstance(algorithm, OffPolicyAlgorithm) else None,
            "action_space": algorithm.action_space.np_random.bit_generator.state,
            "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002  (the library's)
            "cuda_random": torch.cuda.get_rng_state(algorithm.device) if algorithm.device.type == "cuda" else None,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        algorithm = self.algorithm
        algorithm.set_parameters(state["parameters"], device=algorithm.device)
        for name, value in state["variables"].items():
            getattr(algorithm, name).data.copy_(value)
        for name, value in state["plain"].items():
            setattr(algorithm, name, value)
        algorithm.env.venv = state["environments"]
        if state["replay_buffer"] is not None:
            algorithm.replay_buffer = state["replay_buffer"]
            algorithm.replay_buffer.device = algorithm.device  # which may be another than it was
            if hasattr(algorithm.replay_buffer, "set_env"):  # hindsight asks it for rewards
                algorithm.replay_buffer.set_env(algorithm.env)
        algorithm.action_space.np_random.bit_generator.state = state["action_space"]
        python, numpy, pytorch = state["random"]
        random.setstate(python)
        np.random.set_state(numpy)  # noqa: NPY002
        torch.set_rng_state(pytorch)
        if state["cuda_random"] is not None and algorithm.device.type == "cuda":
            torch.cuda.set_rng_state(state["cuda_random"], algorithm.device)


def check_count(environments: VecEnv, configured: int) -> None:
    """Refuse another number of environments than a configuration is for.

    Raises:
        ValueError: names both.
    """
    if environments.num_envs != configured:
        raise ValueError(f"the configuration is for {configured} environments, got {environments.num_envs}")


class _Watched(BaseCallback):  # type: ignore[misc]  # whose types are not there without the extra
    """Tells a curriculum where the aircraft get to, and which goals they reach."""

    def __init__(self, curriculum: Curriculum) -> None:
        super().__init__()
        self._curriculum = curriculum

    def _on_step(self) -> bool:
        self._curriculum.observe(self.locals["new_obs"]["achieved_goal"])
        last = [self.locals["infos"][i] for i in np.flatnonzero(self.locals["dones"])]
        if last:
            goals = np.array([info["terminal_observation"]["desired_goal"] for info in last])
            self._curriculum.conclude(goals, np.array([info["is_success"] for info in last]))
        return True
