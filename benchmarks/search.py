"""How long the search takes, and what it finds with how much.

    python benchmarks/search.py [--sweeps 4]

A coarse grid over the whole goal space is searched with one thread and with two. The first sweeps are the slow ones:
goals that were not reached try more, and their flights are long.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from vvc_bench.datasets.catalogue import HARD, SEARCH, Axis, GoalGrid
from vvc_bench.datasets.searching import Search, search_plans

GRID = GoalGrid(Axis(100.0, 300.0, 6), Axis(-85.0, 85.0, 9), Axis(-170.0, 170.0, 18))
REPEATS = 3


def search(sweeps: int, threads: int) -> tuple[float, Search]:
    """Seconds, median of repeats, and what was found."""
    seconds = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            budget = SEARCH._replace(sweeps=sweeps)
            found = search_plans(HARD, GRID, budget, Path(folder), seed=0, threads=threads)
            seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds)), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sweeps", type=int, default=4, help="as many of the search's sweeps (default: 4)")
    sweeps = parser.parse_args().sweeps
    search(1, 1)  # compiles
    rows = {threads: search(sweeps, threads) for threads in (1, 2)}
    plans = len(GRID.goals) * SEARCH.population * SEARCH.generations * sweeps
    print(f"| {len(GRID.goals)} goals, {sweeps} sweeps | seconds | plans a second |")
    print("|---|---:|---:|")
    for threads, (seconds, _) in rows.items():
        print(f"| {threads} thread{'s' * (threads > 1)} | {seconds:.1f} | {plans / seconds:,.0f} |")
    print("\n| sweep | goals reached | mean length, steps |\n|---:|---:|---:|")
    _, found = rows[1]
    for number, (reached, length) in enumerate(zip(found.reached, found.mean_length_steps, strict=True), start=1):
        print(f"| {number} | {100.0 * reached / len(GRID.goals):.1f} % | {length:.1f} |")


if __name__ == "__main__":
    main()
