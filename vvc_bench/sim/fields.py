"""Every quantity of the simulator, once: name, unit, bounds, mirror sign, symbol, meaning.

Spaces, file schemas, column names, the mirror image of a flight and the documentation are read off these classes.
Values are in SI units and radians; `columns` gives the names and the factors of the outside world.
"""

import functools
import math
from typing import Annotated, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.sim.units import (
    ANGLE,
    ANGULAR_RATE,
    COUNT,
    DEGREES_PER_RADIAN,
    METRE,
    METRE_PER_SECOND,
    NEWTON,
    ONE,
    SECOND,
    STANDARD_GRAVITY,
    Unit,
)


class Field(NamedTuple):
    """What is known of one quantity."""

    unit: Unit
    symbol: str
    meaning: str
    mirror: int = 1
    """−1 where the mirror image of a flight, left for right, has the opposite sign."""
    low: float = -math.inf
    """Smallest allowed value, in inside units."""
    high: float = math.inf
    noise: float = 0.0
    """Standard deviation of a sensor's error, in inside units, where there is sensor noise."""


MIRRORED = -1


def degrees(value: float) -> float:
    """An angle in degrees, or a rate in degrees per second, in inside units."""
    return value / DEGREES_PER_RADIAN


HALF_TURN = degrees(180.0)
QUARTER_TURN = degrees(90.0)
"""Bounds of angles, so that a typed 180° lies within them: `DEGREES_PER_RADIAN` is rounded."""


class State(NamedTuple):
    """One aircraft, in full: what the next step depends on, and what was reported of the last one.

    Axes: body x forward, y right, z down; earth north, east, up. As an array it is one row of `len(State._fields)`
    float64 values in this order, followed by the commands still on their way where there is control delay.
    ``State(*states.T)`` names the columns of many rows.
    """

    airspeed: Annotated[float, Field(METRE_PER_SECOND, "V", "true airspeed", low=0.0)]
    angle_of_attack: Annotated[float, Field(ANGLE, "α", "angle of attack")]
    sideslip: Annotated[float, Field(ANGLE, "β", "sideslip", MIRRORED)]
    roll_rate: Annotated[float, Field(ANGULAR_RATE, "p", "body rate about x", MIRRORED)]
    pitch_rate: Annotated[float, Field(ANGULAR_RATE, "q", "body rate about y")]
    yaw_rate: Annotated[float, Field(ANGULAR_RATE, "r", "body rate about z", MIRRORED)]
    quaternion_w: Annotated[float, Field(ONE, "e₀", "attitude, body to north-east-down, scalar part")]
    quaternion_x: Annotated[float, Field(ONE, "e₁", "attitude, x part", MIRRORED)]
    quaternion_y: Annotated[float, Field(ONE, "e₂", "attitude, y part")]
    quaternion_z: Annotated[float, Field(ONE, "e₃", "attitude, z part", MIRRORED)]
    north: Annotated[float, Field(METRE, "n", "distance flown north")]
    east: Annotated[float, Field(METRE, "e", "distance flown east", MIRRORED)]
    altitude: Annotated[float, Field(METRE, "h", "altitude")]
    forward_velocity: Annotated[float, Field(METRE_PER_SECOND, "u_b", "velocity through the air along body x")]
    side_velocity: Annotated[float, Field(METRE_PER_SECOND, "v_b", "velocity through the air along body y", MIRRORED)]
    normal_velocity: Annotated[float, Field(METRE_PER_SECOND, "w_b", "velocity through the air along body z")]
    velocity_north: Annotated[float, Field(METRE_PER_SECOND, "vₙ", "velocity over the ground, north")]
    velocity_east: Annotated[float, Field(METRE_PER_SECOND, "vₑ", "velocity over the ground, east", MIRRORED)]
    velocity_up: Annotated[float, Field(METRE_PER_SECOND, "vₕ", "climb rate")]
    roll: Annotated[float, Field(ANGLE, "φ", "bank angle", MIRRORED, -HALF_TURN, HALF_TURN)]
    pitch: Annotated[float, Field(ANGLE, "θ", "pitch angle", 1, -QUARTER_TURN, QUARTER_TURN)]
    yaw: Annotated[float, Field(ANGLE, "ψ", "heading", MIRRORED, -HALF_TURN, HALF_TURN)]
    speed: Annotated[float, Field(METRE_PER_SECOND, "v", "length of the velocity vector (airspeed, without wind)")]
    path_angle: Annotated[float, Field(ANGLE, "μ", "elevation of the velocity vector", 1, -QUARTER_TURN, QUARTER_TURN)]
    azimuth: Annotated[float, Field(ANGLE, "χ", "azimuth of the velocity vector", MIRRORED, -HALF_TURN, HALF_TURN)]
    load_factor_x: Annotated[float, Field(STANDARD_GRAVITY, "n_x", "load factor along body x")]
    load_factor_y: Annotated[float, Field(STANDARD_GRAVITY, "n_y", "load factor along body y", MIRRORED)]
    load_factor: Annotated[float, Field(STANDARD_GRAVITY, "n_z", "normal load factor, up positive")]
    aileron: Annotated[float, Field(ANGLE, "δ_a", "aileron deflection", MIRRORED)]
    elevator: Annotated[float, Field(ANGLE, "δ_e", "elevator deflection")]
    rudder: Annotated[float, Field(ANGLE, "δ_r", "rudder deflection", MIRRORED)]
    throttle: Annotated[float, Field(ONE, "δ_t", "throttle", 1, 0.0, 1.0)]
    thrust: Annotated[float, Field(NEWTON, "T", "engine thrust")]
    load_factor_integral: Annotated[float, Field(ANGLE, "I", "control law: integral of the load-factor error")]
    roll_rate_integral: Annotated[float, Field(ANGLE, "J", "control law: integral of the roll-rate error", MIRRORED)]
    gust_forward: Annotated[float, Field(METRE_PER_SECOND, "u_g", "Dryden filter, body x")]
    gust_side: Annotated[float, Field(METRE_PER_SECOND, "v_g₁", "Dryden filter, body y, first state", MIRRORED)]
    gust_side_lagged: Annotated[float, Field(METRE_PER_SECOND, "v_g₂", "Dryden filter, body y, second", MIRRORED)]
    gust_normal: Annotated[float, Field(METRE_PER_SECOND, "w_g₁", "Dryden filter, body z, first state")]
    gust_normal_lagged: Annotated[float, Field(METRE_PER_SECOND, "w_g₂", "Dryden filter, body z, second state")]
    steps: Annotated[float, Field(COUNT, "k", "steps flown since the start", low=0.0)]
    clipped_commands: Annotated[float, Field(COUNT, "", "command components clipped to their bounds so far", low=0.0)]


