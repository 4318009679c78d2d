"""Goal-conditioned behavioural cloning, by imitation's ``BC``."""

import contextlib
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from imitation.algorithms.bc import BC
from imitation.data.types import DictObs
from imitation.util.logger import HierarchicalLogger
from numpy.typing import NDArray
from stable_baselines3.common.logger import Logger

from vvc_bench.baselines.actors import DemonstratedPolicy, make_policy
from vvc_bench.baselines.configurations import CloningConfiguration
from vvc_bench.baselines.devices import CPU
from vvc_bench.baselines.unit_actions import to_unit, unit_box
from vvc_bench.datasets.transitions import Transitions, dictionary
from vvc_bench.envs.options import Spaces

_JUDGED = 16_384
"""Transitions that a loss is measured on, at most."""


class Batches:
    """Transitions in random batches: an epoch for each pass, ready as imitation takes them.

    imitation's own loader collects a batch sample by sample, which takes most of its time.

    Args:
        transitions: what is cloned.
        bounds: of the actions, which are scaled to ±1.
        batch_size: what is left of an epoch after whole batches is passed over.
        generator: shuffles.

    Raises:
        ValueError: for fewer transitions than a batch.
    """

    def __init__(
        self, transitions: Transitions, bounds: spaces.Box, batch_size: int, generator: np.random.Generator
    ) -> None:
        if len(transitions.rewards) < batch_size:
            raise ValueError(f"a batch of {batch_size} takes as many transitions; there are {len(transitions.rewards)}")
        parts = (transitions.observations, transitions.goals, to_unit(transitions.actions, bounds))
        self._table = np.concatenate(parts, axis=1)  # one row a transition: drawn rows are far apart in memory
        self._ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        self._batch_size = batch_size
        self._generator = generator

    def __len__(self) -> int:
        return len(self._table) // self._batch_size

    def __iter__(self) -> Iterator[dict[str, Any]]:
        order = self._generator.permutation(len(self._table))
        for k in range(len(self)):
            yield self.take(order[k * self._batch_size : (k + 1) * self._batch_size])

    def take(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        """Some transitions."""
        seen, goals, actions = np.split(self._table.take(rows, axis=0), self._ends, axis=1)
        return {"obs": DictObs(dictionary(seen, goals)), "acts": actions}

    def spread(self, count: int) -> dict[str, Any]:
        """So many transitions at most, evenly spread over all, always the same."""
        rows = np.linspace(0, len(self._table) - 1, min(count, len(self._table))).astype(np.int64)
        return self.take(rows)


class Cloning:
    """A policy that learns to do as demonstrated, an epoch at a time.

    What it is after an epoch follows from its arguments, also if it was stopped and restored in between.

    Args:
        training: what is demonstrated.
        validation: what losses are measured on besides; None for none.
        where: the environment's spaces.
        configuration: how.
        seed: of weights and batches.
        device: of the networks.

    Raises:
        ValueError: for fewer transitions than a batch.
    """

    unit = "epochs"

    def __init__(
        self,
        training: Transitions,
        validation: Transitions | None,
        where: Spaces,
        configuration: CloningConfiguration,
        seed: int,
        device: torch.device = CPU,
    ) -> None:
        assert isinstance(where.action, spaces.Box)
        torch.manual_seed(seed)
        self._generator = np.random.default_rng(seed)
        batches = Batches(training, where.action, configuration.batch_size, self._generator)
        self._judged = {"training": _on(device, batches.spread(_JUDGED))}
        if validation is not None and len(validation.rewards):
            held_out = Batches(validation, where.action, 1, self._generator)
            self._judged["validation"] = _on(device, held_out.spread(_JUDGED))
        self.done = 0
        weights = {"entropy_weight": 1.0, "with_values": False}  # imitation weighs the entropy itself
        self.policy: DemonstratedPolicy = make_policy(
            where.observation, unit_box(where.action), configuration.hidden, lambda _: 0.0, **weights
        )
        self._learner = BC(
            observation_space=where.observation,
            action_space=unit_box(where.action),
            rng=self._generator,
            policy=self.policy,
            demonstrations=batches,
            batch_size=configuration.batch_size,
            optimizer_kwargs={"lr": configuration.learning_rate},
            ent_weight=configuration.entropy_weight,
            l2_weight=configuration.l2_weight,
            device=device,
            custom_logger=HierarchicalLogger(Logger(None, []), []),
        )

    def advance(self, logger: Logger) -> None:
        """Learn for an epoch."""
        with _library_quiet():
            self._learner.train(n_epochs=1, progress_bar=False)
        self.done += 1
        for name, loss in self.losses().items():
            logger.record(f"loss/{name}", loss)
        logger.dump(self.done)

    def losses(self) -> dict[str, float]:
        """What imitation minimises, on a part of the transitions to train and to validate with."""
        with torch.no_grad(), _library_quiet():
            return {
                name: float(self._learner.loss_calculator(self.policy, batch["obs"], batch["acts"]).loss)
                for name, batch in self._judged.items()
            }

    def state(self) -> dict[str, Any]:
        """All that learning goes on from."""
        return {
            "done": self.done,
            "policy": self.policy.state_dict(),
            "optimizer": self._learner.optimizer.state_dict(),
            "generator": self._generator.bit_generator.state,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.done = state["done"]
        self.policy.load_state_dict(state["policy"])
        self._learner.optimizer.load_state_dict(state["optimizer"])
        self._generator.bit_generator.state = state["generator"]


def _on(device: torch.device, batch: dict[str, Any]) -> dict[str, Any]:
    """A batch where the networks are: imitation takes care of those that it learns from, and of no others."""
    seen = {name: torch.tensor(part, device=device) for name, part in batch["obs"].items()}
    return {"obs": seen, "acts": torch.tensor(batch["acts"], device=device)}


@contextlib.contextmanager
def _library_quiet() -> Iterator[None]:
    """Without imitation's warnings of what it does itself to observations that are dictionaries, and to its losses."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "trying to unwrap object of type", UserWarning)
        warnings.filterwarnings("ignore", "Converting a tensor with requires_grad", UserWarning)
        yield
