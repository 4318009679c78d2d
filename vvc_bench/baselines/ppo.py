"""PPO from nothing, or from a demonstrator that it may be held near (GCBC+PPO, IRPO)."""

from collections.abc import Sequence

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from vvc_bench.baselines.actors import DemonstratedPolicy, network
from vvc_bench.baselines.configurations import PpoConfiguration


def make_ppo(
    environments: VecEnv, configuration: PpoConfiguration, seed: int, demonstrator: DemonstratedPolicy | None = None
) -> PPO:
    """A learner that has not learned yet.

    Args:
        environments: with actions of ±1 (`vvc_bench.baselines.unit_actions.UnitActions`).
        configuration: how; as many environments as it says.
        seed: of weights, batches and exploration.
        demonstrator: whose actor it begins with, and is held near if the configuration says so.

    Raises:
        ValueError: for another number of environments, or a demonstrator with other networks.
    """
    if environments.num_envs != configuration.environments:
        raise ValueError(
            f"the configuration is for {configuration.environments} environments, got {environments.num_envs}"
        )
    learner = PPO(
        DemonstratedPolicy,
        environments,
        learning_rate=lambda left: configuration.learning_rate * left,
        n_steps=configuration.steps_of_a_rollout,
        batch_size=configuration.batch_size,
        n_epochs=configuration.epochs,
        gamma=configuration.discount,
        gae_lambda=configuration.advantage_smoothing,
        clip_range=configuration.clip_range,
        ent_coef=1.0,
        use_sde=configuration.state_dependent_exploration and demonstrator is None,
        policy_kwargs={
            **network(configuration.hidden),
            "entropy_weight": configuration.entropy_weight,
            "penalty": configuration.demonstrator_penalty,
        },
        seed=seed,
        device="cpu",
    )
    if demonstrator is not None:
        _begin_with(learner.policy, demonstrator)
    return learner


def warm_up(learner: PPO, steps: int, callback: BaseCallback | Sequence[BaseCallback] | None = None) -> None:
    """Let only the value function learn, what the actor does being worth."""
    if steps <= 0:
        return
    actor = learner.policy.actor_parameters()
    _set_trainable(actor, False)
    try:
        learner.learn(steps, callback=list(callback) if isinstance(callback, Sequence) else callback)
    finally:
        _set_trainable(actor, True)


def _begin_with(policy: DemonstratedPolicy, demonstrator: DemonstratedPolicy) -> None:
    try:
        policy.load_state_dict(demonstrator.state_dict())
    except RuntimeError as error:
        raise ValueError(f"the demonstrator's networks are others than the configuration's: {error}") from error
    policy.follow(demonstrator)


def _set_trainable(parameters: Sequence[torch.nn.Parameter], trainable: bool) -> None:
    for parameter in parameters:
        parameter.requires_grad = trainable


