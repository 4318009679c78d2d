"""PPO from nothing, or from a demonstrator that it may be held near (GCBC+PPO, IRPO)."""

import math
from collections.abc import Sequence

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv

from vvc_bench.baselines.actors import DemonstratedPolicy, network
from vvc_bench.baselines.configurations import PpoConfiguration
from vvc_bench.baselines.devices import CPU
from vvc_bench.baselines.reinforcement import Reinforcement, check_count


class ScheduledPPO(PPO):  # type: ignore[misc]  # whose types are not there without the extra
    """PPO whose learning rate falls over the steps that a configuration names, however often it is stopped on the way.

    Args:
        configuration: how; the rate begins to fall after the warm-up.
        environments: with actions of ±1.
        seed: of weights, batches and exploration.
        state_dependent_exploration: whether exploration depends on the state.
        device: of the networks.
    """

    def __init__(
        self,
        configuration: PpoConfiguration,
        environments: VecEnv,
        seed: int,
        state_dependent_exploration: bool,
        device: torch.device,
    ) -> None:
        self._planned = configuration
        super().__init__(
            DemonstratedPolicy,
            environments,
            learning_rate=lambda left: configuration.learning_rate * left,
            n_steps=configuration.steps_of_a_rollout,
            batch_size=configuration.batch_size,
            n_epochs=configuration.epochs,
            gamma=configuration.discount,
            gae_lambda=configuration.advantage_smoothing,
            clip_range=configuration.clip_range,
            ent_coef=1.0,  # the policy weighs entropy and divergence itself
            use_sde=state_dependent_exploration,
            policy_kwargs={
                **network(configuration.hidden),
                "entropy_weight": configuration.entropy_weight,
                "penalty": configuration.demonstrator_penalty,
            },
            seed=seed,
            device=device,
        )

    def _update_current_progress_remaining(self, num_timesteps: int, total_timesteps: int) -> None:
        del total_timesteps  # of one call of learn, which is a roll-out
        since = max(num_timesteps - self._planned.warm_up_steps, 0)
        self._current_progress_remaining = max(1.0 - since / self._planned.steps, 0.0)


class Improving(Reinforcement):
    """A policy that PPO improves, a roll-out and its updates at a time.

    During the warm-up only the value function learns what the actor's doing is worth.

    Args:
        environments: with actions of ±1 (`vvc_bench.baselines.unit_actions.UnitActions`).
        configuration: how; as many environments as it says.
        seed: of weights, batches and exploration.
        demonstrator: whose actor it begins with, and is held near if the configuration says so.
        device: of the networks.

    Raises:
        ValueError: for another number of environments, or a demonstrator with other networks.
    """

    def __init__(
        self,
        environments: VecEnv,
        configuration: PpoConfiguration,
        seed: int,
        demonstrator: DemonstratedPolicy | None = None,
        device: torch.device = CPU,
    ) -> None:
        check_count(environments, configuration.environments)
        explores = configuration.state_dependent_exploration and demonstrator is None
        self._warm_up_steps = configuration.warm_up_steps
        algorithm = ScheduledPPO(configuration, environments, seed, explores, device)
        super().__init__(algorithm, configuration.steps_of_a_rollout)
        if demonstrator is not None:
            _begin_with(self.policy, demonstrator.to(device))
        if configuration.first_exploration is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(configuration.first_exploration))

    def advance(self, logger: Logger) -> None:
        """Fly a roll-out and learn from it."""
        _set_trainable(self.policy.actor_parameters, self.done >= self._warm_up_steps)
        super().advance(logger)


def _begin_with(policy: DemonstratedPolicy, demonstrator: DemonstratedPolicy) -> None:
    try:
        policy.load_state_dict(demonstrator.state_dict())
    except RuntimeError as error:
        raise ValueError(f"the demonstrator's networks are others than the configuration's: {error}") from error
    policy.follow(demonstrator)


def _set_trainable(parameters: Sequence[torch.nn.Parameter], trainable: bool) -> None:
    for parameter in parameters:
        parameter.requires_grad = trainable
