"""Evaluate a policy on a protocol, and keep the result as files."""

import json
import platform
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.folders import replaced_folder
from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.flights import CHUNK, Chunk, begun_fleet, chunks, fly_chunk, measured, seen
from vvc_bench.evaluation.protocols import Protocol
from vvc_bench.evaluation.summary import summarise
from vvc_bench.metrics import BestLengths
from vvc_bench.metrics.documents import plain
from vvc_bench.policies import Agent
from vvc_bench.sim.parallel import available_threads

EPISODES, SUMMARY, TIMING = "episodes.parquet", "summary.json", "timing.json"
"""Files of an evaluation. The first two are the same, byte for byte, wherever the same flights are flown."""

_LATENCY_CALLS, _LATENCY_WARM_UP = 300, 30

Rows = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Evaluation:
    """What came of a policy on a protocol.

    Args:
        episodes: one row for each seed and goal, in that order; columns as in `vvc_bench.evaluation.columns`.
        summary: plain values that only depend on the flights.
        timing: how long it took here; empty if that was not kept.
    """

    episodes: pd.DataFrame
    summary: dict[str, Any]
    timing: dict[str, Any]

    def write(self, folder: Path | str) -> Path:
        """Write ``episodes.parquet``, ``summary.json`` and ``timing.json``, or replace those of an older evaluation.

        Raises:
            FileExistsError: if the folder holds anything else; it is left as it is.
            OSError: if the folder cannot be written.
        """
        place = Path(folder)
        others = sorted(path.name for path in place.iterdir() if path.name not in _FILES) if place.is_dir() else []
        if others:
            raise FileExistsError(
                f"{place} holds other things ({others[0]}); it is left as it is: choose another place"
            )
        with replaced_folder(place, SUMMARY) as unfinished:
            _write_episodes(self.episodes, unfinished / EPISODES)
            (unfinished / SUMMARY).write_text(_text(self.summary), encoding="utf-8")
            (unfinished / TIMING).write_text(_text(self.timing), encoding="utf-8")
        return place


_FILES = {EPISODES, SUMMARY, TIMING}


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=2, sort_keys=True, allow_nan=False) + "\n"


def _write_episodes(episodes: pd.DataFrame, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.Table.from_pandas(episodes, preserve_index=False).replace_schema_metadata(None), path)


def read_evaluation(folder: Path | str) -> Evaluation:
    """The evaluation that a folder holds; its timing may be missing.

    Raises:
        FileNotFoundError: if there is none.
        ValueError: for files that are none of an evaluation, or do not belong together.
    """
    place = Path(folder)
    for name in (EPISODES, SUMMARY):
        if not (place / name).is_file():
            raise FileNotFoundError(f"{place} holds no evaluation: it has no {name}; `vvc-bench evaluate` makes one")
    summary = _read_json(place / SUMMARY)
    episodes = read_episodes(place / EPISODES)
    missing = [key for key in ("protocol", "policy", "seeds", "success") if key not in summary]
    if missing:
        raise ValueError(f"{place / SUMMARY} is no summary of an evaluation: it has no {missing[0]!r}")
    counted = summary["success"]["episodes"] if isinstance(summary["success"], dict) else None
    if counted != len(episodes):
        raise ValueError(f"{place}: the summary is of {counted} episodes, and there are {len(episodes)}")
    timing = _read_json(place / TIMING) if (place / TIMING).is_file() else {}
    return Evaluation(episodes, summary, timing)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is no JSON document: {error}") from error
    if not isinstance(document, dict):
        raise ValueError(f"{path} is no JSON object")
    return document


def read_episodes(path: Path) -> pd.DataFrame:
    """The table of flights in a file of an evaluation.

    Raises:
        ValueError: for another kind of file, or one that lacks a column which every evaluation has.
    """
    try:
        episodes = pd.read_parquet(path)
    except (ValueError, OSError) as error:
        raise ValueError(f"{path} is no Parquet file: {error}") from error
    missing = [name for name in names.ALWAYS if name not in episodes]
    if missing:
        raise ValueError(f"{path} has no column {missing[0]!r}; `vvc-bench evaluate` makes such tables")
    return episodes


