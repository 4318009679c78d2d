"""How fast the baselines learn, in one run on one machine (extra ``train``).

    python benchmarks/learning.py [--quick] [--device cuda]

GCBC: transitions a second through imitation's ``BC`` with our batches, and with its own loader, of the same flights.
PPO: steps a second, roll-out and updates together, on our vector environment, on one that does nothing (what is left is
Stable-Baselines3 and PyTorch), and on Stable-Baselines3's ``DummyVecEnv`` of single environments. With one thread and
with two, of PyTorch and of the aircraft. With ``--device`` GCBC and PPO on our environments also where that says, one
thread flying. Median of repeats taken in turn.
"""

import argparse
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from imitation.algorithms.bc import BC
from imitation.util.logger import HierarchicalLogger
from simulator import Measured, measure
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import vvc_bench
from vvc_bench import sim
from vvc_bench.baselines.actors import make_policy
from vvc_bench.baselines.configurations import GCBC_RELEASED, PPO_FAST
from vvc_bench.baselines.devices import CPU, find_device
from vvc_bench.baselines.gcbc import Cloning
from vvc_bench.baselines.ppo import Improving
from vvc_bench.baselines.recipes import Setting, make_environments
from vvc_bench.baselines.unit_actions import UnitActions, to_unit, unit_box
from vvc_bench.datasets.convert.imitation import to_transitions
from vvc_bench.datasets.transitions import transitions_of
from vvc_bench.envs.options import make_spaces
from vvc_bench.rollout import Episodes

AIRCRAFT, STEPS = 256, 128
SILENT = Logger(None, [])
WHERE: Any = make_spaces(sim.Settings())


class Nothing(VecEnv):
    """Environments whose observations never change and whose episodes never end."""

    def __init__(self, count: int) -> None:
        super().__init__(count, WHERE.observation, unit_box(WHERE.action))
        self._observed = {
            name: np.zeros((count, *box.shape), dtype=np.float32) for name, box in WHERE.observation.spaces.items()
        }
        self._rewards, self._dones = np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.bool_)
        self._infos: list[dict[str, Any]] = [{} for _ in range(count)]

    def reset(self) -> dict[str, np.ndarray]:  # noqa: D102
        return self._observed

    def step_async(self, actions: np.ndarray) -> None:  # noqa: D102
        pass

    def step_wait(self) -> Any:  # noqa: D102
        return self._observed, self._rewards, self._dones, self._infos

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: D102
        del attr_name, indices
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: D102
        pass

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **options: Any) -> list[Any]:  # noqa: D102
        del method_name, args, indices, options
        return []

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:  # noqa: D102
        del wrapper_class, indices
        return [False] * self.num_envs

    def close(self) -> None:  # noqa: D102
        pass


class Singles(DummyVecEnv):
    """`DummyVecEnv`, asked for goals as a curriculum's learner does."""

    goals = None

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: D102
        return [None] if attr_name == "goals" else super().get_attr(attr_name, indices)


def with_threads(threads: int, run: Measured) -> Measured:
    def counted() -> int:
        torch.set_num_threads(threads)
        return run()

    return counted


def our_batches(flights: Episodes, device: torch.device = CPU) -> Measured:
    transitions = transitions_of(flights)
    cloning = Cloning(transitions, None, WHERE, GCBC_RELEASED, 0, device)

    def run() -> int:
        cloning.advance(SILENT)
        return len(transitions.rewards)

    return run


def its_loader(flights: Episodes, batches: int) -> Measured:
    demonstrations = to_transitions(flights)
    scaled = to_unit(demonstrations.acts, WHERE.action)
    space = unit_box(WHERE.action)
    learner = BC(
        observation_space=WHERE.observation,
        action_space=space,
        rng=np.random.default_rng(0),
        policy=make_policy(WHERE.observation, space, GCBC_RELEASED.hidden, lambda _: 0.0, entropy_weight=1.0),
        demonstrations=type(demonstrations)(**{**vars(demonstrations), "acts": scaled}),
        batch_size=GCBC_RELEASED.batch_size,
        device="cpu",
        custom_logger=HierarchicalLogger(SILENT, []),
    )

    def run() -> int:
        with warnings.catch_warnings(action="ignore"):
            learner.train(n_batches=batches, progress_bar=False)
        return batches * GCBC_RELEASED.batch_size

    return run


def ppo(make: Callable[[], Any], aircraft: int, device: torch.device = CPU) -> Measured:
    configuration = PPO_FAST._replace(environments=aircraft, batch_size=min(PPO_FAST.batch_size, aircraft * STEPS))
    learner = Improving(make(), configuration, 0, device=device)

    def run() -> int:
        before = learner.done
        learner.advance(SILENT)
        return learner.done - before

    return run


def singles(count: int) -> UnitActions:
    return UnitActions(Singles([lambda: gymnasium.make("VVC/Hard-v0") for _ in range(count)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--device", help="an accelerator as PyTorch names it, as cuda")
    options = parser.parse_args()
    repeats = 2 if options.quick else 7
    flights = vvc_bench.load_dataset("pid-v0").select(slice(0, 400)).read()
    gcbc: dict[str, Measured] = {}
    learning: dict[str, Measured] = {}
    for threads in (1, 2):
        label = f"{threads} thread{'s' * (threads > 1)}"
        gcbc[f"GCBC, our batches, {label}"] = with_threads(threads, our_batches(flights))
        gcbc[f"GCBC, imitation's loader, {label}"] = with_threads(threads, its_loader(flights, 5))
        setting = Setting("hard", threads=threads)
        for name, make, aircraft in (
            ("our vector environment", lambda setting=setting: make_environments(setting, AIRCRAFT), AIRCRAFT),
            ("an environment that does nothing", lambda: UnitActions(Nothing(AIRCRAFT)), AIRCRAFT),
            ("DummyVecEnv of single environments", lambda: singles(AIRCRAFT), AIRCRAFT),
        ):
            learning[f"PPO, {name}, {label}"] = with_threads(threads, ppo(make, aircraft))
    if options.device is not None:
        device, there, setting = find_device(options.device), f"on {options.device}", Setting("hard")
        gcbc[f"GCBC, our batches, {there}"] = with_threads(1, our_batches(flights, device))
        learning[f"PPO, our vector environment, {there}"] = with_threads(
            1, ppo(lambda: make_environments(setting, AIRCRAFT), AIRCRAFT, device)
        )
    print(f"{len(flights.rewards):,} transitions; {AIRCRAFT} aircraft, {STEPS} steps a roll-out; median of {repeats}\n")
    for unit, cases in (("transitions/s", gcbc), ("steps/s", learning)):
        print(f"| | {unit} |\n|---|---:|")
        for name, rate in measure(cases, repeats).items():
            print(f"| {name} | {rate:,.0f} |", flush=True)
        print()


if __name__ == "__main__":
    main()
