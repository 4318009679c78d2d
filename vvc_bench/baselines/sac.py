"""SAC, alone or with hindsight (HER)."""

from typing import Any

from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.vec_env import VecEnv

from vvc_bench.baselines.configurations import SacConfiguration
from vvc_bench.baselines.features import RelativeFeatures


def make_sac(environments: VecEnv, configuration: SacConfiguration, seed: int) -> SAC:
    """A learner that has not learned yet.

    Args:
        environments: with actions of ±1 (`vvc_bench.baselines.unit_actions.UnitActions`); for hindsight a task whose
            rewards follow from goals: ``reward="sparse"``, ``reach_steps=1``.
        configuration: how; as many environments as it says.
        seed: of weights, batches and exploration.

    Raises:
        ValueError: for another number of environments.
    """
    if environments.num_envs != configuration.environments:
        raise ValueError(
            f"the configuration is for {configuration.environments} environments, got {environments.num_envs}"
        )
    replay: dict[str, Any] = {"replay_buffer_class": HerReplayBuffer} if configuration.hindsight else {}
    return SAC(
        "MultiInputPolicy",
        environments,
        learning_rate=configuration.learning_rate,
        buffer_size=configuration.buffer_size,
        learning_starts=configuration.learning_starts,
        batch_size=configuration.batch_size,
        gamma=configuration.discount,
        gradient_steps=configuration.gradient_steps,
        policy_kwargs={"features_extractor_class": RelativeFeatures, "net_arch": list(configuration.hidden)},
        seed=seed,
        device="cpu",
        **replay,
    )
