"""Evaluations made up for tests: right in form, with outcomes that are known."""

import hashlib
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from vvc_bench.evaluation import Evaluation
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.tasks import TASKS

BOX = TASKS["hard"].goals


def goals_of(count: int) -> np.ndarray:
    generator = np.random.default_rng(11)
    return np.array([BOX.sample(generator) for _ in range(count)], dtype=np.float32).astype(np.float64)


def made_up(
    name: str,
    chance: Callable[[np.ndarray], np.ndarray] | float,
    *,
    goals: int = 400,
    seeds: Sequence[int] = (0,),
    protocol: str = "hard-1k-v0",
    draw: int = 0,
) -> Evaluation:
    """Flights that reach with the given chance of their goals, and figures of plausible size."""
    generator = np.random.default_rng(draw)
    targets = goals_of(goals)
    share = chance(targets) if callable(chance) else np.full(goals, chance)
    parts = []
    for seed in seeds:
        reached = generator.random(goals) < share
        length = np.where(reached, 60 + 1.2 * np.abs(targets[:, 2]) + generator.gamma(3.0, 12.0, goals), 400)
        parts.append(
            pd.DataFrame(
                {
                    "seed": seed,
                    "goal": np.arange(goals),
                    **{f"goal_{column}": targets[:, k] for k, column in enumerate(GOAL_COLUMNS)},
                    "success": reached,
                    "termination": np.where(
                        reached, "reach_target", generator.choice(["time_limit", "crash", "extreme_state"], goals)
                    ),
                    "length_steps": np.minimum(length, 400).astype(np.int64),
                    "return": np.where(reached, -0.3, -1.0) * length,
                    "speed_error_mps": generator.gamma(3.0, 1.2, goals),
                    "path_angle_error_deg": generator.gamma(2.0, 0.3, goals),
                    "azimuth_error_deg": generator.gamma(2.0, 0.5, goals),
                    "direction_error_deg": np.minimum(generator.gamma(3.0, 0.6, goals), 2.95),
                    "time_ratio": pd.array([pd.NA] * goals, dtype="Float64"),
                }
            )
        )
    digest = hashlib.sha256(f"{name}{draw}".encode()).hexdigest()
    summary = {
        "protocol": {"name": protocol, "hash": hashlib.sha256(protocol.encode()).hexdigest(), "episodes": goals},
        "policy": {"kind": "onnx", "name": name, "sha256": digest},
        "seeds": list(seeds),
        "versions": {"vvc_bench": "0.1.0"},
    }
    return Evaluation(pd.concat(parts, ignore_index=True), summary, {})
