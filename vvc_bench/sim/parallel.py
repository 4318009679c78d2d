"""Spread rows over a few threads, never slower than one thread would be.

Kernels release the GIL, so ordinary threads run them side by side. The caller works too and takes chunks from the same
heap, so a helper that is late, because its core is busy, costs nothing: it finds no chunk left. A barrier over equal
shares, as in Numba's ``prange``, would wait for the slowest.
"""

import functools
import itertools
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

LAST_CHUNKS_PER_SHARE = 8
"""How finely the end of the work is cut: nobody then waits long for a thread that has lost its core."""
PROBE_ONE_EVERY = 64
PROBE_SEVERAL_EVERY = 16
"""Calls between two that are made the slower way, with one thread or with several, to see whether it still is."""
_WEIGHT = 0.3
"""Of the last call in what is remembered of the better way's speed; of the other way the last call is remembered."""
_OUTLIER = 1.5
"""A call with several threads counts as at most this many times one alone: a thread may lose its core for once."""


@functools.cache
def available_threads() -> int:
    """Cores that this process may use, or the environment variable ``VVC_BENCH_THREADS``.

    Raises:
        ValueError: if the variable is not a whole number of at least 1.
    """
    wanted = os.environ.get("VVC_BENCH_THREADS")
    if wanted is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    if not wanted.isdecimal() or int(wanted) < 1:
        raise ValueError(f"VVC_BENCH_THREADS must be a whole number of at least 1, got {wanted!r}")
    return int(wanted)


@functools.cache
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    """Threads of one process (a fork inherits none), each on a core of its own.

    Left to the scheduler, a thread that works for less than a millisecond at a time may share its waker's core for
    long although another one is idle: measured here, half of all calls then took as long as with one thread.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []
    places = itertools.cycle(cores[1:] + cores[:1])

    def settle() -> None:
        if len(cores) > 1:
            os.sched_setaffinity(0, {next(places)})  # of this thread alone

    return ThreadPoolExecutor(count, thread_name_prefix=f"vvc-bench-{process}", initializer=settle)


class _Pace:
    """How long calls of one kind take with one thread and with several, and which way is now the better one.

    Several threads lose where other processes keep the cores busy, the caller's own among them.
    """

    def __init__(self) -> None:
        self._calls = 0
        self._seconds = {True: 0.0, False: 0.0}

    def choose(self) -> bool:
        """Whether to use several threads this time."""
        self._calls += 1
        return self._better != (self._calls % (PROBE_ONE_EVERY if self._better else PROBE_SEVERAL_EVERY) == 0)

    def note(self, several: bool, seconds: float) -> None:
        """Remember how long a call took, unless it was the first, which starts the threads."""
        if self._calls == 1:
            return
        known, alone = self._seconds[several], self._seconds[False]
        if several and alone > 0.0:
            seconds = min(seconds, _OUTLIER * alone)
        weight = _WEIGHT if known > 0.0 and several == self._better else 1.0
        self._seconds[several] += weight * (seconds - known)

    @property
    def _better(self) -> bool:
        return self._seconds[True] <= self._seconds[False]


@functools.lru_cache(maxsize=256)
def _pace(threads: int, smallest_share: int, magnitude: int) -> _Pace:
    """One for calls that cost about the same."""
    del threads, smallest_share, magnitude
    return _Pace()


def for_each_chunk(work: Callable[[int, int], object], count: int, threads: int, smallest_share: int) -> None:
    """Call ``work(start, stop)`` for ranges that together cover 0 ≤ i < count once, on up to ``threads`` threads.

    A thread is only worth waking for ``smallest_share`` rows; with fewer than two such shares the caller does it all,
    and so it does while that is seen to be quicker.
    """
    threads = min(threads, count // smallest_share)
    if threads < 2:
        work(0, count)
        return
    pace = _pace(threads, smallest_share, count.bit_length())
    several = pace.choose()
    begin = time.perf_counter()
    if several:
        _share_out(work, count, threads, max(1, smallest_share // LAST_CHUNKS_PER_SHARE))
    else:
        work(0, count)
    pace.note(several, time.perf_counter() - begin)


def _share_out(work: Callable[[int, int], object], count: int, threads: int, smallest_chunk: int) -> None:
    claim = _claims(count, threads, smallest_chunk)

    def drain() -> None:
        while (chunk := claim()) is not None:
            work(*chunk)

    helpers = [_pool(os.getpid(), threads - 1).submit(drain) for _ in range(threads - 1)]
    drain()
    for helper in helpers:
        if not helper.cancel():
            helper.result()


def _claims(count: int, threads: int, smallest_chunk: int) -> Callable[[], tuple[int, int] | None]:
    """A function that hands out the next chunk, to one thread at a time: large ones first, so that all end together."""
    lock = threading.Lock()
    begun = 0

    def claim() -> tuple[int, int] | None:
        nonlocal begun
        with lock:
            start = begun
            stop = begun = min(count, start + max(smallest_chunk, (count - start) // (2 * threads)))
        return (start, stop) if start < stop else None  # `begun` may be another thread's by now

    return claim