class GuidanceCommand(NamedTuple):
    """What the guidance control mode commands: the control law turns it into deflections."""

    roll_rate: Annotated[
        float, Field(ANGULAR_RATE, "p_c", "roll-rate command", MIRRORED, degrees(-180.0), degrees(180.0))
    ]
    load_factor: Annotated[float, Field(STANDARD_GRAVITY, "n_zc", "normal-load-factor command", 1, -4.0, 9.0)]
    throttle: Annotated[float, Field(ONE, "δ_t", "throttle command", 1, 0.0, 1.0)]


class SurfaceCommand(NamedTuple):
    """What the end-to-end control mode commands: the deflections themselves."""

    aileron: Annotated[float, Field(ANGLE, "δ_a", "aileron command", MIRRORED, degrees(-21.5), degrees(21.5))]
    elevator: Annotated[float, Field(ANGLE, "δ_e", "elevator command", 1, degrees(-25.0), degrees(25.0))]
    rudder: Annotated[float, Field(ANGLE, "δ_r", "rudder command", MIRRORED, degrees(-30.0), degrees(30.0))]
    throttle: Annotated[float, Field(ONE, "δ_t", "throttle command", 1, 0.0, 1.0)]


class Goal(NamedTuple):
    """A wanted velocity vector."""

    speed: Annotated[float, Field(METRE_PER_SECOND, "v_c", "wanted length of the velocity vector", 1, 0.0, 1000.0)]
    path_angle: Annotated[
        float, Field(ANGLE, "μ_c", "wanted elevation of the velocity vector", 1, -QUARTER_TURN, QUARTER_TURN)
    ]
    azimuth: Annotated[
        float, Field(ANGLE, "χ_c", "wanted azimuth of the velocity vector", MIRRORED, -HALF_TURN, HALF_TURN)
    ]


