"""Policies that come with the package: the laws of its experts, and chance."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.envs.options import make_spaces
from vvc_bench.experts.pid import APPENDIX_C, TABLE_1, WEIGHT_COMPENSATED, PidParameters
from vvc_bench.experts.pursuit import PURSUIT, PursuitParameters
from vvc_bench.rollout import Policy
from vvc_bench.rollout.replay import law_actions

LAWS: dict[str, PidParameters | PursuitParameters] = {
    "pid": APPENDIX_C,
    "pid-table-1": TABLE_1,
    "pid-compensated": WEIGHT_COMPENSATED,
    "pursuit": PURSUIT,
}
"""A law's figures by the policy's name."""
RANDOM = "random"
BUILT_IN = (*LAWS, RANDOM)
"""Names of all of them."""

_DRAWN_AHEAD = 64
"""Steps whose actions an aircraft draws at once: one at a time is slow."""


@dataclass(frozen=True)
class LawAgent:
    """A law as it answers to observations (`vvc_bench.rollout.replay.law_actions`)."""

    name: str
    parameters: PidParameters | PursuitParameters

    def begin(self, _seeds: NDArray[np.int64]) -> Policy:
        """The law has no memory and draws nothing."""
        return lambda observed: law_actions(observed["observation"], observed["desired_goal"], self.parameters)

    def describe(self) -> dict[str, str | None]:
        """A name stands for its figures."""
        return {"kind": "built-in", "name": self.name, "sha256": None}


@dataclass(frozen=True)
class RandomAgent:
    """Actions uniform in the action space; what an aircraft draws depends on its own seed alone."""

    settings: sim.Settings
    name: str = RANDOM

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        """A generator for each aircraft."""
        space = cast(spaces.Box, make_spaces(self.settings).action)
        generators = [np.random.default_rng(seed) for seed in seeds]
        actions = itertools.chain.from_iterable(_drawn_ahead(space, generators))
        return lambda _observed: next(actions)

    def describe(self) -> dict[str, str | None]:
        """It is its name."""
        return {"kind": "built-in", "name": self.name, "sha256": None}


def _drawn_ahead(space: spaces.Box, generators: Sequence[np.random.Generator]) -> Iterator[NDArray[np.float32]]:
    """Actions without end, shape (`_DRAWN_AHEAD`, B, w) at a time."""
    shape = (_DRAWN_AHEAD, *space.shape)
    while True:
        shares = np.stack([generator.random(shape, dtype=np.float32) for generator in generators], axis=1)
        yield space.low + (space.high - space.low) * shares
