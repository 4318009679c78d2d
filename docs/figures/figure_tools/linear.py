"""Small motions about level flight: the matrix that takes a deviation through one time step, and its modes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from figure_tools import INDEX, Array, column
from vvc_bench import sim
from vvc_bench.sim import control_law
from vvc_bench.sim.interpolation import bilinear, locate

LATERAL = ("sideslip", "roll_rate", "yaw_rate", "roll")
LONGITUDINAL = ("airspeed", "angle_of_attack", "pitch_rate", "pitch")
ROLL_LOOP = ("sideslip", "roll_rate", "yaw_rate", "roll_rate_integral")
PITCH_LOOP = ("angle_of_attack", "pitch_rate", "load_factor", "load_factor_integral")
_DEVIATION = 1e-6
_CONTROL_LAW_FIELDS = ("load_factor", "load_factor_integral", "roll_rate_integral", "steps")
_HELD = ("airspeed_mps", "angle_of_attack_deg", "altitude_m", "pitch_deg", "elevator_deg", "throttle")


class Mode(NamedTuple):
    """One eigenvalue of the motion."""

    growth: float
    """1/s; negative for a mode that dies out."""
    frequency: float
    """Undamped, rad/s."""
    damping: float
    """Damping ratio."""


def level_flight(settings: sim.Settings, altitude_m: Array, speed_mps: Array) -> Array:
    """Trim in which a step changes nothing: as `start`, with the control law's integrator where it holds the trim."""
    states = sim.start(settings, altitude_m=altitude_m, speed_mps=speed_mps)
    states[:, INDEX["load_factor_integral"]] = (
        _load_factor_gain(altitude_m, speed_mps) * states[:, INDEX["load_factor"]] - states[:, INDEX["elevator"]]
    )
    states[:, INDEX["steps"]] = 1.0  # on its first call the control law leaves its integrators out
    return states


def _load_factor_gain(altitude_m: Array, speed_mps: Array) -> Array:
    gains = []
    for altitude, speed in zip(altitude_m, speed_mps, strict=True):
        h, v = locate(control_law._ALTITUDE, altitude), locate(control_law._SPEED, speed)
        gains.append(bilinear(control_law._LOAD_FACTOR_FEEDBACK, *h, *v))
    return np.array(gains)


def holding_command(settings: sim.Settings, states: Array) -> Array:
    """The command under which level flight stays as it is."""
    names = ["aileron", "elevator", "rudder", "throttle"]
    if settings.control_mode == "guidance":
        names = ["roll_rate", "load_factor", "throttle"]
    return states[:, [INDEX[name] for name in names]]


def step_matrix(settings: sim.Settings, states: Array, names: tuple[str, ...]) -> Array:
    """How small deviations of the named quantities from level flight come out of one step; shape (N, n, n).

    Central differences. Where a table has a node at the flight condition, as at zero sideslip, this is the mean of both
    sides.
    """
    command = holding_command(settings, states)
    outputs = [INDEX[name] for name in names]
    columns = []
    for name in names:
        ahead, behind = (
            sim.step_many(_deviated(settings, states, name, sign * _DEVIATION), command, settings)[:, outputs]
            for sign in (1.0, -1.0)
        )
        columns.append((ahead - behind) / (2.0 * _DEVIATION))
    return np.stack(columns, axis=-1)


def _deviated(settings: sim.Settings, states: Array, name: str, deviation: float) -> Array:
    """The states with one quantity moved, and all that follows from it."""
    moved = states.copy()
    moved[:, INDEX[name]] += deviation
    angles_and_rates = [f"{axis}_rate_degps" for axis in ("roll", "pitch", "yaw")] + ["sideslip_deg", "roll_deg"]
    given = {known: column(moved, known) for known in (*_HELD, *angles_and_rates)}
    complete = sim.start_from(settings, **given)
    kept = [INDEX[field] for field in _CONTROL_LAW_FIELDS]
    complete[:, kept] = moved[:, kept]
    return complete


def growth_rate(matrices: Array, time_step: float) -> Array:
    """Growth of the fastest growing deviation, in 1/s."""
    return np.log(np.abs(np.linalg.eigvals(matrices)).max(axis=-1)) / time_step


def modes(matrix: Array, time_step: float) -> list[Mode]:
    """The modes of one step matrix, oscillations once, the fastest first."""
    return modes_of(np.log(np.linalg.eigvals(matrix).astype(complex)) / time_step)


def modes_of(roots: NDArray[np.complex128]) -> list[Mode]:
    """The modes that eigenvalues in 1/s stand for, oscillations once, the fastest first."""
    return [mode_of(root) for root in sorted(roots[roots.imag >= 0.0], key=abs, reverse=True)]


def mode_of(root: complex) -> Mode:
    """The mode of one eigenvalue in 1/s."""
    return Mode(root.real, abs(root), -root.real / abs(root))
