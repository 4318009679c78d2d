"""Make a set from its specification: the same bytes whatever the threads, shards, engine or interruptions."""

import hashlib
import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.catalogue import BY_HASH, FlownByLaw, Mirrored, Searched, Specification, Updated, goals_flown
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.folders import locked
from vvc_bench.datasets.merge import Update, update
from vvc_bench.datasets.mirror import fly_under, mirror, mirror_and_fly
from vvc_bench.datasets.searching import search_plans
from vvc_bench.datasets.store import CorruptDataset, Description, open_dataset, write_dataset
from vvc_bench.experts.laws import Figures, make_pilot
from vvc_bench.jit import source_hash
from vvc_bench.metrics import summary
from vvc_bench.policies.agent import Agent
from vvc_bench.policies.trained import find_trained
from vvc_bench.rollout import Episodes, concatenate, fly_law, fly_policy
from vvc_bench.sim.task import Task
from vvc_bench.tasks import termination

Engine = Literal["local", "ray"]
Progress = Callable[[int, int], object]
"""Told how many goals are done, and how many there are."""

GOALS_PER_SHARD = 4096
SEARCH_SOURCE = "search"
"""What the flights of a search are labelled with."""


class _Flights(NamedTuple):
    """What is to be flown."""

    goals: NDArray[np.float64]
    figures: Figures
    """Of the law, or a manoeuvre for each goal."""
    source: str
    report: dict[str, Any]
    """What the metrics say of how these were found."""

    def split(self, count: int) -> "list[_Flights]":
        """Parts of about the same size."""
        parts = np.array_split(np.arange(len(self.goals)), count)
        return [
            self._replace(
                goals=self.goals[part].copy(),
                figures=self.figures[part].copy() if isinstance(self.figures, np.ndarray) else self.figures,
            )
            for part in parts
        ]


class _Shard(NamedTuple):
    """A part of the flights, and where they are kept until all are flown."""

    specification: Specification
    flights: _Flights
    folder: Path
    threads: int | None


def build_dataset(
    specification: Specification,
    folder: Path,
    *,
    find_parent: Callable[[str], Dataset],
    threads: int | None = None,
    shards: int | None = None,
    engine: Engine = "local",
    progress: Progress = lambda done, goals: None,  # noqa: ARG005
) -> Path:
    """Make a set.

    An interrupted build goes on where it stopped: shards that are done lie beside ``folder``, under a name that ends
    with a hash of specification and code.

    Args:
        specification: what to make.
        folder: where; replaced if it exists.
        find_parent: gives the sets that this one is made from.
        threads: at most so many for each shard; by default all cores.
        shards: parts that the grid is cut into; by default one for every 4,096 goals.
        engine: ``"local"``: one shard after another; ``"ray"``: over a Ray cluster (extra ``ray``).
        progress: told after each shard.

    Returns:
        The folder.

    Raises:
        ValueError: for an impossible number of shards, an unknown engine, or a policy that the package does not have.
        ImportError: for Ray, or onnxruntime for a policy, without its extra.
        OSError: if it cannot be written.
    """
    match specification.recipe:
        case FlownByLaw() | Searched():
            return _build_flown(specification, folder, threads, shards, engine, progress)
        case Mirrored(parent, _):
            return add_mirror_image(specification, folder, find_parent(parent), goals_flown(parent), threads=threads)
        case Updated(_, parent, policies):
            agents = [find_trained(policy.removeprefix(BY_HASH)) for policy in policies]
            return update_by_policies(
                specification, folder, find_parent(parent), agents, threads=threads, progress=progress
            )


