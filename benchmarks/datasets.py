"""How large datasets are and how fast they are written and read, beside others, in one run on one machine.

    python benchmarks/datasets.py [--quick]

The flights are those of ``pid-v0``, 3 million transitions (with ``--quick`` a twentieth of the goals). Beside them the
same table as pyarrow writes it by default, and the same observations, actions and rewards as a Minari dataset (HDF5,
extra ``minari``), if that is installed. Medians of repeats taken in turn; files lie in the page cache.
"""

import argparse
import functools
import importlib.util
import os
import statistics
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vvc_bench.datasets.catalogue import FlownByLaw, named_specification
from vvc_bench.datasets.schema import transition_values
from vvc_bench.datasets.store import Description, open_dataset, write_dataset
from vvc_bench.rollout import Episodes, fly_law

BATCH = 256
BATCHES = 100
TRAJECTORIES = 20

Task = Callable[[], object]


class Store(NamedTuple):
    """One way to keep flights, as tasks to be timed; None for what it does not do."""

    write: Task
    size: Callable[[], int]
    opened: Task
    to_numpy: Task
    trajectories: Callable[[list[int]], object]
    batches: Task | None


def folder_size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def ours(folder: Path, episodes: Episodes) -> Store:
    dataset = functools.cache(lambda: open_dataset(folder))
    mapped = functools.cache(lambda: dataset().memory_mapped())
    generator = np.random.default_rng(0)
    return Store(
        lambda: write_dataset(folder, episodes, Description("benchmark-v0")),
        lambda: folder_size(folder),
        lambda: open_dataset(folder),
        lambda: open_dataset(folder).columns(),
        lambda which: [dataset()[e] for e in which],
        lambda: [mapped().sample(generator, BATCH) for _ in range(BATCHES)],
    )


def plain_parquet(folder: Path, episodes: Episodes) -> Store:
    path = folder / "table.parquet"
    folder.mkdir()

    def to_numpy() -> object:
        table = pq.read_table(path)
        return [table[name].to_numpy() for name in table.column_names]

    return Store(
        lambda: pq.write_table(pa.table(transition_values(episodes)), path),
        lambda: folder_size(folder),
        lambda: pq.ParquetFile(path),
        to_numpy,
        lambda which: [pq.read_table(path, filters=[("episode", "==", e)]) for e in which],
        None,
    )


def minari_set(folder: Path, episodes: Episodes) -> Store:
    os.environ["MINARI_DATASETS_PATH"] = str(folder)
    folder.mkdir()
    import minari

    from vvc_bench.datasets.convert.minari import to_minari

    def write() -> None:
        minari.delete_dataset("benchmark-v0") if (folder / "benchmark-v0").exists() else None
        with warnings.catch_warnings(action="ignore"):
            to_minari(episodes, "benchmark-v0")

    def to_numpy() -> object:
        parts = [
            (*(values[:-1] for values in record.observations.values()), record.actions, record.rewards)
            for record in minari.load_dataset("benchmark-v0").iterate_episodes()
        ]
        return [np.concatenate(columns) for columns in zip(*parts, strict=True)]

    dataset = functools.cache(lambda: minari.load_dataset("benchmark-v0"))
    return Store(
        write,
        lambda: folder_size(folder),
        lambda: minari.load_dataset("benchmark-v0"),
        to_numpy,
        lambda which: [dataset()[e] for e in which],
        None,
    )


def seconds(task: Task) -> float:
    begin = time.perf_counter()
    task()
    return time.perf_counter() - begin


def rows(stores: dict[str, Store], episodes: int, repeats: int) -> Iterator[tuple[str, list[str]]]:
    """A line of the table for each measure: what it is, and a cell for each store."""
    written = [seconds(store.write) for store in stores.values()]
    yield "size, MB", [f"{store.size() / 1e6:,.0f}" for store in stores.values()]
    yield "written in, s (once)", [f"{taken:,.1f}" for taken in written]
    generator = np.random.default_rng(0)

    def in_turn(task_of: Callable[[Store], Task | None], scale: float, form: str) -> list[str]:
        taken: dict[str, list[float]] = {name: [] for name in stores}
        for repeat in range(repeats + 1):
            for name, store in stores.items():
                task = task_of(store)
                if task is not None and repeat == 0:
                    task()
                elif task is not None:
                    taken[name].append(seconds(task) * scale)
        return [format(statistics.median(times), form) if times else "—" for times in taken.values()]

    def trajectories(store: Store) -> Task:
        return functools.partial(store.trajectories, generator.integers(episodes, size=TRAJECTORIES).tolist())

    yield "opened in, ms", in_turn(lambda store: store.opened, 1e3, ",.1f")
    yield "everything to NumPy, s", in_turn(lambda store: store.to_numpy, 1.0, ",.2f")
    yield "one trajectory at random, ms", in_turn(trajectories, 1e3 / TRAJECTORIES, ",.2f")
    yield f"a random batch of {BATCH}, ms", in_turn(lambda store: store.batches, 1e3 / BATCHES, ",.2f")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer goals and repeats")
    quick = parser.parse_args().quick
    specification = named_specification("pid-v0")
    assert isinstance(specification.recipe, FlownByLaw)
    goals = specification.recipe.grid.goals[:: 20 if quick else 1]
    episodes = fly_law(specification.scenario, goals, specification.recipe.parameters).episodes
    with tempfile.TemporaryDirectory() as place:
        os.environ["VVC_BENCH_HOME"] = place
        stores = {
            "vvc-bench": ours(Path(place, "ours"), episodes),
            "pyarrow's defaults": plain_parquet(Path(place, "plain"), episodes),
        }
        if importlib.util.find_spec("minari"):
            stores["Minari (HDF5)"] = minari_set(Path(place, "minari"), episodes)
        else:
            print("Minari is not installed and left out: pip install vvc-bench[minari]\n")
        print(f"{len(episodes):,} trajectories, {len(episodes.rewards):,} transitions; median of {3 if quick else 9}\n")
        print("| | " + " | ".join(stores) + " |")
        print("|---|" + "---:|" * len(stores))
        for name, cells in rows(stores, len(episodes), 3 if quick else 9):
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
