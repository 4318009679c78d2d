"""How long the paper's demonstrations take to fly, here and with the paper's own binaries, in one run.

    python benchmarks/demonstrations.py [--flights 60]

Here the whole grid of 50,715 goals is flown, once compiled, and its successes are recorded. The binaries (`flycraft`:
guidance, control law and aircraft, each from Python as the authors' script calls them) fly goals drawn from the same
grid, and their time is scaled up to all of it. Flights end as those of pid-v0 do.
"""

import argparse
import importlib.util
import time

import numpy as np
from numpy.typing import NDArray
from simulator import ReferenceAircraft, ReferenceControlLaw, scratch_folder

from vvc_bench.datasets.catalogue import PAPER_GRID, PID
from vvc_bench.experts.pid import TABLE_1
from vvc_bench.rollout import fly_law
from vvc_bench.sim.units import DEGREES_PER_RADIAN

REPEATS = 3


def fly_here(goals: NDArray[np.float64], threads: int) -> float:
    """Seconds for all goals, median of repeats."""
    fly_law(PID, goals[:1], TABLE_1)
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        fly_law(PID, goals, TABLE_1, threads=threads)
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds))


def fly_binaries(goals: NDArray[np.float64]) -> tuple[float, int]:
    """Seconds for some goals with the binaries, and how many are reached."""
    reached = 0
    begin = time.perf_counter()
    for goal in goals:
        reached += _fly_one(dict(zip(("v", "mu", "chi"), goal.tolist(), strict=True)))
    return time.perf_counter() - begin, reached


def _fly_one(goal: dict[str, float]) -> bool:
    from flycraft.planes.utils.f16Classes import Guide

    task, frequency_hz = PID.task, PID.settings.frequency_hz
    aircraft, law, guide = ReferenceAircraft(frequency_hz), ReferenceControlLaw(frequency_hz), Guide()
    bands = np.array([task.speed_band, *[task.direction_band * DEGREES_PER_RADIAN] * 2])
    errors: list[list[float]] = []
    for _ in range(int(task.step_limit)):
        state = aircraft.state
        guide.step(goal, state)
        command = guide.getOutputDict()
        aircraft.step(*law.step(np.array([command["p"], command["nz"], command["pla"]]), state))
        after = aircraft.state
        if after["h"] < task.least_altitude:
            return False
        errors = [*errors, [abs(goal[name] - after[name]) for name in goal]][-int(task.reach_steps) :]
        if len(errors) == task.reach_steps and (np.mean(errors, axis=0) < bands).all():
            return True
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=60, help="flights with the binaries (default: 60)")
    flights = parser.parse_args().flights
    goals = PAPER_GRID.goals
    rows = {f"here, {threads} thread{'s' * (threads > 1)}": fly_here(goals, threads) for threads in (1, 2)}
    note = "flycraft is not installed"
    if importlib.util.find_spec("flycraft"):
        some = goals[np.random.default_rng(0).choice(len(goals), flights, replace=False)]
        with scratch_folder():
            seconds, reached = fly_binaries(some)
        rows["flycraft 0.2.0, scaled up"] = seconds * len(goals) / flights
        note = f"the binaries flew {flights} goals in {seconds:.1f} s and reached {reached}"
    print("| the paper's grid, 50,715 goals | seconds | × |\n|---|---:|---:|")
    slowest = max(rows.values())
    for name, seconds in rows.items():
        print(f"| {name} | {seconds:,.1f} | {slowest / seconds:,.0f} |")
    print(f"\n{note}")


if __name__ == "__main__":
    main()
