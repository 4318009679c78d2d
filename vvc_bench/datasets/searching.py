"""The search for a set's plans, sweep by sweep; an interrupted one goes on after its last whole sweep."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vvc_bench.datasets.catalogue import GoalGrid
from vvc_bench.flight.files import write_whole
from vvc_bench.rollout import Scenario
from vvc_bench.search import Budget, Found, check_searchable, neighbours, nothing_found, sweep

_SWEPT = "sweeps.npz"


def search_plans(
    scenario: Scenario,
    grid: GoalGrid,
    budget: Budget,
    folder: Path,
    *,
    seed: int,
    threads: int | None = None,
    progress: Callable[[int, int], object] = lambda done, everything: None,  # noqa: ARG005
) -> Found:
    """Search for plans to every goal of a grid.

    Args:
        scenario: rules, settings and start.
        grid: the goals.
        budget: how much to try.
        folder: where what was found is kept after each sweep; it must exist.
        seed: of all random numbers.
        threads: at most so many; by default all cores. The result does not depend on them.
        progress: told how many goals are done in all sweeps, and how many that will be.

    Raises:
        ValueError: for a scenario or budget that cannot be searched.
        OSError: if the folder cannot be written to.
    """
    check_searchable(scenario, budget)
    goals, azimuths = grid.goals, grid.azimuth_deg.values
    shape = (grid.speed_mps.points, grid.path_angle_deg.points, grid.azimuth_deg.points)
    near = neighbours(shape, symmetric=np.array_equal(azimuths, -azimuths[::-1]))
    begun, found = _read(folder / _SWEPT, nothing_found(len(goals), budget.ways))
    done, everything = begun * len(goals), budget.sweeps * len(goals)

    def show(count: int) -> None:
        nonlocal done
        done += count
        progress(done, everything)

    for number in range(begun, budget.sweeps):
        found = sweep(
            scenario, goals, near, found, budget, seed=seed, number=number, threads=threads, progress=show
        )
        _write(folder / _SWEPT, number + 1, found)
    return found


def _write(path: Path, sweeps: int, found: Found) -> None:
    def is_whole(place: Path) -> bool:
        number, read = _read(place, found)
        return number == sweeps and np.array_equal(read.plans, found.plans)

    write_whole(path, lambda place: np.savez(place, sweeps=sweeps, **found._asdict()), is_whole)


def _read(path: Path, nothing: Found) -> tuple[int, Found]:
    """Sweeps that were made, and what they found; none where the file is missing or broken."""
    try:
        with np.load(path) as stored:
            found = Found(stored["plans"], stored["scores"])
            sweeps = int(stored["sweeps"])
    except (FileNotFoundError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return 0, nothing
    return (sweeps, found) if found.plans.shape == nothing.plans.shape else (0, nothing)