class Observation(NamedTuple):
    """What a learner sees of a `State`, in the reference's order and units; values outside the bounds are clipped."""

    roll: Annotated[float, Field(ANGLE, "φ", "bank angle", MIRRORED, -HALF_TURN, HALF_TURN, noise=degrees(0.2))]
    pitch: Annotated[float, Field(ANGLE, "θ", "pitch angle", 1, -QUARTER_TURN, QUARTER_TURN, noise=degrees(0.2))]
    yaw: Annotated[float, Field(ANGLE, "ψ", "heading", MIRRORED, -HALF_TURN, HALF_TURN, noise=degrees(0.5))]
    speed: Annotated[float, Field(METRE_PER_SECOND, "v", "length of the velocity vector", 1, 0.0, 1000.0, noise=1.0)]
    path_angle: Annotated[
        float,
        Field(ANGLE, "μ", "elevation of the velocity vector", 1, -QUARTER_TURN, QUARTER_TURN, noise=degrees(0.2)),
    ]
    azimuth: Annotated[
        float, Field(ANGLE, "χ", "azimuth of the velocity vector", MIRRORED, -HALF_TURN, HALF_TURN, noise=degrees(0.2))
    ]
    roll_rate: Annotated[
        float, Field(ANGULAR_RATE, "p", "body rate about x", MIRRORED, degrees(-300.0), degrees(300.0), degrees(0.5))
    ]
    altitude: Annotated[float, Field(METRE, "h", "altitude", 1, 0.0, 20000.0, noise=5.0)]


class Conditions(NamedTuple):
    """What the paper leaves out (its Appendix N); all zero is the paper's world, bit for bit."""

    wind_north: Annotated[float, Field(METRE_PER_SECOND, "", "steady wind blowing to the north")] = 0.0
    wind_east: Annotated[float, Field(METRE_PER_SECOND, "", "steady wind blowing to the east", MIRRORED)] = 0.0
    wind_up: Annotated[float, Field(METRE_PER_SECOND, "", "steady updraught")] = 0.0
    gust_intensity: Annotated[
        float, Field(METRE_PER_SECOND, "σ", "root mean square of each Dryden gust component", 1, 0.0, 50.0)
    ] = 0.0
    seed: Annotated[float, Field(COUNT, "", "seed of this aircraft's gusts and sensor noise", 1, 0.0, 2.0**53)] = 0.0
    density_offset: Annotated[float, Field(ONE, "Δρ/ρ", "relative change of the air density", 1, -0.9, 10.0)] = 0.0
    mass_offset: Annotated[float, Field(ONE, "Δm/m", "relative change of the mass, inertia kept", 1, -0.9, 10.0)] = 0.0
    actuator_time_constant: Annotated[
        float, Field(SECOND, "τ", "first-order lag of the control surfaces", 1, 0.0, 100.0)
    ] = 0.0
    actuator_rate_limit: Annotated[
        float, Field(ANGULAR_RATE, "", "fastest motion of the control surfaces; 0 is unlimited", 1, 0.0)
    ] = 0.0
    engine_time_constant: Annotated[float, Field(SECOND, "τ_t", "first-order lag of the throttle", 1, 0.0, 100.0)] = 0.0
    delay_steps: Annotated[float, Field(COUNT, "d", "steps between a command and its effect", 1, 0.0, 100.0)] = 0.0
    sensor_noise: Annotated[
        float, Field(ONE, "", "sensor noise, in multiples of `Observation`'s figures", 1, 0.0, 100.0)
    ] = 0.0


STILL = Conditions()
"""The paper's world: no wind, no gusts, nominal air and mass, ideal actuators."""


@functools.cache
def fields_of(quantities: type[tuple[float, ...]]) -> dict[str, Field]:
    """Name → `Field` of one of the classes above, in order."""
    hints = get_type_hints(quantities, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}


def columns(quantities: type[tuple[float, ...]]) -> dict[str, Field]:
    """The same by column name: the field's name with its outside unit, as in ``angle_of_attack_deg``."""
    return {"_".join(filter(None, (name, field.unit.outside))): field for name, field in fields_of(quantities).items()}


def field_array(quantities: type[tuple[float, ...]], attribute: str) -> NDArray[np.float64]:
    """One attribute of every field as an array: ``low``, ``high``, ``mirror``, or ``scale`` to outside units."""
    fields = fields_of(quantities).values()
    return np.array([field.unit.scale if attribute == "scale" else getattr(field, attribute) for field in fields])


def checked_inside(name: str, field: Field, value: ArrayLike) -> NDArray[np.float64]:
    """A typed value, or an array of them, in inside units.

    Raises:
        ValueError: if one is out of the field's bounds, NaN, or not whole where the field counts something.
    """
    given = np.asarray(value, dtype=np.float64)
    inside = given / field.unit.scale
    outside = ~((inside >= field.low) & (inside <= field.high))
    if outside.any():
        low, high = field.low * field.unit.scale, field.high * field.unit.scale
        raise ValueError(f"{name} must lie in [{low:g}, {high:g}], got {given[outside].flat[0]:g}")
    broken = (given != np.round(given)) & (field.unit is COUNT)
    if broken.any():
        raise ValueError(f"{name} must be a whole number, got {given[broken].flat[0]:g}")
    return inside
