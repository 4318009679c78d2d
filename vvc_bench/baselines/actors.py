"""Policies of Stable-Baselines3 that see `RelativeFeatures` and act within ±1."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from torch import nn

from vvc_bench.baselines.features import RelativeFeatures


class DemonstratedPolicy(MultiInputActorCriticPolicy):  # type: ignore[misc]  # whose types are not there
    """An actor and critic that may be held near a demonstrator.

    Where PPO asks for the entropy of its actions to weigh it by ``ent_coef``, it is told

        entropy_weight · entropy − penalty · KL(demonstrator ‖ this),

    the divergence being a mean over the action's components, as in IRPO; ``ent_coef`` must then be 1.

    Args:
        entropy_weight: of the entropy.
        penalty: of the divergence.
        with_values: whether the critic is asked when actions are evaluated; cloning does without.
    """

    def __init__(
        self,
        *arguments: Any,
        entropy_weight: float = 0.0,
        penalty: float = 0.0,
        with_values: bool = True,
        **options: Any,
    ) -> None:
        super().__init__(*arguments, features_extractor_class=RelativeFeatures, **options)
        self.entropy_weight = entropy_weight
        self.penalty = penalty
        self.with_values = with_values
        self._demonstrator: list[MultiInputActorCriticPolicy] = []  # a list, so that it is not trained or saved

    def follow(self, demonstrator: MultiInputActorCriticPolicy) -> None:
        """Stay near a policy from now on; it must not be trained further."""
        demonstrator.set_training_mode(False)
        self._demonstrator = [demonstrator]

    def evaluate_actions(
        self, obs: dict[str, torch.Tensor], actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Values, log-likelihoods, and what stands for the entropy."""
        features = self.extract_features(obs)
        distribution = self._get_action_dist_from_latent(self.mlp_extractor.forward_actor(features))
        bonus = self.entropy_weight * distribution.entropy()
        if self.penalty > 0.0 and self._demonstrator:
            bonus = bonus - self.penalty * self._divergence_of(distribution, obs)
        return self._values(features), distribution.log_prob(actions), bonus

    def divergence(self, obs: dict[str, torch.Tensor]) -> torch.Tensor:
        """KL(demonstrator ‖ this), mean over the action's components, shape (B,)."""
        return self._divergence_of(self.get_distribution(obs), obs)

    def _values(self, features: torch.Tensor) -> torch.Tensor:
        if not self.with_values:
            return features.new_zeros((len(features), 1))
        values: torch.Tensor = self.value_net(self.mlp_extractor.forward_critic(features))
        return values

    def _divergence_of(self, mine: Distribution, obs: dict[str, torch.Tensor]) -> torch.Tensor:
        with torch.no_grad():
            shown = self._demonstrator[0].get_distribution(obs)
        return torch.distributions.kl_divergence(shown.distribution, mine.distribution).mean(dim=1)

    @property
    def actor_parameters(self) -> list[nn.Parameter]:
        """What decides on actions: all but the critic's."""
        return [*self.mlp_extractor.policy_net.parameters(), *self.action_net.parameters(), self.log_std]


def make_policy(
    observation_space: spaces.Space[Any],
    action_space: spaces.Box,
    hidden: Sequence[int],
    learning_rate: Callable[[float], float],
    **weights: Any,
) -> DemonstratedPolicy:
    """A policy with untrained networks.

    Args:
        observation_space: the environments' dictionary.
        action_space: ±1 for each component.
        hidden: widths of the hidden layers, of the actor and the critic each.
        learning_rate: of the remaining share of the training.
        **weights: those of `DemonstratedPolicy`.
    """
    return DemonstratedPolicy(observation_space, action_space, learning_rate, **weights, **network(hidden))


def network(hidden: Sequence[int]) -> dict[str, Any]:
    """The arguments of a policy that say what its networks look like."""
    return {"net_arch": {"pi": list(hidden), "vf": list(hidden)}, "activation_fn": LogisticTanh}


class LogisticTanh(nn.Module):  # type: ignore[misc]  # whose types are not there without the extra
    """The hyperbolic tangent as 2σ(2x) − 1, within 2e-7.

    On a processor PyTorch computes σ in a third of the time of its own tanh, in which PPO and GCBC with networks of
    128×128 spent a quarter of theirs.
    """

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Of each number."""
        y: torch.Tensor = _TanhBySigmoid.apply(x)
        return y

    def add_to_graph(self, graph: Any, name: str) -> str:
        """The same in an ONNX graph, as `vvc_bench.policies.conversion` asks a layer for."""
        added: str = graph.add("Tanh", name)
        return added


class _TanhBySigmoid(torch.autograd.Function):  # type: ignore[misc]  # whose types are not there
    @staticmethod
    def forward(context: Any, x: torch.Tensor) -> torch.Tensor:
        y = (2.0 * x).sigmoid_().mul_(2.0).sub_(1.0)
        context.save_for_backward(y)
        return y

    @staticmethod
    def backward(context: Any, gradient: torch.Tensor) -> torch.Tensor:
        (y,) = context.saved_tensors
        derived: torch.Tensor = torch.ops.aten.tanh_backward(gradient, y)
        return derived
