"""Every row once, whatever the threads do."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from vvc_bench.sim.parallel import _claims, available_threads, for_each_chunk


@pytest.mark.parametrize("count", [0, 1, 255, 256, 511, 512, 513, 10_000])
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_row_is_worked_on_once(count: int, threads: int) -> None:
    visits = np.zeros(count, dtype=int)

    def work(start: int, stop: int) -> None:
        visits[start:stop] += 1

    for_each_chunk(work, count, threads, smallest_share=256)
    assert (visits == 1).all()


def test_no_row_is_claimed_twice_when_threads_are_interrupted_anywhere() -> None:
    """Chunks overlapped once in millions, where a thread lost its turn just after it had claimed one."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(5):
            claim, taken = _claims(20_000, 5000, 1), []
            threads = [threading.Thread(target=lambda: taken.extend(iter(claim, None))) for _ in range(4)]  # noqa: B023
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            bounds = sorted(taken)
            assert [start for start, _ in bounds] == [0, *(stop for _, stop in bounds[:-1])]
            assert bounds[-1][1] == 20_000
    finally:
        sys.setswitchinterval(interval)


def test_small_batches_stay_on_the_calling_thread() -> None:
    names = []
    for_each_chunk(lambda _start, _stop: names.append(threading.current_thread().name), 511, 8, smallest_share=256)
    assert names == [threading.current_thread().name]


def test_a_late_helper_is_not_waited_for() -> None:
    """The caller takes every chunk that no helper has begun."""
    release = threading.Event()
    caller = threading.current_thread()
    done = []

    def work(start: int, stop: int) -> None:
        if threading.current_thread() is not caller and start >= 64:
            release.wait(10)
        done.append((start, stop))
        if len(done) == 15:
            release.set()

    begin = time.monotonic()
    for_each_chunk(work, 1024, 2, smallest_share=64)
    assert sum(stop - start for start, stop in done) == 1024
    assert time.monotonic() - begin < 10


def test_an_error_in_a_chunk_reaches_the_caller() -> None:
    def work(start: int, _stop: int) -> None:
        raise RuntimeError(f"chunk {start}")

    with pytest.raises(RuntimeError, match="chunk"):
        for_each_chunk(work, 1000, 2, smallest_share=100)


@pytest.mark.parametrize("value", ["0", "-1", "two", "1.5"])
def test_a_wrong_thread_count_is_refused(value: str) -> None:
    code = "from vvc_bench.sim.parallel import available_threads; available_threads()"
    environment = os.environ | {"VVC_BENCH_THREADS": value}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert f"VVC_BENCH_THREADS must be a whole number of at least 1, got '{value}'" in run.stderr


def test_there_is_a_thread() -> None:
    assert available_threads() >= 1