def evaluate(
    agent: Agent,
    protocol: Protocol,
    *,
    seeds: Sequence[int] = (0,),
    threads: int | None = None,
    batch_size: int | None = None,
    training_set: Dataset | None = None,
    best: BestLengths | None = None,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> Evaluation:
    """Fly a policy to every goal of a protocol, once for each seed.

    Args:
        agent: the policy.
        protocol: goals, rules and conditions.
        seeds: each stands for one seed of gusts, sensor noise and what the policy draws, for each goal.
        threads: at most so many; by default all cores. The flights do not depend on them.
        batch_size: at most so many aircraft in the air at once, in chunks of `CHUNK`, one for each thread at most; at
            least one chunk. The flights do not depend on it.
        training_set: what the policy learned from, to tell goals that it has seen from others.
        best: the shortest known flights, to compare lengths with.
        progress: told how many flights are done, and of how many.

    Raises:
        ValueError: for seeds that are negative, given twice or none, less than one thread or aircraft, or a policy that
            answers with actions of another shape or NaN; names the goal and the step.
    """
    every_seed = _checked_seeds(seeds)
    workers = _workers(threads, batch_size)
    begun = time.perf_counter()
    for scenario in protocol.scenarios:
        _ = scenario.start  # once, before threads ask for it
    work = [chunk for seed in every_seed for chunk in chunks(protocol, seed)]
    rows = _fly_all(agent, work, workers, best, progress)
    episodes = _table(rows, protocol)
    if training_set is not None:
        known = training_set.is_seen(protocol.goals)
        episodes[names.SEEN] = known[episodes[names.GOAL].to_numpy()]
    took = time.perf_counter() - begun
    timing = {
        "wall_s": took,
        "episodes_per_s": len(episodes) / took,
        "steps_per_s": int(episodes[names.LENGTH].sum()) / took,
        "threads": workers,
        "chunk": CHUNK,
        "machine": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "latency": measure_latency(agent, protocol),
    }
    trained = None if training_set is None else {"name": training_set.name, "hash": training_set.hash}
    return Evaluation(episodes, summarise(episodes, protocol, agent.describe(), every_seed, trained), plain(timing))


def _checked_seeds(seeds: Sequence[int]) -> list[int]:
    given = [int(seed) for seed in seeds]
    if not given or len(set(given)) < len(given) or min(given) < 0:
        raise ValueError(f"seeds must be one or more different whole numbers from 0, got {list(seeds)}")
    return given


def _workers(threads: int | None, batch_size: int | None) -> int:
    wanted = available_threads() if threads is None else threads
    if wanted < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if batch_size is not None and batch_size < 1:
        raise ValueError(f"batch_size must be at least 1, got {batch_size}")
    return wanted if batch_size is None else min(wanted, max(1, batch_size // CHUNK))


def _fly_all(
    agent: Agent,
    work: Sequence[Chunk],
    workers: int,
    best: BestLengths | None,
    progress: Callable[[int, int], object],
) -> list[Rows]:
    """Rows of each chunk, in the order of the chunks; what a chunk's flights were is dropped when they are measured."""
    total, done = sum(len(chunk.goals) for chunk in work), 0
    progress(done, total)

    def fly(chunk: Chunk) -> Rows:
        return measured(fly_chunk(agent, chunk), chunk, best)

    pool = ThreadPoolExecutor(workers, thread_name_prefix="vvc-bench-evaluate")
    try:
        futures: list[Future[Rows]] = [pool.submit(fly, chunk) for chunk in work]
        left = set(futures)
        while left:
            finished, left = wait(left, return_when=FIRST_COMPLETED)
            done += sum(len(future.result()[names.GOAL]) for future in finished)
            progress(done, total)
    finally:
        pool.shutdown(cancel_futures=True)
    return [future.result() for future in futures]


def _table(rows: Sequence[Rows], protocol: Protocol) -> pd.DataFrame:
    """One table, ordered by seed as given and by the protocol's order."""
    known = names.episode_columns(protocol.scenario.settings)
    table = pd.DataFrame({name: np.concatenate([part[name] for part in rows]) for name in known})
    table = table.astype({name: column.dtype for name, column in known.items()})
    seed_order = pd.Categorical(table[names.SEED], table[names.SEED].unique()).codes
    order = np.lexsort((table[names.GOAL].to_numpy(), seed_order))
    return table.iloc[order].reset_index(drop=True)


def measure_latency(agent: Agent, protocol: Protocol, calls: int = _LATENCY_CALLS) -> dict[str, float]:
    """How long a policy takes to answer for one aircraft, as when it flies one.

    Returns:
        ``median_s`` and ``p99_s`` of so many ``calls``, and ``budget_s``, the time between two commands (0.1 s in
        the paper's Appendix N).
    """
    chunk = next(chunks(protocol, 0))
    fleet = begun_fleet(chunk, chunk.goals[:1])
    policy = agent.begin(protocol.seeds[:1])
    taken = np.empty(calls)
    for call in range(-_LATENCY_WARM_UP, calls):
        observed = seen(fleet)
        begun = time.perf_counter()
        policy(observed)
        taken[max(call, 0)] = time.perf_counter() - begun
    median, late = np.quantile(taken, (0.5, 0.99)).tolist()
    return {"median_s": median, "p99_s": late, "budget_s": protocol.scenario.settings.time_step, "calls": calls}
