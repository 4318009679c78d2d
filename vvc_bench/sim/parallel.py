"""Spread rows over a few threads, never slower than one thread would be.

Kernels release the GIL, so ordinary threads run them side by side. The caller works too and takes chunks from the same
counter, so a helper that is late, because its core is busy, costs nothing: it finds no chunk left. A barrier over equal
shares, as in Numba's ``prange``, would wait for the slowest.
"""

import functools
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

CHUNKS_PER_THREAD = 8


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
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """One pool for each process (a fork inherits no threads) and size."""
    return ThreadPoolExecutor(threads, thread_name_prefix=f"vvc-bench-{process}")


def for_each_chunk(work: Callable[[int, int], None], count: int, threads: int, smallest_share: int) -> None:
    """Call ``work(start, stop)`` for ranges that together cover 0 ≤ i < count once, on up to ``threads`` threads.

    A thread is only worth waking for ``smallest_share`` rows; with fewer than two such shares the caller does it all.
    """
    threads = min(threads, count // smallest_share)
    if threads < 2:
        work(0, count)
        return
    size = -(-count // (threads * CHUNKS_PER_THREAD))
    starts = itertools.count(0, size)  # taking the next one is atomic

    def drain() -> None:
        for start in starts:
            if start >= count:
                return
            work(start, min(start + size, count))

    helpers = [_pool(os.getpid(), threads - 1).submit(drain) for _ in range(threads - 1)]
    drain()
    for helper in helpers:
        if not helper.cancel():
            helper.result()
