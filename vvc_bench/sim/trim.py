"""Trim: the angle of attack, elevator and throttle of level, unaccelerated, wings-level flight.

At β = p = q = r = 0 and θ = α three balances remain: pitching moment (gives the elevator), lift against weight (gives
the angle of attack) and thrust against drag (gives the throttle). The first two are solved one inside the other by a
bracketing method, since the tables are only piecewise smooth.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.jit import entry_point, kernel, routine
from vvc_bench.sim.aerodynamics import ELEVATOR, Coefficients, coefficients
from vvc_bench.sim.aircraft import GRAVITY, MASS, WING_AREA
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.fields import degrees
from vvc_bench.sim.propulsion import maximum_thrust

LOWEST_ALPHA = degrees(-10.0)
HIGHEST_ALPHA = degrees(45.0)
_SCAN_STEP = degrees(2.5)
_LOWEST_ELEVATOR = degrees(ELEVATOR.first)
_HIGHEST_ELEVATOR = degrees(ELEVATOR.last)
_ITERATIONS = 200
_TOLERANCE = 1e-15


class Trim(NamedTuple):
    """Level flight's angles in rad and throttle; throttle outside [0, 1] or NaN where there is none."""

    angle_of_attack: float
    elevator: float
    throttle: float


@routine
def _level_coefficients(alpha: float, elevator: float) -> Coefficients:
    return coefficients(alpha, 0.0, 0.0, elevator, 0.0, 0.0, 0.0, 0.0)


@routine
def _balancing_elevator(alpha: float) -> float:
    """The elevator without pitching moment, by the Illinois method; NaN if the tables hold none."""
    low, high = _LOWEST_ELEVATOR, _HIGHEST_ELEVATOR
    moment_low, moment_high = _level_coefficients(alpha, low).cm, _level_coefficients(alpha, high).cm
    if moment_low * moment_high > 0.0:
        return math.nan
    for _ in range(_ITERATIONS):
        middle = (low * moment_high - high * moment_low) / (moment_high - moment_low)
        moment = _level_coefficients(alpha, middle).cm
        if abs(moment) < _TOLERANCE or abs(high - low) < _TOLERANCE:
            return middle
        if moment * moment_high < 0.0:
            low, moment_low = high, moment_high
        else:
            moment_low *= 0.5
        high, moment_high = middle, moment
    return middle


@routine
def _excess_weight(alpha: float, pressure_area: float, mass: float) -> float:
    """Weight less lift along body z, in units of the weight, with the elevator that balances the moment."""
    elevator = _balancing_elevator(alpha)
    cz = _level_coefficients(alpha, elevator).cz
    return math.cos(alpha) + pressure_area * cz / (mass * GRAVITY) if elevator == elevator else math.nan


@kernel
def trim(altitude: float, airspeed: float, density_factor: float, mass: float) -> Trim:
    """Solve for level flight at an altitude in m and a true airspeed in m/s; the lowest angle of attack that holds."""
    air = air_at(altitude, density_factor)
    pressure_area = 0.5 * air.density * airspeed * airspeed * WING_AREA
    low = LOWEST_ALPHA
    excess_low = _excess_weight(low, pressure_area, mass)
    high, excess_high = low, excess_low
    while high < HIGHEST_ALPHA - 0.5 * _SCAN_STEP:
        high, excess_high = low + _SCAN_STEP, _excess_weight(low + _SCAN_STEP, pressure_area, mass)
        if excess_low > 0.0 and excess_high <= 0.0:
            break
        low, excess_low = high, excess_high
    if not (excess_low > 0.0 and excess_high <= 0.0):
        return Trim(math.nan, math.nan, math.nan)
    middle = high
    for _ in range(_ITERATIONS):
        middle = (low * excess_high - high * excess_low) / (excess_high - excess_low)
        excess = _excess_weight(middle, pressure_area, mass)
        if abs(excess) < _TOLERANCE or abs(high - low) < _TOLERANCE:
            break
        if excess * excess_high < 0.0:
            low, excess_low = high, excess_high
        else:
            excess_low *= 0.5
        high, excess_high = middle, excess
    elevator = _balancing_elevator(middle)
    cx = _level_coefficients(middle, elevator).cx
    thrust = mass * GRAVITY * math.sin(middle) - pressure_area * cx
    return Trim(middle, elevator, thrust / maximum_thrust(airspeed, altitude, air))


@entry_point
def trim_rows(
    altitude: NDArray[np.float64],
    airspeed: NDArray[np.float64],
    density_factor: NDArray[np.float64],
    mass_factor: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Trim many: ``out[i]`` receives the fields of `Trim`."""
    for i in range(altitude.size):
        solved = trim(altitude[i], airspeed[i], density_factor[i], MASS * mass_factor[i])
        out[i, 0] = solved.angle_of_attack
        out[i, 1] = solved.elevator
        out[i, 2] = solved.throttle
