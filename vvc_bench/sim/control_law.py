"""The control law of the paper's Appendix B: roll-rate, load-factor and throttle commands to deflections.

Structure and figures are model.md's section "Control law"; the gain tables are ``data/control_law.json``. Angles are in
radians here, so that gains in degrees per g are converted when they are read.
"""

import json
import math
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from vvc_bench.jit import kernel
from vvc_bench.sim.atmosphere import SEA_LEVEL_DENSITY
from vvc_bench.sim.fields import GuidanceCommand, State, SurfaceCommand, degrees, fields_of
from vvc_bench.sim.interpolation import bilinear, clip, linear, locate, make_axis
from vvc_bench.sim.units import DEGREES_PER_RADIAN

_DATA: dict[str, Any] = json.loads(files("vvc_bench.sim").joinpath("data", "control_law.json").read_text("utf-8"))

_schedule = _DATA["gain_schedule"]
_SPEED = make_axis(_schedule["speed_mps"], bin_width=50.0)
_ALTITUDE = make_axis(_schedule["altitude_m"], bin_width=1000.0)
_LOAD_FACTOR_FEEDBACK = degrees(1.0) * np.array(_schedule["load_factor_feedback_deg_per_g"])
_PITCH_RATE_FEEDBACK = np.array(_schedule["pitch_rate_feedback_s"])
_LOAD_FACTOR_INTEGRAL = degrees(1.0) * np.array(_schedule["load_factor_integral_deg_per_g_s"])
_ROLL_RATE_FEEDBACK = np.array(_schedule["roll_rate_feedback_s"])
_ROLL_RATE_INTEGRAL = np.array(_schedule["roll_rate_integral"])

_load_factor_limit = _DATA["load_factor_limit"]
_LOAD_FACTOR_LIMIT_SPEED = make_axis(_load_factor_limit["equivalent_airspeed_mps"], bin_width=10.0)
_LOAD_FACTOR_LIMIT = np.array(_load_factor_limit["load_factor_g"])

_roll_rate_limit = _DATA["roll_rate_limit"]
_ROLL_RATE_LIMIT_SPEED = make_axis(_roll_rate_limit["equivalent_airspeed_mps"], bin_width=20.0)
_ROLL_RATE_LIMIT_ALPHA = make_axis(_roll_rate_limit["angle_of_attack_deg"], bin_width=10.0)
_ROLL_RATE_LIMIT = degrees(1.0) * np.array(_roll_rate_limit["roll_rate_degps"])

_rudder_gain = _DATA["rudder_sideslip_gain"]
_RUDDER_GAIN_SIDESLIP = make_axis(_rudder_gain["sideslip_deg"], bin_width=0.05)
_RUDDER_GAIN = np.array(_rudder_gain["rudder_deg_per_deg"])
_RUDDER_SCALE_SPEED = make_axis(_DATA["rudder_scale"]["equivalent_airspeed_mps"], bin_width=20.0)
_RUDDER_SCALE = np.array(_DATA["rudder_scale"]["scale"])

_LEAST_LOAD_FACTOR = fields_of(GuidanceCommand)["load_factor"].low
_LARGEST_LOAD_FACTOR = fields_of(GuidanceCommand)["load_factor"].high
_LARGEST_AILERON = fields_of(SurfaceCommand)["aileron"].high
_LARGEST_ELEVATOR = degrees(30.0)  # wider than the ±25° of the end-to-end mode; the tables end at ±25°
_LARGEST_RUDDER = fields_of(SurfaceCommand)["rudder"].high
_LARGEST_INTEGRAL = degrees(30.0)
_ELEVATOR_PER_LOAD_FACTOR_ERROR = degrees(1.0)  # rad per g
_AILERON_PER_ROLL_RATE_ERROR = 0.3  # s
_RUDDER_PER_YAW_RATE = 0.9  # s
_ALPHA_PROTECTION_START_DEG = 25.0  # beyond, the load-factor command falls by 1 g per degree, and by no more than 1 g


class ControlLawOutput(NamedTuple):
    """Deflections in rad, throttle 0..1, and the integrators to keep for the next step."""

    command: SurfaceCommand
    load_factor_integral: float
    roll_rate_integral: float


