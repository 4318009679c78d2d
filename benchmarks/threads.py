"""From how many aircraft on a second thread pays: the measurement behind ``SMALLEST_SHARE``.

    python benchmarks/threads.py

For each batch size, steps per second on one thread and on two with shares allowed to be as small as they like, on a
quiet machine and with the second core loaded; median of repeats taken in turn.
"""

from simulator import busy_core, many, measure

from vvc_bench import sim
from vvc_bench.sim import stepping

SIZES = (64, 128, 256, 512, 1024, 2048, 4096, 16384)
STEPS_PER_CASE = 40_000


def main() -> None:
    stepping.SMALLEST_SHARE = 1
    cases = {
        f"{count} {threads}": many(threads, sim.Settings(), max(1, STEPS_PER_CASE // count), count)
        for count in SIZES
        for threads in (1, 2)
    }
    quiet = measure(cases, 15)
    with busy_core():
        loaded = measure(cases, 15)
    print("| aircraft | 1 thread, M steps/s | 2 threads | 1 thread, second core loaded | 2 threads |")
    print("|---:|---:|---:|---:|---:|")
    for count in SIZES:
        rates = [rates[f"{count} {threads}"] / 1e6 for rates in (quiet, loaded) for threads in (1, 2)]
        print(f"| {count} | " + " | ".join(f"{rate:.2f}" for rate in rates) + " |")


if __name__ == "__main__":
    main()