def _build_flown(
    specification: Specification,
    folder: Path,
    threads: int | None,
    wanted_shards: int | None,
    engine: Engine,
    progress: Progress,
) -> Path:
    assert isinstance(specification.recipe, FlownByLaw | Searched)
    goals = specification.recipe.grid.goals
    count = -(-len(goals) // GOALS_PER_SHARD) if wanted_shards is None else wanted_shards
    if not 1 <= count <= len(goals):
        raise ValueError(f"shards must be 1 to {len(goals)}, the number of goals; got {count}")
    if engine not in get_args(Engine):
        raise ValueError(f"engine must be one of {', '.join(get_args(Engine))}; got {engine!r}")
    working = _working_folder(specification, folder)
    working.mkdir(parents=True, exist_ok=True)
    with locked(working):
        if working.exists():  # else another builder has just finished
            flights, progress = _prepare(specification, working, threads, progress)
            shards = [
                _Shard(specification, part, working / "shards" / f"{i:05d}-of-{count:05d}", threads)
                for i, part in enumerate(flights.split(count))
            ]
            _fly_missing(shards, engine, progress)
            _join(shards, folder, goals, flights.report)
            shutil.rmtree(working)
    return folder


def _prepare(
    specification: Specification, working: Path, threads: int | None, progress: Progress
) -> tuple[_Flights, Progress]:
    """What to fly, searched for first if need be, and whom to tell of the flights."""
    recipe = specification.recipe
    assert isinstance(recipe, FlownByLaw | Searched)
    goals = recipe.grid.goals
    if isinstance(recipe, FlownByLaw):
        return _Flights(goals, recipe.parameters, make_pilot(recipe.parameters).source, {}), progress
    searched = recipe.budget.sweeps * len(goals)
    search = search_plans(
        specification.scenario,
        recipe.grid,
        recipe.budget,
        working,
        seed=specification.seed,
        threads=threads,
        progress=lambda done, everything: progress(done, everything + len(goals)),
    )
    which, ways = search.found.kept(recipe.budget.patience)
    report = {"search": {"candidates_per_sweep": recipe.budget.candidates // recipe.budget.sweeps} | search.to_json()}
    flights = _Flights(goals[which], search.found.plans[which, ways], SEARCH_SOURCE, report)
    return flights, lambda done, everything: progress(searched + done, searched + everything)


def _fly_missing(shards: Sequence[_Shard], engine: Engine, progress: Progress) -> None:
    missing = [shard for shard in shards if not _is_done(shard)]
    everything = sum(len(shard.flights.goals) for shard in shards)
    done = everything - sum(len(shard.flights.goals) for shard in missing)
    progress(done, everything)
    for shard in _fly_all(missing, engine):
        done += len(shard.flights.goals)
        progress(done, everything)


def _join(shards: Sequence[_Shard], folder: Path, goals: NDArray[np.float64], report: dict[str, Any]) -> None:
    sets = [open_dataset(shard.folder) for shard in shards]
    events: Counter[str] = Counter()
    for part in sets:
        events.update(part.manifest["last_events"])
    episodes = concatenate([part.read() for part in sets])
    _write(shards[0].specification, folder, episodes, goals, dict(sorted(events.items())), report, {})


def add_mirror_image(
    specification: Specification,
    folder: Path,
    parent: Dataset,
    goals: NDArray[np.float64],
    *,
    threads: int | None = None,
) -> Path:
    """Make a set of another one and its mirror image; of two flights to one goal the shorter is kept.

    Args:
        specification: its recipe is `Mirrored`.
        folder: where; replaced if it exists.
        parent: the other set.
        goals: all that were flown, shape (K, 3), in outside units.
        threads: at most so many.

    Raises:
        OSError: if it cannot be written.
    """
    assert isinstance(specification.recipe, Mirrored)
    original = parent.read()
    image = mirror_and_fly(original, threads) if specification.recipe.resimulate else mirror(original)
    updated = update(original, image)
    report = {"mirrored": len(original), **_kept(updated)}
    _write(specification, folder, updated.episodes, goals, {}, {"mirror": report}, {parent.name: parent.hash})
    return folder


def update_by_policies(
    specification: Specification,
    folder: Path,
    parent: Dataset,
    agents: Sequence[Agent],
    *,
    threads: int | None = None,
    progress: Progress = lambda done, goals: None,  # noqa: ARG005
) -> Path:
    """Make a set of another one after policies have flown every goal, one by one: what is new or shorter is taken.

    Args:
        specification: its recipe is `Updated`; what it says of a policy becomes the source of its flights.
        folder: where; replaced if it exists.
        parent: the other set; under other rules, its flights are flown anew first, and those that reach are kept.
        agents: the policies, without memory, in the recipe's order.
        threads: at most so many.
        progress: told how many flights were flown.

    Raises:
        ValueError: for actions of another shape, or NaN.
        OSError: if it cannot be written.
    """
    assert isinstance(specification.recipe, Updated)
    goals, done = specification.recipe.grid.goals, 0
    total = len(goals) * len(agents)

    def count(flown: int) -> None:
        nonlocal done
        done += flown
        progress(done, total)

    scenario, episodes = specification.scenario, parent.read()
    if parent.scenario != scenario:
        episodes = fly_under(episodes, scenario, threads)
    events: Counter[str] = Counter()
    updates = {}
    for agent, policy in zip(agents, specification.recipe.policies, strict=True):
        flown = fly_policy(
            scenario,
            goals,
            agent.begin(np.zeros(len(goals), dtype=np.int64)),
            seeds=specification.seed,
            source=f"{specification.name}/{policy}",
            threads=threads,
            progress=count,
        )
        updated = update(episodes, flown.episodes)
        episodes, updates[policy] = updated.episodes, _kept(updated)
        events.update(_count_events(scenario.task, flown.last_events))
    report, parents = {"updates": updates}, {parent.name: parent.hash}
    _write(specification, folder, episodes, goals, dict(sorted(events.items())), report, parents)
    return folder


def _kept(updated: Update) -> dict[str, int]:
    return {"reached": updated.offered, "new_goals": updated.new, "shorter": updated.shorter}


def _write(
    specification: Specification,
    folder: Path,
    episodes: Episodes,
    goals: NDArray[np.float64],
    last_events: dict[str, int],
    report: dict[str, Any],
    parents: dict[str, str],
) -> None:
    metrics = summary(episodes, goals).to_json() | report
    write_dataset(
        folder,
        episodes,
        Description(
            name=specification.name,
            specification=specification.to_json(),
            seed=specification.seed,
            last_events=last_events,
            goals_flown=len(goals),
            metrics=metrics,
            parents=parents,
        ),
    )


def _working_folder(specification: Specification, folder: Path) -> Path:
    made_of = json.dumps([specification.to_json(), specification.scenario.to_json(), source_hash()])
    return folder.with_name(f".{folder.name}.{hashlib.sha256(made_of.encode()).hexdigest()[:16]}.build")


def _is_done(shard: _Shard) -> bool:
    try:
        open_dataset(shard.folder).read()
    except (FileNotFoundError, CorruptDataset):
        return False
    return True


def _fly_shard(shard: _Shard) -> _Shard:
    """Fly a shard and keep its flights."""
    specification = shard.specification
    flown = fly_law(
        specification.scenario,
        shard.flights.goals,
        shard.flights.figures,
        seeds=specification.seed,
        source=shard.flights.source,
        threads=shard.threads,
    )
    description = Description(
        name=specification.name,
        specification=specification.to_json(),
        seed=specification.seed,
        last_events=_count_events(specification.scenario.task, flown.last_events),
        goals_flown=len(shard.flights.goals),
        metrics={},
        parents={},
    )
    write_dataset(shard.folder, flown.episodes, description)
    return shard


def _count_events(task: Task, last_events: NDArray[np.int64]) -> dict[str, int]:
    """How many flights ended with which event; of several the one that counts."""
    return dict(Counter(termination(task, events) or "none" for events in last_events.tolist()))


def _fly_all(shards: Iterable[_Shard], engine: Engine) -> Iterator[_Shard]:
    """Fly shards in any order; yields each that is done."""
    if engine == "local":
        yield from map(_fly_shard, shards)
        return
    try:
        import ray
    except ImportError as error:
        raise ImportError("the engine 'ray' takes Ray, which is missing: pip install vvc-bench[ray]") from error
    fly = ray.remote(_fly_shard)
    waiting = [fly.remote(shard) for shard in shards]
    while waiting:
        ready, waiting = ray.wait(waiting)
        yield from ray.get(ready)