@kernel
def control_law(state: State, command: GuidanceCommand, density: float, time_step: float) -> ControlLawOutput:
    """One step of the law on the last reported state; ``density`` in kg/m³, ``time_step`` in s."""
    equivalent_airspeed = state.airspeed * math.sqrt(density / SEA_LEVEL_DENSITY)
    v, fv = locate(_SPEED, state.airspeed)
    h, fh = locate(_ALTITUDE, state.altitude)
    first_call = state.steps == 0.0

    load_factor_error = _limited_load_factor(command.load_factor, equivalent_airspeed, state) - state.load_factor
    pitch_integral, pitch_memory = _integrate(
        bilinear(_LOAD_FACTOR_INTEGRAL, h, fh, v, fv) * load_factor_error,
        state.load_factor_integral,
        time_step,
        first_call,
    )
    elevator = (
        bilinear(_LOAD_FACTOR_FEEDBACK, h, fh, v, fv) * state.load_factor
        + bilinear(_PITCH_RATE_FEEDBACK, h, fh, v, fv) * state.pitch_rate
        - (_ELEVATOR_PER_LOAD_FACTOR_ERROR * load_factor_error + pitch_integral)
    )

    roll_rate_error = _limited_roll_rate(command.roll_rate, equivalent_airspeed, state) - state.roll_rate
    roll_integral, roll_memory = _integrate(
        bilinear(_ROLL_RATE_INTEGRAL, h, fh, v, fv) * roll_rate_error,
        state.roll_rate_integral,
        time_step,
        first_call,
    )
    aileron = bilinear(_ROLL_RATE_FEEDBACK, h, fh, v, fv) * state.roll_rate - (
        _AILERON_PER_ROLL_RATE_ERROR * roll_rate_error + roll_integral
    )

    s, fs = locate(_RUDDER_SCALE_SPEED, equivalent_airspeed)
    b, fb = locate(_RUDDER_GAIN_SIDESLIP, state.sideslip * DEGREES_PER_RADIAN)
    rudder = linear(_RUDDER_SCALE, s, fs) * (
        linear(_RUDDER_GAIN, b, fb) * state.sideslip + _RUDDER_PER_YAW_RATE * state.yaw_rate
    )
    return ControlLawOutput(
        SurfaceCommand(
            clip(aileron, -_LARGEST_AILERON, _LARGEST_AILERON),
            clip(elevator, -_LARGEST_ELEVATOR, _LARGEST_ELEVATOR),
            clip(rudder, -_LARGEST_RUDDER, _LARGEST_RUDDER),
            clip(command.throttle, 0.0, 1.0),
        ),
        pitch_memory,
        roll_memory,
    )


@kernel
def _limited_load_factor(command: float, equivalent_airspeed: float, state: State) -> float:
    cell, fraction = locate(_LOAD_FACTOR_LIMIT_SPEED, equivalent_airspeed)
    limit = linear(_LOAD_FACTOR_LIMIT, cell, fraction)
    limited = min(clip(command, _LEAST_LOAD_FACTOR, _LARGEST_LOAD_FACTOR), limit)
    relief = clip(state.angle_of_attack * DEGREES_PER_RADIAN - _ALPHA_PROTECTION_START_DEG, 0.0, 1.0)
    return max(limited - relief, _LEAST_LOAD_FACTOR)


@kernel
def _limited_roll_rate(command: float, equivalent_airspeed: float, state: State) -> float:
    v, fv = locate(_ROLL_RATE_LIMIT_SPEED, equivalent_airspeed)
    a, fa = locate(_ROLL_RATE_LIMIT_ALPHA, state.angle_of_attack * DEGREES_PER_RADIAN)
    limit = bilinear(_ROLL_RATE_LIMIT, v, fv, a, fa)
    return clip(command, -limit, limit)


@kernel
def _integrate(rate: float, memory: float, time_step: float, first_call: bool) -> tuple[float, float]:
    """Trapezoidal integrator with clamped memory: its output now, and its memory for the next call."""
    half = 0.5 * time_step * rate
    if first_call:
        return 0.0, clip(half, -_LARGEST_INTEGRAL, _LARGEST_INTEGRAL)
    output = clip(memory + half, -_LARGEST_INTEGRAL, _LARGEST_INTEGRAL)
    return output, clip(memory + time_step * rate, -_LARGEST_INTEGRAL, _LARGEST_INTEGRAL)
