"""A dataset as its users see it: cheap columns and episodes, chosen by what is known of them."""

import dataclasses
import hashlib
import itertools
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.datasets.manifest import CorruptDataset
from vvc_bench.datasets.schema import OBSERVED, Values, arrays_of
from vvc_bench.datasets.stored import StoredSet
from vvc_bench.datasets.transitions import Transitions, map_cache, transitions_of, write_cache
from vvc_bench.goals import checked_goals
from vvc_bench.home import home_folder
from vvc_bench.rollout import Episodes, Scenario, replay
from vvc_bench.sim.fields import Goal, field_array
from vvc_bench.tasks import make_task

if TYPE_CHECKING:
    import pandas as pd

ENVIRONMENT_ID = "VVC/Hard-v0"
"""What environments are made from; every field of the task is set to the scenario's."""

_GOAL_DIGITS = 9  # decimals, in outside units, to which two goals are the same


class Statistics(NamedTuple):
    """What columns are normalised with; each of shape (columns,)."""

    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    min: NDArray[np.float64]
    max: NDArray[np.float64]


class Dataset:
    """A set of flights, or a choice of its episodes.

    Nothing is read before it is asked for, and nothing is handed over that differs from what was written. Choosing
    episodes gives another `Dataset` over the same files. It can be pickled and sent to other processes.

    Args:
        stored: the set on disk.
        which: shape (E,): the episodes chosen, in order; all by default.
    """

    def __init__(self, stored: StoredSet, which: NDArray[np.int64] | None = None) -> None:
        self._stored = stored
        self._which = which

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopened, (self.folder, self.hash, self._which)

    def __len__(self) -> int:
        return self.manifest["counts"]["episodes"] if self._which is None else len(self._which)

    def __repr__(self) -> str:
        counts = self.manifest["counts"]
        chosen = "" if self._which is None else f"{len(self)} of "
        return f"<Dataset {self.name}: {chosen}{counts['episodes']} episodes, {counts['transitions']} transitions>"

    @property
    def name(self) -> str:
        """The set's name."""
        name: str = self.manifest["name"]
        return name

    @property
    def manifest(self) -> dict[str, Any]:
        """What the set says of itself."""
        return self._stored.manifest

    @property
    def folder(self) -> Path:
        """Where the set lies."""
        return self._stored.folder

    @property
    def hash(self) -> str:
        """SHA-256 of the manifest, and so of everything."""
        return self._stored.hash

    @property
    def scenario(self) -> Scenario:
        """Rules, settings, start and conditions of the flights."""
        return self._stored.scenario

    # Reading

    @property
    def goals(self) -> NDArray[np.float64]:
        """Goal of each episode, shape (E, 3): speed in m/s, path angle and azimuth in degrees."""
        return self._of_chosen(self._stored.episode_arrays["goals"])

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Transitions of each episode, shape (E,)."""
        return self.episode_column("length").astype(np.int64)

    def episode_column(self, name: str) -> NDArray[Any]:
        """A column of the table of episodes, shape (E,).

        Raises:
            ValueError: for an unknown name.
            CorruptDataset: if the file is not as it was written.
        """
        _require_known([name], self._stored.episode_columns)
        return self._of_chosen(self._stored.episodes[name])

    def column(self, name: str) -> NDArray[Any]:
        """A column of the table of transitions, shape (N,); see `columns`."""
        return self.columns([name])[name]

    def columns(self, names: Sequence[str] | None = None) -> Values:
        """Columns of the table of transitions; all by default. The arrays may be read-only.

        Raises:
            ValueError: for an unknown name.
            CorruptDataset: if what is read is not as it was written.
        """
        known = self._stored.transition_columns
        names = list(known) if names is None else names
        _require_known(names, known)
        if self._which is None:
            return self._stored.transitions.read(names)
        groups, rows = self._groups_and_rows(self._which)
        return {name: values[rows] for name, values in self._stored.transitions.read(names, groups).items()}

    def read(self) -> Episodes:
        """The flights, whole. Of a whole set every byte is verified, of a choice what is read.

        Raises:
            CorruptDataset: if something is not as it was written.
        """
        stored = self._stored
        if self._which is None:
            stored.verify()
        columns = self.columns(list(itertools.chain(*stored.layout.transitions.values())))
        return Episodes(
            self.scenario,
            offsets=np.concatenate([[0], np.cumsum(self.lengths)]),
            **arrays_of(columns, stored.layout.transitions),
            **{name: self._of_chosen(array) for name, array in stored.episode_arrays.items()},
        )

    def __getitem__(self, index: int) -> Episodes:
        """One flight."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"episode {index} of {len(self)}")
        return self.select([index]).read()

    def __iter__(self) -> Iterator[Episodes]:
        """Flights one by one; those that lie together are read together."""
        which = self._chosen
        breaks = np.flatnonzero(np.diff(self._stored.episodes["row_group"][which])) + 1
        for part in np.split(which, breaks) if len(which) else []:
            together = Dataset(self._stored, part).read()
            yield from (together.select([e]) for e in range(len(part)))

    def check(self) -> Episodes:
        """The whole set, read and verified, what follows from other columns recomputed.

        Raises:
            CorruptDataset: if anything is not as it should be.
        """
        return self._stored.check()

    @property
    def _chosen(self) -> NDArray[np.int64]:
        return np.arange(len(self)) if self._which is None else self._which

    def _of_chosen(self, values: NDArray[Any]) -> NDArray[Any]:
        return values if self._which is None else values[self._which]

    def _groups_and_rows(self, which: NDArray[np.int64]) -> tuple[list[int], NDArray[np.int64]]:
        """The row groups that episodes lie in, and their rows among those of these groups."""
        offsets, bounds = self._stored.offsets, self._stored.group_bounds
        groups, index = np.unique(self._stored.episodes["row_group"][which], return_inverse=True)
        starts, sizes = bounds[groups], bounds[groups + 1] - bounds[groups]
        first = offsets[which] - (starts - np.cumsum(sizes) + sizes)[index]
        lengths = offsets[which + 1] - offsets[which]
        ends = np.cumsum(lengths)
        rows = np.arange(ends[-1] if len(ends) else 0) + np.repeat(first - ends + lengths, lengths)
        return groups.tolist(), rows

    # Choosing

    def select(self, which: ArrayLike) -> "Dataset":
        """Some episodes, by index, mask or slice of the ones here, in the order given."""
        indices = which if isinstance(which, slice) else np.atleast_1d(np.asarray(which))
        nothing = isinstance(indices, np.ndarray) and not indices.size
        return Dataset(self._stored, self._chosen[:0] if nothing else self._chosen[indices])

    def where(self, **wanted: Any) -> "Dataset":
        """Episodes by columns of the table of episodes: numbers by bounds, both included; text by what it may be.

        ``where(goal_speed_mps=(150, 250), length=(0, 400), source="pid", outcome=["crash", "time_limit"])``

        Raises:
            ValueError: for an unknown name, or bounds that are not two numbers.
        """
        mask = np.ones(len(self), dtype=np.bool_)
        for name, allowed in wanted.items():
            values = self.episode_column(name)
            if values.dtype.kind == "U":
                mask &= np.isin(values, np.atleast_1d(allowed))
                continue
            if np.shape(allowed) != (2,):
                raise ValueError(f"{name} needs bounds as in {name}=(low, high), got {allowed!r}")
            mask &= (values >= allowed[0]) & (values <= allowed[1])
        return self.select(np.flatnonzero(mask))

    def between_quantiles(self, name: str, low: float, high: float) -> "Dataset":
        """Episodes by quality: ``between_quantiles("length", 0, 0.25)`` is the shortest quarter, with ties more.

        Raises:
            ValueError: for an unknown column of episodes, or quantiles outside 0 ≤ low ≤ high ≤ 1.
        """
        if not 0.0 <= low <= high <= 1.0:
            raise ValueError(f"quantiles must be 0 ≤ low ≤ high ≤ 1, got {low} and {high}")
        values = self.episode_column(name)
        return self.where(**{name: np.quantile(values, (low, high))}) if len(self) else self

    def split(self, validation: float = 0.1, seed: int = 0) -> tuple["Dataset", "Dataset"]:
        """Two choices that share no goal: for training, and about a share ``validation`` of the goals to validate with.

        Which side a goal is on depends on the goal and the seed alone, so that it is the same in every set. A goal and
        its mirror image, left for right, are on the same side.

        Raises:
            ValueError: for a share outside [0, 1].
        """
        if not 0.0 <= validation <= 1.0:
            raise ValueError(f"the share to validate with must lie in [0, 1], got {validation}")
        left = field_array(Goal, "mirror") < 0
        goals = _rounded(self.goals)
        goals[:, left] = np.abs(goals[:, left])
        distinct, index = np.unique(goals, axis=0, return_inverse=True)
        held_out = np.array([_lot(goal, seed) < validation for goal in distinct], dtype=np.bool_)[index.reshape(-1)]
        return self.select(np.flatnonzero(~held_out)), self.select(np.flatnonzero(held_out))

    @property
    def seen_goals(self) -> NDArray[np.float64]:
        """The goals that occur here, each once, shape (G, 3)."""
        return np.unique(_rounded(self.goals), axis=0)

    def is_seen(self, goals: ArrayLike) -> NDArray[np.bool_]:
        """Whether goals, shape (K, 3), occur here; shape (K,).

        Raises:
            ValueError: for goals that are none.
        """
        seen = set(map(tuple, self.seen_goals.tolist()))
        asked = _rounded(np.atleast_2d(checked_goals(goals)))
        return np.array([tuple(goal) in seen for goal in asked.tolist()], dtype=np.bool_)

    # Using

    def statistics(self, names: Sequence[str] = OBSERVED) -> Statistics:
        """Figures to normalise columns with, stored with the set: of all its transitions, also for a choice.

        Raises:
            ValueError: for a column without any, or a set without transitions.
        """
        stored = self.manifest["columns"]["transitions"]
        _require_known(names, {name: known for name, known in stored.items() if set(Statistics._fields) <= set(known)})
        return Statistics(*(np.array([stored[name][key] for name in names]) for key in Statistics._fields))

    def transitions(self) -> Transitions:
        """Observations, actions, rewards, true next observations, ends and goals, side by side in memory."""
        return transitions_of(self.read())

    def memory_mapped(self) -> Transitions:
        """The same from a training cache, mapped into memory: for fast random batches, shared between processes.

        The cache is made at the first call, under ``training-cache`` in the cache folder (``VVC_BENCH_HOME``), named by
        the set's hash and, of a choice, the episodes'. A damaged one is made anew.

        Raises:
            ValueError: if there is no episode.
            OSError: if it cannot be written.
        """
        if not len(self):
            raise ValueError(f"{self!r} has no episodes to train with")
        choice = "" if self._which is None else "-" + hashlib.sha256(self._which.tobytes()).hexdigest()[:16]
        folder = home_folder() / "training-cache" / (self.hash + choice)
        cached = map_cache(folder)
        if cached is None:
            write_cache(folder, self.transitions())
            cached = map_cache(folder)
        if cached is None:
            raise OSError(f"{folder} does not read back as it was written; is the disk full?")
        return cached

    def to_pandas(self, names: Sequence[str] | None = None) -> "pd.DataFrame":
        """Columns of transitions, all by default, as a frame."""
        import pandas as pd

        return pd.DataFrame(self.columns(names))

    def episodes_to_pandas(self) -> "pd.DataFrame":
        """The table of episodes as a frame."""
        import pandas as pd

        return pd.DataFrame({name: self.episode_column(name) for name in self._stored.episode_columns})

    def relabelled(self, **task_fields: object) -> Episodes:
        """The flights judged by another task: rewards, events and ends, by column name as in `make_task`.

        The actions are flown again, from the same starts: what a task says of a flight depends on its whole state. A
        flight ends with its first event under the other task, and in no event if its actions run out before. Mirrored
        records, which the aircraft does not fly exactly, become what it flies.

        Raises:
            ValueError: for an unknown field, or an impossible value.
        """
        flights = self.read()
        scenario = dataclasses.replace(self.scenario, task=make_task(self.scenario.task, **task_fields))
        return replay(
            scenario,
            flights.goals,
            flights.actions,
            flights.offsets,
            seeds=flights.seeds,
            sources=flights.sources,
            starts=flights.starts,
        )

    def environment(self, **options: Any) -> "gymnasium.Env[Any, Any]":
        """The environment that the flights are from, with goals drawn from those here.

        Args:
            **options: anything else to set, as ``goals=`` or ``render_mode=`` (`vvc_bench.envs.options.make_fleet`).
        """
        options = environment_options(self.scenario) | {"goals": self.seen_goals.tolist()} | options
        return gymnasium.make(ENVIRONMENT_ID, **options)

    def vector_environment(self, num_envs: int, **options: Any) -> "gymnasium.vector.VectorEnv[Any, Any, Any]":
        """The same for many aircraft at once; takes Gymnasium 1.1 or newer."""
        options = environment_options(self.scenario) | {"goals": self.seen_goals.tolist()} | options
        return gymnasium.make_vec(ENVIRONMENT_ID, num_envs=num_envs, vectorization_mode="vector_entry_point", **options)


def environment_options(scenario: Scenario) -> dict[str, Any]:
    """What to make an environment with that flies a scenario, besides `ENVIRONMENT_ID`."""
    document = scenario.to_json()
    task: dict[str, Any] = document.pop("task")
    return task | document


def _reopened(folder: Path, expected: str, which: NDArray[np.int64] | None) -> Dataset:
    """The same set in another process."""
    stored = StoredSet(folder)
    if stored.hash != expected:
        raise CorruptDataset(f"{folder} holds another set than before; load it again")
    return Dataset(stored, which)


def _require_known(names: Sequence[str], known: Collection[str]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"unknown column {name!r}; known are {', '.join(known)}")


def _rounded(goals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Goals of which equal ones have the same bits."""
    return np.round(goals, _GOAL_DIGITS) + 0.0


def _lot(goal: NDArray[np.float64], seed: int) -> float:
    """A number in [0, 1) that a goal draws, once and for all."""
    digest = hashlib.blake2b(goal.astype("<f8").tobytes(), key=str(seed).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") / 2.0**64
