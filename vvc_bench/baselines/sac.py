"""SAC, alone or with hindsight (HER)."""

from typing import Any

import torch
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.vec_env import VecEnv

from vvc_bench.baselines.configurations import SacConfiguration
from vvc_bench.baselines.devices import CPU
from vvc_bench.baselines.features import RelativeFeatures
from vvc_bench.baselines.reinforcement import Reinforcement, check_count

_SLICE = 500
"""Steps, of all environments together, between two looks at the time."""


class SoftActorCritic(Reinforcement):
    """A policy that SAC learns, some 500 steps at a time.

    Args:
        environments: with actions of ±1 (`vvc_bench.baselines.unit_actions.UnitActions`); for hindsight on a task whose
            rewards follow from goals: ``reward="sparse"``, ``reach_steps=1``.
        configuration: how; as many environments as it says.
        seed: of weights, batches and exploration.
        device: of the networks.

    Raises:
        ValueError: for another number of environments.
    """

    def __init__(
        self, environments: VecEnv, configuration: SacConfiguration, seed: int, device: torch.device = CPU
    ) -> None:
        check_count(environments, configuration.environments)
        replay: dict[str, Any] = {"replay_buffer_class": HerReplayBuffer} if configuration.hindsight else {}
        algorithm = SAC(
            "MultiInputPolicy",
            environments,
            learning_rate=configuration.learning_rate,
            buffer_size=configuration.buffer_size,
            learning_starts=configuration.learning_starts,
            batch_size=configuration.batch_size,
            gamma=configuration.discount,
            gradient_steps=configuration.gradient_steps,
            ent_coef=f"auto_{configuration.first_entropy_weight}",
            policy_kwargs={"features_extractor_class": RelativeFeatures, "net_arch": list(configuration.hidden)},
            seed=seed,
            device=device,
            **replay,
        )
        super().__init__(algorithm, -(-_SLICE // configuration.environments))
