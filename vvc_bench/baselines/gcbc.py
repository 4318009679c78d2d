"""Goal-conditioned behavioural cloning, by imitation's ``BC``."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from imitation.algorithms.bc import BC
from imitation.data.types import DictObs
from imitation.util.logger import HierarchicalLogger, configure
from numpy.typing import NDArray

from vvc_bench.baselines.actors import DemonstratedPolicy, make_policy
from vvc_bench.baselines.configurations import CloningConfiguration
from vvc_bench.baselines.unit_actions import to_unit, unit_box
from vvc_bench.datasets.transitions import Transitions, dictionary
from vvc_bench.envs.options import Spaces


class Batches:
    """Transitions in random batches: an epoch for each pass, ready as imitation takes them.

    imitation's own loader collects a batch sample by sample, which takes most of its time.

    Args:
        transitions: what is cloned.
        bounds: of the actions, which are scaled to ±1.
        batch_size: what is left of an epoch after whole batches is passed over, as it does.
        generator: shuffles.

    Raises:
        ValueError: for fewer transitions than a batch.
    """

    def __init__(
        self, transitions: Transitions, bounds: spaces.Box, batch_size: int, generator: np.random.Generator
    ) -> None:
        if len(transitions.rewards) < batch_size:
            raise ValueError(f"a batch of {batch_size} takes as many transitions; there are {len(transitions.rewards)}")
        self._observations = dictionary(transitions.observations, transitions.goals)
        self._actions = to_unit(transitions.actions, bounds)
        self._batch_size = batch_size
        self._generator = generator

    def __len__(self) -> int:
        return len(self._actions) // self._batch_size

    def __iter__(self) -> Iterator[dict[str, Any]]:
        order = self._generator.permutation(len(self._actions))
        for k in range(len(self)):
            yield self._take(order[k * self._batch_size : (k + 1) * self._batch_size])

    def _take(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        seen = {name: values[rows] for name, values in self._observations.items()}
        return {"obs": DictObs(seen), "acts": self._actions[rows]}


def clone(
    transitions: Transitions,
    where: Spaces,
    configuration: CloningConfiguration,
    seed: int,
    *,
    epochs: int | None = None,
    logger: HierarchicalLogger | None = None,
    on_epoch: Callable[[int, DemonstratedPolicy], object] = lambda _epoch, _policy: None,
) -> DemonstratedPolicy:
    """Train a policy to do as demonstrated.

    Args:
        transitions: what is demonstrated.
        where: the environment's spaces.
        configuration: how.
        seed: of weights and batches.
        epochs: how many, in place of the configuration's.
        logger: where losses go; nowhere by default.
        on_epoch: told after each epoch, how many there were and the policy.

    Raises:
        ValueError: for fewer transitions than a batch.
    """
    assert isinstance(where.action, spaces.Box)
    torch.manual_seed(seed)
    policy = make_policy(where.observation, unit_box(where.action), configuration.hidden, lambda _: 0.0)
    generator = np.random.default_rng(seed)
    learner = BC(
        observation_space=where.observation,
        action_space=unit_box(where.action),
        rng=generator,
        policy=policy,
        demonstrations=Batches(transitions, where.action, configuration.batch_size, generator),
        batch_size=configuration.batch_size,
        optimizer_kwargs={"lr": configuration.learning_rate},
        ent_weight=configuration.entropy_weight,
        l2_weight=configuration.l2_weight,
        device="cpu",
        custom_logger=logger or configure(None, []),
    )
    policy.entropy_weight = 1.0  # imitation weighs the entropy itself
    done = 0

    def count() -> None:
        nonlocal done
        done += 1
        on_epoch(done, policy)

    learner.train(n_epochs=epochs or configuration.epochs, on_epoch_end=count, progress_bar=False)
    policy.entropy_weight = 0.0
    return policy
