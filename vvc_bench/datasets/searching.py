"""The search for a set's plans, sweep by sweep; an interrupted one goes on after its last whole sweep."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.catalogue import GoalGrid
from vvc_bench.flight.files import write_whole
from vvc_bench.rollout import Scenario
from vvc_bench.search import Budget, Found, check_searchable, neighbours, nothing_found, sweep

_SWEPT = "sweeps.npz"


class Search(NamedTuple):
    """A search so far."""

    found: Found
    reached: NDArray[np.int64]
    """Goals reached after each sweep, shape (sweeps,)."""
    mean_length_steps: NDArray[np.float64]
    """Of the shortest flights to them."""

    @property
    def sweeps(self) -> int:
        """Sweeps that were made."""
        return len(self.reached)

    def after(self, found: Found) -> "Search":
        """The search one sweep later."""
        lengths = found.lengths[~np.isnan(found.lengths)]
        mean = lengths.mean() if lengths.size else 0.0
        return Search(found, np.append(self.reached, lengths.size), np.append(self.mean_length_steps, mean))

    def to_json(self) -> dict[str, Any]:
        """How the search went, as a document."""
        return {"reached": self.reached.tolist(), "mean_length_steps": self.mean_length_steps.round(3).tolist()}


def search_plans(
    scenario: Scenario,
    grid: GoalGrid,
    budget: Budget,
    folder: Path,
    *,
    seed: int,
    threads: int | None = None,
    progress: Callable[[int, int], object] = lambda done, everything: None,  # noqa: ARG005
) -> Search:
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
    search = _read(folder / _SWEPT, nothing_found(len(goals), budget.ways))
    done, everything = search.sweeps * len(goals), budget.sweeps * len(goals)

    def show(count: int) -> None:
        nonlocal done
        done += count
        progress(done, everything)

    for number in range(search.sweeps, budget.sweeps):
        search = search.after(
            sweep(scenario, goals, near, search.found, budget, seed=seed, number=number, threads=threads, progress=show)
        )
        _write(folder / _SWEPT, search)
    return search


def _write(path: Path, search: Search) -> None:
    columns = {**search._asdict(), **search.found._asdict()}
    del columns["found"]

    def is_whole(place: Path) -> bool:
        return np.array_equal(_read(place, search.found).found.plans, search.found.plans)

    write_whole(path, lambda place: np.savez(place, **columns), is_whole)


def _read(path: Path, nothing: Found) -> Search:
    """What was written, or nothing where the file is missing or broken."""
    fresh = Search(nothing, np.zeros(0, dtype=np.int64), np.zeros(0))
    try:
        with path.open("rb") as file, np.load(file) as stored:
            found = Found(*(stored[name] for name in Found._fields))
            search = Search(found, stored["reached"], stored["mean_length_steps"])
    except (FileNotFoundError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return fresh
    return search if found.plans.shape == nothing.plans.shape else fresh
