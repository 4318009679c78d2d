"""The shortest known flight to each goal: tables in the package, that anyone's shorter flight improves.

A table holds lengths, and who flew them; a flight enters it by being flown again, never by its own word.
"""

from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.catalogue import HARD, PAPER_GRID, GoalGrid
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.flight.files import write_whole
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics import BestLengths
from vvc_bench.metrics.coverage import find_goals
from vvc_bench.rollout import Scenario, replay
from vvc_bench.sim.fields import columns

_FOLDER = "best_known"
_STEPS, _SOURCE = "steps", "source"
_FLIGHT_FILES = (".csv", ".parquet")


class Contest(NamedTuple):
    """What flights are compared under."""

    scenario: Scenario
    grid: GoalGrid


CONTESTS = {"hard-grid-v0": Contest(HARD, PAPER_GRID)}
"""By the name of the table."""
DEFAULT_CONTEST = "hard-grid-v0"


class BestKnown(NamedTuple):
    """A table; goals in ascending order."""

    goals: NDArray[np.float64]
    """Shape (K, 3), in outside units."""
    steps: NDArray[np.int64]
    sources: NDArray[np.str_]
    """Who flew it, shape (K,)."""

    @property
    def lengths(self) -> BestLengths:
        """What `vvc_bench.metrics` compares with."""
        return BestLengths(self.goals, self.steps)


class Submission(NamedTuple):
    """Flights that want to enter a table."""

    goals: NDArray[np.float64]
    """Shape (E, 3)."""
    actions: NDArray[np.float32]
    offsets: NDArray[np.int64]


class Judged(NamedTuple):
    """Flights as they were flown again, under the rules and from the start of the contest."""

    goals: NDArray[np.float64]
    """Shape (E, 3)."""
    reached: NDArray[np.bool_]
    steps: NDArray[np.int64]
    """Shape (E,): of those that reached, the step where they did."""
    known_steps: NDArray[np.float64]
    """Of the shortest known flight to the goal; infinite where none is known, NaN where the goal is not on the grid."""

    @property
    def better(self) -> NDArray[np.bool_]:
        """Which are shorter than what is known, or first; shape (E,)."""
        better: NDArray[np.bool_] = self.reached & (self.steps < self.known_steps)
        return better

    @property
    def ratios(self) -> NDArray[np.float64]:
        """Length over that of the shortest known flight, where one is known and the goal was reached."""
        comparable = self.reached & np.isfinite(self.known_steps)
        return self.steps[comparable] / self.known_steps[comparable]


def named_contest(name: str) -> Contest:
    """One of `CONTESTS`.

    Raises:
        ValueError: for an unknown name.
    """
    if name not in CONTESTS:
        raise ValueError(f"unknown table {name!r}; known are {', '.join(CONTESTS)}")
    return CONTESTS[name]


def table_path(name: str = DEFAULT_CONTEST) -> Path:
    """Where a table of the package lies."""
    named_contest(name)
    with as_file(files("vvc_bench.datasets").joinpath(_FOLDER, f"{name}.parquet")) as path:
        return path


def read_table(path: Path) -> BestKnown:
    """Read a table; one that does not exist is empty.

    Raises:
        ValueError: if the file is no such table.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.exists():
        return BestKnown(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.str_))
    try:
        table = pq.read_table(path)
        goals = np.stack([table[name].to_numpy() for name in GOAL_COLUMNS], axis=-1).astype(np.float64)
        steps = table[_STEPS].to_numpy().astype(np.int64)
        sources = np.array(table[_SOURCE].to_pylist(), dtype=np.str_)
    except (KeyError, pa.ArrowInvalid) as error:
        raise ValueError(f"{path} is no table of best-known flights: {error}") from None
    return BestKnown(goals, steps, sources)


def best_known(name: str = DEFAULT_CONTEST) -> BestKnown:
    """A table of the package.

    Raises:
        ValueError: for an unknown name.
    """
    return read_table(table_path(name))


def write_table(best: BestKnown, path: Path) -> None:
    """Write a table in one move.

    Raises:
        OSError: if it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    values = dict(zip(GOAL_COLUMNS, best.goals.T, strict=True))
    values |= {_STEPS: best.steps.astype(np.int32), _SOURCE: best.sources}
    table = pa.table({name: pa.array(column) for name, column in values.items()})

    def is_whole(place: Path) -> bool:
        return all(np.array_equal(*pair) for pair in zip(read_table(place), best, strict=True))

    write_whole(path, lambda place: pq.write_table(table, place, compression="zstd", compression_level=19), is_whole)


def read_submission(source: str) -> Submission:
    """The flights of a set, or the one of a file that ``vvc-bench fly`` wrote.

    Args:
        source: a set's name or folder; or a flight, as CSV or Parquet.

    Raises:
        ValueError: for an unknown name, or a file that is no flight in guidance mode to a goal.
        OSError: if it cannot be read.
    """
    if source.endswith(_FLIGHT_FILES):
        return _read_flight(Path(source))
    episodes = load_dataset(source).read()
    return Submission(episodes.goals, episodes.actions, episodes.offsets)


def _read_flight(path: Path) -> Submission:
    import pandas as pd

    frame = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
    commands = [f"command_{name}" for name in columns(HARD.settings.command_fields)]
    goal = [f"goal_{name}" for name in GOAL_COLUMNS]
    missing = [name for name in (*commands, *goal) if name not in frame]
    if missing or len(frame) < 2:
        raise ValueError(f"{path} is no flight in guidance mode to a goal: it has no column {', '.join(missing)}")
    actions = frame[commands].to_numpy()[:-1].astype(np.float32)
    return Submission(frame[goal].to_numpy(dtype=np.float64)[:1].round(9), actions, np.array([0, len(actions)]))


def judge(submission: Submission, contest: Contest, best: BestKnown, threads: int | None = None) -> Judged:
    """Fly a submission again and compare it with a table.

    Args:
        submission: flights; their actions are flown from the start of the contest, as the environment takes them.
        contest: rules, start and goals.
        best: the table.
        threads: at most so many; by default all cores.

    Raises:
        ValueError: for actions of another control mode, or with NaN.
    """
    flown = replay(contest.scenario, *submission, threads=threads)
    on_grid = find_goals(flown.goals, contest.grid.goals) >= 0
    places = find_goals(flown.goals, best.goals)
    known = np.full(len(flown), np.inf)
    known[places >= 0] = best.steps[places[places >= 0]]
    known[~on_grid] = np.nan
    return Judged(flown.goals, flown.reached, flown.lengths, known)


def improved(best: BestKnown, judged: Judged, source: str) -> BestKnown:
    """The table with every flight that is better; of several to one goal the shortest."""
    better = judged.better
    goals = np.concatenate([best.goals, judged.goals[better] + 0.0])
    steps = np.concatenate([best.steps, judged.steps[better]])
    sources = np.concatenate([best.sources, np.full(int(better.sum()), source)])
    order = np.lexsort((steps, *goals.T[::-1]))
    ordered = goals[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    chosen = order[first]
    return BestKnown(goals[chosen], steps[chosen], sources[chosen])


def nearest_goals(best: BestKnown, goal: Sequence[float], count: int) -> NDArray[np.int64]:
    """The entries whose goals are nearest, a degree counting as 2 m/s, as on the grid; the nearest first."""
    distance = np.linalg.norm((best.goals - np.asarray(goal)) * [0.5, 1.0, 1.0], axis=1)
    nearest: NDArray[np.int64] = np.argsort(distance, kind="stable")[:count]
    return nearest
