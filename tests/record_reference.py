"""Record what the reference binaries do, for tests that run where they do not.

    python tests/record_reference.py

rewrites ``tests/data/reference_recordings.npz`` from `flycraft` (``pip install vvc-bench[reference]``). The tests call
the same functions with more seeds for their live comparison.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from reference_binary import REPORTED, ReferenceAircraft, ReferenceControlLaw, scratch_folder

RECORDINGS = Path(__file__).parent / "data" / "reference_recordings.npz"

Recording = dict[str, NDArray[np.float64]]

ENVELOPE = {
    "airspeed_mps": (60.0, 400.0),
    "angle_of_attack_deg": (-30.0, 95.0),
    "sideslip_deg": (-40.0, 40.0),
    "roll_rate_degps": (-200.0, 200.0),
    "pitch_rate_degps": (-200.0, 200.0),
    "yaw_rate_degps": (-200.0, 200.0),
    "roll_deg": (-180.0, 180.0),
    "pitch_deg": (-89.0, 89.0),
    "yaw_deg": (-180.0, 180.0),
    "altitude_m": (0.0, 15000.0),
    "aileron_deg": (-30.0, 30.0),
    "elevator_deg": (-30.0, 30.0),
    "rudder_deg": (-30.0, 30.0),
    "throttle": (0.0, 1.0),
}
"""Where single steps are compared."""

LAW_INPUT = {
    "altitude_m": (0.0, 17000.0),
    "airspeed_mps": (60.0, 400.0),
    "angle_of_attack_deg": (-10.0, 35.0),
    "sideslip_deg": (-1.0, 1.0),
    "roll_rate_degps": (-200.0, 200.0),
    "pitch_rate_degps": (-50.0, 50.0),
    "yaw_rate_degps": (-30.0, 30.0),
    "load_factor_g": (-5.0, 10.0),
}
"""Where the control law is compared."""

_LAW_NAMES = ("h", "v", "alpha", "beta", "p", "q", "r", "nz")


def _draw(rng: np.random.Generator, ranges: dict[str, tuple[float, float]], shape: tuple[int, ...]) -> NDArray:
    low, high = np.array(list(ranges.values())).T
    return rng.uniform(low, high, (*shape, len(ranges)))


def record_single_steps(count: int) -> Recording:
    """One 0.1 s step from each of ``count`` random states, as (count, quantity) arrays."""
    states = _draw(np.random.default_rng(1), ENVELOPE, (count,))
    aircraft = ReferenceAircraft(10.0)
    reports = []
    for state in states:
        aircraft.put(dict(zip(ENVELOPE, state, strict=True)))
        aircraft.step(*state[-4:])
        reports.append(list(aircraft.report().values()))
    return {"states": states, "reports": np.array(reports)}


def record_control_law(sequences: int, steps: int = 60) -> Recording:
    """Random inputs to the law in sequences, so that its integrators count; a third each at 10, 20 and 100 Hz."""
    rng = np.random.default_rng(2)
    frequencies = np.resize([10.0, 20.0, 100.0], sequences)
    inputs = _draw(rng, LAW_INPUT, (sequences, steps))
    commands = _draw(rng, {"p": (-180.0, 180.0), "nz": (-5.0, 10.0), "pla": (0.0, 1.0)}, (sequences, steps))
    outputs = np.empty((sequences, steps, 4))
    for i, frequency in enumerate(frequencies):
        law = ReferenceControlLaw(frequency)
        for k in range(steps):
            state = dict(zip(_LAW_NAMES, inputs[i, k], strict=True)) | {"phi": 0.0, "theta": 0.0}
            outputs[i, k] = law.step(commands[i, k], state)
    return {"frequencies": frequencies, "inputs": inputs, "commands": commands, "outputs": outputs}


def record_open_loop(seeds: int, steps: int = 150) -> Recording:
    """Violent flight from trim: deflections and throttle on a random walk."""
    commands = np.empty((seeds, steps, 4))
    reports = np.empty((seeds, steps, len(REPORTED)))
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        aircraft = ReferenceAircraft(10.0)
        deflection = np.array([0.0, -1.3, 0.0, 0.3])
        for k in range(steps):
            deflection += rng.normal(size=4) * [0.6, 0.5, 0.6, 0.05]
            deflection = np.clip(deflection, [-21.5, -25.0, -30.0, 0.0], [21.5, 25.0, 30.0, 1.0])
            commands[seed, k] = deflection
            aircraft.step(*deflection)
            reports[seed, k] = list(aircraft.report().values())
    return {"commands": commands, "reports": reports}


REPORT_EVERY = 10
"""Steps between the closed loop's reports, to keep the file small."""


def record_closed_loop(seeds: int, steps: int = 400) -> Recording:
    """Moderate flight from trim through the control law: rolls in and out, 0.8 to 1.2 g, about 200 m/s.

    Where the aircraft flies much faster the 10 Hz loop is chaotic, and rounding decides (docs/accurate-dynamics.md).
    """
    commands = np.empty((seeds, steps, 3))
    reports = np.empty((seeds, steps, len(REPORTED)))
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        aircraft, law = ReferenceAircraft(10.0), ReferenceControlLaw(10.0)
        for k in range(steps):
            if k % 40 == 0:
                roll_rate = rng.uniform(-10.0, 10.0)
            if k % 20 == 0:
                load_factor, throttle = rng.uniform(0.8, 1.2), rng.uniform(0.1, 0.25)
            commands[seed, k] = roll_rate if k % 40 < 20 else -roll_rate, load_factor, throttle
            aircraft.step(*law.step(commands[seed, k], aircraft.state))
            reports[seed, k] = list(aircraft.report().values())
    return {"commands": commands, "reports": reports[:, REPORT_EVERY - 1 :: REPORT_EVERY]}


def main() -> None:
    with scratch_folder():
        recordings = {
            "single_steps": record_single_steps(500),
            "control_law": record_control_law(12),
            "open_loop": record_open_loop(5),
            "closed_loop": record_closed_loop(20),
        }
    flat = {f"{name}/{key}": array for name, arrays in recordings.items() for key, array in arrays.items()}
    RECORDINGS.parent.mkdir(exist_ok=True)
    np.savez_compressed(RECORDINGS, **flat)
    print(f"{RECORDINGS}: {RECORDINGS.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
