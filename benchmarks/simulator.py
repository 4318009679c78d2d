"""How fast the aircraft flies, beside the paper's own simulator, in one run on one machine.

    python benchmarks/simulator.py            # with flycraft beside it if it is installed
    python benchmarks/simulator.py --quick

Steps per second, median of repeats taken in turn, so that a machine whose speed drifts treats all alike. The column
"second core loaded" repeats the measurement while another process keeps one core busy.
"""

import argparse
import contextlib
import importlib.util
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from reference_binary import ReferenceAircraft, ReferenceControlLaw, scratch_folder

from vvc_bench import sim
from vvc_bench.sim import stepping
from vvc_bench.sim.parallel import available_threads

AIRCRAFT = 4096
COMMAND = [0.05, 1.1, 0.2]  # rad/s, g, throttle: a gentle turn

ONE_THREAD = f"step_many, {AIRCRAFT} aircraft, 1 thread"
KERNEL = "the kernel alone, 1 thread"
ONE_AIRCRAFT = "step, one aircraft, from Python"
FLYCRAFT_AIRCRAFT = "flycraft 0.2.0, control law and aircraft"
FLYCRAFT_ENVIRONMENT = "flycraft 0.2.0, its Gymnasium environment"

Measured = Callable[[], int]
"""Does some work and says how many steps it was."""


def many(threads: int, settings: sim.Settings, steps: int, count: int = AIRCRAFT) -> Measured:
    states = sim.start(settings, heading_deg=np.linspace(-180, 180, count))
    rng = np.random.default_rng(0)
    commands = np.array(COMMAND) * rng.uniform(0.5, 1.5, (count, 3))
    out = states.copy()

    def run() -> int:
        np.copyto(out, states)
        for _ in range(steps):
            sim.step_many(out, commands, settings, out=out, threads=threads)
        return steps * count

    return run


def kernel_only(settings: sim.Settings, steps: int) -> Measured:
    states = sim.start(settings, heading_deg=np.linspace(-180, 180, AIRCRAFT))
    commands = np.tile(COMMAND, (AIRCRAFT, 1))
    out = states.copy()

    def run() -> int:
        np.copyto(out, states)
        for _ in range(steps):
            stepping._step_rows(out, commands, stepping.STILL_ROW, settings.row, out, 0, AIRCRAFT)
        return steps * AIRCRAFT

    return run


def with_prange(settings: sim.Settings, steps: int) -> Measured:
    """The obvious alternative: the same kernel in Numba's own parallel loop, over 16 chunks."""
    step_rows, chunks = stepping._step_rows, 16

    @numba.njit(parallel=True, error_model="numpy")
    def step_chunks(rows, commands, conditions, scheme_row, out):  # type: ignore[no-untyped-def]
        size = rows.shape[0] // chunks
        for chunk in numba.prange(chunks):
            step_rows(rows, commands, conditions, scheme_row, out, chunk * size, (chunk + 1) * size)

    states = sim.start(settings, heading_deg=np.linspace(-180, 180, AIRCRAFT))
    commands = np.tile(COMMAND, (AIRCRAFT, 1))
    out = states.copy()

    def run() -> int:
        np.copyto(out, states)
        for _ in range(steps):
            step_chunks(out, commands, stepping.STILL_ROW, settings.row, out)
        return steps * AIRCRAFT

    return run


def one(settings: sim.Settings, steps: int) -> Measured:
    first = sim.start(settings)
    command = np.array(COMMAND)

    def run() -> int:
        state = first
        for _ in range(steps):
            state = sim.step(state, command, settings)
        return steps

    return run


def flycraft_model(steps: int) -> Measured:
    """Flycraft's control law and aircraft, without its environment."""
    command = np.array([COMMAND[0] * 57.3, *COMMAND[1:]])

    def run() -> int:
        aircraft, law = ReferenceAircraft(10.0), ReferenceControlLaw(10.0)
        for _ in range(steps):
            aircraft.step(*law.step(command, aircraft.state))
        return steps

    return run


def flycraft_environment(steps: int) -> Measured:
    """Flycraft's Gymnasium environment, as its users step it."""
    from flycraft.env import FlyCraftEnv

    with contextlib.redirect_stdout(None):
        environment = FlyCraftEnv()
        environment.reset(seed=0)
    action = np.array([COMMAND[0] * 57.3, *COMMAND[1:]], dtype=np.float32)

    def run() -> int:
        with contextlib.redirect_stdout(None):
            for _ in range(steps):
                _, _, terminated, truncated, _ = environment.step(action)
                if terminated or truncated:
                    environment.reset()
        return steps

    return run


def _spin() -> None:
    while True:
        sum(range(100_000))


@contextlib.contextmanager
def busy_core() -> Iterator[None]:
    """Another process that never sleeps."""
    process = multiprocessing.get_context("spawn").Process(target=_spin, daemon=True)
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def measure(cases: dict[str, Measured], repeats: int) -> dict[str, float]:
    """Median steps per second of each case, the cases taken in turn."""
    rates: dict[str, list[float]] = {name: [] for name in cases}
    for run in cases.values():
        run()
    for _ in range(repeats):
        for name, run in cases.items():
            begin = time.perf_counter()
            steps = run()
            rates[name].append(steps / (time.perf_counter() - begin))
    return {name: statistics.median(values) for name, values in rates.items()}


def all_cases() -> dict[str, Measured]:
    reference, accurate = sim.Settings(), sim.Settings(dynamics="accurate")
    cases = {
        ONE_THREAD: many(1, reference, 40),
        f"step_many, {AIRCRAFT} aircraft, 2 threads": many(2, reference, 40),
        KERNEL: kernel_only(reference, 40),
        ONE_AIRCRAFT: one(reference, 20_000),
        f"step_many, accurate dynamics, {AIRCRAFT} aircraft, 1 thread": many(1, accurate, 2),
        f"step_many, accurate dynamics, {AIRCRAFT} aircraft, 2 threads": many(2, accurate, 2),
    }
    if importlib.util.find_spec("flycraft"):
        cases |= {FLYCRAFT_AIRCRAFT: flycraft_model(1000), FLYCRAFT_ENVIRONMENT: flycraft_environment(300)}
    return cases


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    repeats = 5 if parser.parse_args().quick else 21
    with scratch_folder():
        cases = all_cases()
        quiet = measure(cases, repeats)
        with busy_core():
            loaded = measure(cases, repeats)
        peer = {"the same kernel in numba's prange": with_prange(sim.Settings(), 40)}
        quiet |= measure(peer, repeats)  # last, for its idle threads poll and disturb the others
        with busy_core():
            loaded |= measure(peer, repeats)

    print(f"{os.cpu_count()} cores, {available_threads()} available; guidance mode, 10 Hz; median of {repeats}\n")
    peers = [quiet.get(peer) for peer in (FLYCRAFT_AIRCRAFT, FLYCRAFT_ENVIRONMENT)]
    print("| | steps/s | × flycraft's aircraft | × its environment | steps/s, second core loaded |")
    print("|---|---:|---:|---:|---:|")
    for name, rate in quiet.items():
        ratios = " | ".join(f"{rate / peer:,.1f}" if peer else "not installed" for peer in peers)
        print(f"| {name} | {rate:,.0f} | {ratios} | {loaded[name]:,.0f} |")
    batch, single = quiet[ONE_THREAD] / quiet[KERNEL], quiet[ONE_AIRCRAFT] / quiet[KERNEL]
    print(f"\nShare of the time that is physics: {batch:.0%} in step_many, {single:.0%} in step.")


if __name__ == "__main__":
    main()
