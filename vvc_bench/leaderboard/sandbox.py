"""Fly a policy, or read what is claimed, in a process of its own that can do nothing else."""

import contextlib
import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from vvc_bench import jit
from vvc_bench.evaluation import Evaluation, evaluate, named_protocol, read_evaluation
from vvc_bench.evaluation.protocols import Drawn
from vvc_bench.leaderboard import confinement, reading, reflight
from vvc_bench.leaderboard.confinement import Limits
from vvc_bench.leaderboard.reflight import EVALUATION, HELD_OUT, REQUEST
from vvc_bench.leaderboard.submission import CLAIMED, EPISODES, POLICY
from vvc_bench.policies import open_agent
from vvc_bench.policies.built_in import RANDOM

_PACKAGE = Path(__file__).parents[1]
_READING = Limits(wall_s=60.0, processor_s=60, memory_bytes=4 * 10**9)
"""What a table of flights may take to be read; 50,715 flights, in 9 MB, take one to three seconds."""


@dataclass(frozen=True)
class Announced:
    """Goals that nobody knew when a submission was made.

    Args:
        submission_sha256: of ``submission.json``.
        seed: made public after that.
    """

    submission_sha256: str
    seed: int


@dataclass(frozen=True)
class Flown:
    """What a confined process brought home.

    Args:
        evaluation: on the protocol's own goals.
        files: the same as written, ``summary.json`` and ``episodes.parquet``.
        held_out: on goals from an announced seed.
        confined: whether this system could take away its ``network`` and ``files``.
    """

    evaluation: Evaluation
    files: Mapping[str, bytes]
    held_out: Evaluation | None
    confined: dict[str, bool]


def fly(
    protocol: str,
    policy: bytes | str,
    seeds: Sequence[int],
    *,
    announced: Announced | None = None,
    threads: int | None = None,
    limits: Limits = Limits(),  # noqa: B008  (immutable)
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> Flown:
    """Evaluate a policy, confined.

    Args:
        protocol: a name.
        policy: an ONNX model, or the name of a built-in policy.
        seeds: those of the evaluation.
        announced: fly held-out goals too.
        threads: at most so many; by default all cores.
        limits: what the process gets.
        progress: told how many flights are done, and of how many.

    Raises:
        ValueError: if the policy was refused or broke a limit; says why.
        OSError: if no process can be started.
    """
    _compile(protocol)
    with _working_folder() as folder:
        if isinstance(policy, bytes):
            (folder / POLICY).write_bytes(policy)
        request = {
            "protocol": protocol,
            "policy": POLICY if isinstance(policy, bytes) else policy,
            "seeds": list(seeds),
            "threads": threads,
            "held_out": [announced.submission_sha256, announced.seed] if announced else None,
        }
        (folder / REQUEST).write_text(json.dumps(request), encoding="utf-8")
        confined = _run(reflight, "the policy", folder, limits, progress)
        return Flown(
            read_evaluation(folder / EVALUATION),
            {name: (folder / EVALUATION / name).read_bytes() for name in CLAIMED},
            read_evaluation(folder / HELD_OUT) if announced else None,
            confined,
        )


@cache
def try_to_read(episodes: bytes) -> None:
    """Read a table of flights where it can do no harm, once.

    Args:
        episodes: what is in its Parquet file.

    Raises:
        ValueError: if it cannot be read within `_READING`; says why.
        OSError: if no process can be started.
    """
    with tempfile.TemporaryDirectory(prefix="vvc-bench-reading-") as name:
        Path(name, EPISODES).write_bytes(episodes)
        try:
            _run(reading, "reading it", Path(name), _READING, lambda _done, _total: None)
        except ValueError as error:
            raise ValueError(f"the claimed flights cannot be read: {error}") from error


@cache
def _compile(protocol: str) -> None:
    """Fly a goal here first, so that what gets compiled is kept: the confined process cannot keep anything."""
    known = named_protocol(protocol)
    if isinstance(known.drawn, Drawn):
        known = dataclasses.replace(known, drawn=dataclasses.replace(known.drawn, count=1))
        evaluate(open_agent(RANDOM, settings=known.scenario.settings), known, threads=1)


@contextmanager
def _working_folder() -> Iterator[Path]:
    """An empty folder with a copy of the compiled code, which Numba wants to write beside."""
    with tempfile.TemporaryDirectory(prefix="vvc-bench-flight-") as name:
        compiled = jit.cache_folder()
        if compiled.is_dir():
            with contextlib.suppress(shutil.Error):  # another process is writing there; what was missed is compiled
                shutil.copytree(compiled, Path(name, "home", "compiled", compiled.name))
        yield Path(name)


def _run(
    module: ModuleType, what: str, folder: Path, limits: Limits, progress: Callable[[int, int], object]
) -> dict[str, bool]:
    """What the process could be denied, once it is done."""
    command = [sys.executable, "-P", confinement.__file__]
    arguments = [json.dumps(dataclasses.asdict(limits)), module.__name__]
    environment = {
        "HOME": str(folder),
        "LC_ALL": "C.UTF-8",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONNOUSERSITE": "1",
        "PYTHONPATH": str(_PACKAGE.parent),
        "TMPDIR": str(folder),
        "VVC_BENCH_HOME": str(folder / "home"),
    }
    with (folder / "errors.txt").open("wb") as errors:
        process = subprocess.Popen(
            [*command, *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    late = threading.Event()
    clock = threading.Timer(limits.wall_s, _end, (process, late))
    clock.start()
    try:
        said = _listen(process, progress)
        status = process.wait()
    finally:
        clock.cancel()
        _end(process)
    if late.is_set():
        raise ValueError(f"{what} was stopped after {limits.wall_s:g} s, its time limit")
    if "refused" in said:
        raise ValueError(said["refused"])
    if "done" not in said:
        raise ValueError(f"the process of {what} {_ending(status, limits)}{_last_line(folder / 'errors.txt')}")
    return dict(said["confined"])


def _listen(process: subprocess.Popen[str], progress: Callable[[int, int], object]) -> dict[str, Any]:
    """What the process said, but for its progress."""
    said: dict[str, Any] = {}
    assert process.stdout is not None
    with process.stdout as lines:
        for line in lines:
            try:
                heard = json.loads(line)
            except ValueError:
                continue
            if isinstance(heard, dict) and "progress" in heard:
                progress(*heard["progress"])
            elif isinstance(heard, dict):
                said |= heard
    return said


def _end(process: subprocess.Popen[str], late: threading.Event | None = None) -> None:
    """Kill a process that still runs, and all that it started."""
    if process.poll() is None:
        if late is not None:
            late.set()
        with contextlib.suppress(ProcessLookupError):  # it has just ended
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _ending(status: int, limits: Limits) -> str:
    if status == -signal.SIGXCPU or status == -signal.SIGKILL:
        return f"used more than its {limits.processor_s} s of processor time, or was killed"
    if status < 0:
        return f"died of {signal.Signals(-status).name}; it had {limits.memory_bytes / 1e9:g} GB of memory"
    return f"ended with exit code {status}"


def _last_line(path: Path) -> str:
    lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f": {lines[-1][:500]}" if lines else ""
