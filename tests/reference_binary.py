"""The closed reference: flycraft's own binaries, driven directly. An oracle for tests and an opponent for benchmarks.

`flycraft` (PyPI, Linux and Windows on x86-64) is the optional extra ``reference``. It appends to ``f16trace.csv``
in the working directory at every step, so everything here must run inside `scratch_folder`.
"""

import contextlib
import ctypes
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

REPORTED = {
    "npos": "north_m",
    "epos": "east_m",
    "h": "altitude_m",
    "alpha": "angle_of_attack_deg",
    "beta": "sideslip_deg",
    "phi": "roll_deg",
    "theta": "pitch_deg",
    "psi": "yaw_deg",
    "p": "roll_rate_degps",
    "q": "pitch_rate_degps",
    "r": "yaw_rate_degps",
    "v": "airspeed_mps",
    "vn": "velocity_north_mps",
    "ve": "velocity_east_mps",
    "vh": "velocity_up_mps",
    "nx": "load_factor_x_g",
    "ny": "load_factor_y_g",
    "nz": "load_factor_g",
    "mu": "path_angle_deg",
    "chi": "azimuth_deg",
}
"""flycraft's names and ours, of every quantity that its aircraft reports."""

_LOAD_ORDER = (
    *("airspeed_mps", "angle_of_attack_deg", "sideslip_deg", "roll_rate_degps", "pitch_rate_degps", "yaw_rate_degps"),
    *("roll_deg", "pitch_deg", "yaw_deg", "altitude_m", "north_m", "east_m"),
)


@contextlib.contextmanager
def scratch_folder() -> Iterator[None]:
    """A temporary working directory for what flycraft writes."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


class ReferenceAircraft:
    """flycraft's aircraft model: starts in trim, or is put into any state."""

    def __init__(self, frequency_hz: float, altitude_m: float = 5000.0, speed_mps: float = 200.0) -> None:
        from flycraft.planes.utils.f16Classes import PlaneModel

        self._model = PlaneModel(altitude_m, speed_mps, stepTime=1.0 / frequency_hz)

    def put(self, state: dict[str, float]) -> None:
        """Overwrite the state, by our column names."""
        values = [state.get(name, 0.0) for name in _LOAD_ORDER]
        surfaces = [state.get(name, 0.0) for name in ("aileron_deg", "elevator_deg", "rudder_deg", "throttle")]
        self._model.f16Model.loadPlaneInfo(
            self._model.planePtr, (ctypes.c_double * 14)(*values, 0.0, 0.0), (ctypes.c_double * 4)(*surfaces)
        )
        self._model.f16Model.getStates(self._model.planePtr, self._model.output)

    def step(self, aileron: float, elevator: float, rudder: float, throttle: float) -> None:
        """One step under deflections in degrees."""
        self._model.step({"ail": aileron, "ele": elevator, "rud": rudder, "pla": throttle})

    def report(self) -> dict[str, float]:
        """Every reported quantity, by our column names."""
        state = self._model.getPlaneState()
        return {ours: state[theirs] for theirs, ours in REPORTED.items()}

    @property
    def state(self) -> dict[str, float]:
        """The report under flycraft's own names, as its control law wants it."""
        return dict(self._model.getPlaneState())


class ReferenceControlLaw:
    """flycraft's control law with its integrators."""

    def __init__(self, frequency_hz: float) -> None:
        from flycraft.planes.utils.f16Classes import ControlLaw

        self._law = ControlLaw(stepTime=1.0 / frequency_hz)

    def step(self, command: np.ndarray, state: dict[str, float]) -> tuple[float, float, float, float]:
        """Aileron, elevator, rudder in degrees and throttle, for roll rate in deg/s, load factor in g and throttle."""
        self._law.step({"p": command[0], "nz": command[1], "rud": 0.0, "pla": command[2]}, state)
        output = self._law.getOutputDict()
        return output["ail"], output["ele"], output["rud"], output["pla"]
