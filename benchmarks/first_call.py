"""How long a new process waits for its first step: cold, and with the machine code in the cache.

python benchmarks/first_call.py
"""

import os
import statistics
import subprocess
import sys
import tempfile

FIRST_STEP = """
import time
begin = time.perf_counter()
from vvc_bench import sim
imported = time.perf_counter()
settings = sim.Settings()
state = sim.start_from(settings, airspeed_mps=200, altitude_m=5000, angle_of_attack_deg=2.6, pitch_deg=2.6)
started = time.perf_counter()
sim.step(state, [0.0, 1.0, 0.2], settings)
stepped = time.perf_counter()
sim.start(settings)
print(imported - begin, started - imported, stepped - started, time.perf_counter() - stepped)
"""


def seconds(home: str) -> list[float]:
    """Import, full-state start, first step and first trim of one new process, in s."""
    run = subprocess.run(
        [sys.executable, "-c", FIRST_STEP],
        env=os.environ | {"VVC_BENCH_HOME": home},
        capture_output=True,
        text=True,
        check=True,
    )
    return [float(value) for value in run.stdout.split()]


def main() -> None:
    cold, warm = [], []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as home:
            cold.append(seconds(home))
            warm += [seconds(home) for _ in range(3)]
    print("| seconds, median | import | full-state start | first step | first trimmed start |")
    print("|---|---:|---:|---:|---:|")
    for name, runs in (("cold", cold), ("from the cache", warm)):
        medians = [statistics.median(column) for column in zip(*runs, strict=True)]
        print(f"| {name} | " + " | ".join(f"{median:.2f}" for median in medians) + " |")


if __name__ == "__main__":
    main()
