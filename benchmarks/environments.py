"""How fast the environments step, beside the paper's own, in one run on one machine.

    python benchmarks/environments.py [--quick]

As their callers see them: observations, rewards, terminations, infos and resets included. Steps per second, median of
repeats taken in turn. What is not installed (flycraft, Stable-Baselines3, Gymnasium 1.1) is left out.
"""

import argparse
import contextlib
import importlib.util
from typing import Any

import gymnasium
import numpy as np
from simulator import FLYCRAFT_ENVIRONMENT, Measured, busy_core, flycraft_environment, measure, scratch_folder

import vvc_bench  # noqa: F401  (registers the ids)

ENVIRONMENT = "VVC/Hard-v0"
AIRCRAFT = 4096
STEPS = 100
LEARNERS_AIRCRAFT = 256


def single(steps: int = 20_000) -> Measured:
    environment = gymnasium.make(ENVIRONMENT)
    environment.reset(seed=0)
    actions = np.random.default_rng(0).uniform([-60, 0.5, 0], [60, 3, 1], (64, 3)).astype(np.float32)

    def run() -> int:
        for step in range(steps):
            _, _, terminated, truncated, _ = environment.step(actions[step // 10 % 64])
            if terminated or truncated:
                environment.reset()
        return steps

    return run


def vector(threads: int, autoreset_mode: str) -> Measured:
    environments = gymnasium.make_vec(
        ENVIRONMENT,
        num_envs=AIRCRAFT,
        vectorization_mode="vector_entry_point",
        autoreset_mode=autoreset_mode,
        threads=threads,
    )
    environments.reset(seed=0)
    actions = np.random.default_rng(0).uniform([-60, 0.5, 0], [60, 3, 1], (8, AIRCRAFT, 3)).astype(np.float32)

    def run() -> int:
        for step in range(STEPS):
            environments.step(actions[step // 10 % 8])
        return STEPS * AIRCRAFT

    return run


def stable_baselines(environments: Any, steps: int) -> Measured:
    environments.reset()
    shape = (8, LEARNERS_AIRCRAFT, 3)
    actions = np.random.default_rng(0).uniform([-60, 0.5, 0], [60, 3, 1], shape).astype(np.float32)

    def run() -> int:
        for step in range(steps):
            environments.step(actions[step // 10 % 8])
        return steps * LEARNERS_AIRCRAFT

    return run


def vector_cases() -> dict[str, Measured]:
    if not hasattr(gymnasium.vector, "AutoresetMode"):
        return {}  # Gymnasium before 1.1
    return {
        f"{ENVIRONMENT}, {AIRCRAFT}, {mode} autoreset, {threads} thread{'s' * (threads > 1)}": vector(threads, name)
        for mode, name in (("next-step", "NextStep"), ("same-step", "SameStep"))
        for threads in (1, 2)
    }


def stable_baselines_cases() -> dict[str, Measured]:
    if not importlib.util.find_spec("stable_baselines3"):
        return {}
    from stable_baselines3.common.vec_env import DummyVecEnv

    from vvc_bench.envs.stable_baselines import VelocityVectorVecEnv

    many = VelocityVectorVecEnv(ENVIRONMENT, LEARNERS_AIRCRAFT, seed=0)
    singles = DummyVecEnv([lambda: gymnasium.make(ENVIRONMENT)] * LEARNERS_AIRCRAFT)
    return {
        f"{ENVIRONMENT}, {LEARNERS_AIRCRAFT}, for Stable-Baselines3": stable_baselines(many, 100),
        f"{ENVIRONMENT}, {LEARNERS_AIRCRAFT} single ones in its DummyVecEnv": stable_baselines(singles, 10),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    repeats = 5 if parser.parse_args().quick else 15
    with scratch_folder(), contextlib.ExitStack() as stack:
        cases = {
            f"{ENVIRONMENT}, one": single(),
            **vector_cases(),
            **stable_baselines_cases(),
        }
        if importlib.util.find_spec("flycraft"):
            cases[FLYCRAFT_ENVIRONMENT] = flycraft_environment(300)
        quiet = measure(cases, repeats)
        stack.enter_context(busy_core())
        loaded = measure(cases, repeats)
    peer = quiet.get(FLYCRAFT_ENVIRONMENT)
    print(f"guidance mode, 10 Hz; median of {repeats}\n")
    print("| | steps/s | × flycraft's environment | steps/s, second core loaded |")
    print("|---|---:|---:|---:|")
    for name, rate in quiet.items():
        ratio = f"{rate / peer:,.0f}" if peer else "not installed"
        print(f"| {name} | {rate:,.0f} | {ratio} | {loaded[name]:,.0f} |")


if __name__ == "__main__":
    main()
