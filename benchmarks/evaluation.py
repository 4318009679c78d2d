"""How fast policies are judged, where the time goes, how much memory it takes, and how far another machine may differ.

    python benchmarks/evaluation.py [--quick] [--threads N]

The network has two hidden layers of 128 (tanh) in an ONNX file. Core-seconds are what the process computed, whatever
else the machine did; the memory is the largest that it has had by then. For the last table the network's answers are
moved by one unit in the last place of float32, up or down by chance at each step: about what another processor's
rounding may do.
"""

import argparse
import dataclasses
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench.evaluation import Evaluation, evaluate, named_protocol
from vvc_bench.evaluation.flights import chunks, fly_chunk, measured
from vvc_bench.policies import Agent, open_agent
from vvc_bench.rollout import Policy

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from small_policies import write_network

SHOWN = ("success", "length_steps", "return", "speed_error_mps")


@dataclasses.dataclass(frozen=True)
class Shaken:
    """Another agent whose answers are moved by one unit in the last place."""

    agent: Any
    seed: int
    name: str = "shaken"

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        """A policy with a generator of its own."""
        policy, generator = self.agent.begin(seeds), np.random.default_rng([self.seed, *seeds[:1]])

        def shaken(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
            actions = np.asarray(policy(observed))
            ends = np.where(generator.random(actions.shape) < 0.5, -np.inf, np.inf).astype(np.float32)
            return np.nextafter(actions, ends)

        return shaken

    def describe(self) -> dict[str, str | None]:
        """No policy for anything else."""
        return {"kind": "benchmark", "name": self.name, "sha256": None}


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def timed(task: Callable[[], Evaluation]) -> tuple[float, Evaluation]:
    begun = time.perf_counter()
    result = task()
    return time.perf_counter() - begun, result


def speeds(network: Agent, repeats: int, threads: int | None, grid: bool) -> None:
    print("| policy | protocol | flights | steps | s | core-seconds | steps/s | peak memory, MB |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    runs = [(network, "hard-1k-v0"), (network, "robust-all-1k-v0"), (network, "turn-climb-v0")]
    runs += [(open_agent("pid"), "hard-1k-v0"), (open_agent("random"), "hard-1k-v0")]
    runs += [(network, "hard-grid-v0")] if grid else []
    for agent, name in runs:
        protocol = named_protocol(name)
        evaluate(agent, protocol, threads=threads) if len(protocol) <= 1000 else None  # compiles what is needed
        all_taken, begun = [], time.process_time()
        for _ in range(repeats if len(protocol) <= 1000 else 1):
            taken, result = timed(lambda agent=agent, protocol=protocol: evaluate(agent, protocol, threads=threads))
            all_taken.append(taken)
        seconds, steps = statistics.median(all_taken), int(result.episodes["length_steps"].sum())
        worked = (time.process_time() - begun) / len(all_taken)
        cells = (
            f"{len(protocol):,} | {steps:,} | {seconds:.2f} | {worked:.2f} | {steps / seconds:,.0f} | {peak_mb():,.0f}"
        )
        print(f"| {agent.name} | {name} | {cells} |", flush=True)


def parts(network: Agent) -> None:
    """Where the time of one chunk goes, in one thread."""
    chunk = next(chunks(named_protocol("hard-1k-v0"), 0))
    spent = {"policy": 0.0}

    class Timed:
        name = "timed"

        def begin(self, seeds: NDArray[np.int64]) -> Policy:
            policy = network.begin(seeds)

            def act(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
                begun = time.perf_counter()
                actions = np.asarray(policy(observed))
                spent["policy"] += time.perf_counter() - begun
                return actions

            return act

        def describe(self) -> dict[str, str | None]:
            return network.describe()

    begun = time.perf_counter()
    flights = fly_chunk(Timed(), chunk)
    flown = time.perf_counter()
    measured(flights, chunk, None)
    done = time.perf_counter()
    print("\n| part of a chunk | ms |\n|---|---:|")
    for name, seconds in (
        ("policy", spent["policy"]),
        ("simulator and bookkeeping", flown - begun - spent["policy"]),
        ("measures", done - flown),
    ):
        print(f"| {name} | {1e3 * seconds:.0f} |")


def robustness(network: Agent, repeats: int) -> None:
    protocol = named_protocol("hard-1k-v0")
    exact = evaluate(network, protocol)
    print(f"\nmoved by one unit in the last place, {protocol.name}:\n")
    print(
        "| run | reached | end otherwise | length of others, largest change | mean return |\n|---|---:|---:|---:|---:|"
    )
    print(f"| exact | {exact.summary['success']['count']} | | | {exact.summary['return']['mean']:.6f} |")
    for seed in range(repeats):
        moved = evaluate(Shaken(network, seed), protocol)
        other = moved.episodes["termination"] != exact.episodes["termination"]
        change = (moved.episodes["length_steps"] - exact.episodes["length_steps"]).abs()[~other].max()
        print(
            f"| {seed} | {moved.summary['success']['count']} | {int(other.sum())} | {change} | "
            f"{moved.summary['return']['mean']:.6f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="without the grid, fewer repeats")
    parser.add_argument("--threads", type=int, help="by default all cores")
    options = parser.parse_args()
    repeats = 3 if options.quick else 5
    with tempfile.TemporaryDirectory() as place:
        network = open_agent(str(write_network(Path(place, "network-128x128.onnx"))))
        speeds(network, repeats, options.threads, not options.quick)
        parts(network)
        robustness(network, repeats)


if __name__ == "__main__":
    main()
