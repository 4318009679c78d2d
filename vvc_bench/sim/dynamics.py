"""Rigid-body flight: forces, moments, accelerations and kinematics (model.md, "State and integration").

The equations are the paper's (its Appendix A, eqs 1–10) with the figures of `vvc_bench.sim.aircraft`. They are total:
a division is guarded where its divisor can reach zero, so that a wild state gives wild numbers and not an exception.
"""

import math
from typing import NamedTuple

from vvc_bench.jit import inlined, kernel
from vvc_bench.sim.aerodynamics import coefficients
from vvc_bench.sim.aircraft import (
    ENGINE_ANGULAR_MOMENTUM,
    GRAVITY,
    INERTIA_X,
    INERTIA_XZ,
    INERTIA_Y,
    INERTIA_Z,
    MEAN_CHORD,
    WING_AREA,
    WING_SPAN,
)
from vvc_bench.sim.atmosphere import Air
from vvc_bench.sim.fields import Conditions, SurfaceCommand
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.propulsion import maximum_thrust

LEAST_AIRSPEED = 1.0  # m/s, guards divisions only
QUATERNION_CORRECTION = 2.0  # 1/s, pulls the quaternion's length towards 1

_GAMMA = INERTIA_X * INERTIA_Z - INERTIA_XZ * INERTIA_XZ
_PP_QR = INERTIA_Z * (INERTIA_Z - INERTIA_Y) + INERTIA_XZ * INERTIA_XZ
_RR_PQ = INERTIA_X * (INERTIA_X - INERTIA_Y) + INERTIA_XZ * INERTIA_XZ
_CROSS = INERTIA_XZ * (INERTIA_X - INERTIA_Y + INERTIA_Z)


class Body(NamedTuple):
    """What is integrated, or its time derivative: the first fields of `State`, in its order."""

    airspeed: float
    angle_of_attack: float
    sideslip: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    quaternion_w: float
    quaternion_x: float
    quaternion_y: float
    quaternion_z: float
    north: float
    east: float
    altitude: float


class Vector(NamedTuple):
    """Three components in body axes (x, y, z) or earth axes (north, east, up)."""

    x: float
    y: float
    z: float


class Loads(NamedTuple):
    """What acts on the aircraft, gravity apart: forces in N, moments in N·m, body axes."""

    force_x: float
    """Aerodynamic force and thrust."""
    force_y: float
    force_z: float
    moment_x: float
    moment_y: float
    moment_z: float
    thrust: float


@kernel
def air_velocity(body: Body) -> Vector:
    """Velocity through the air in body axes, in m/s."""
    cos_beta = math.cos(body.sideslip)
    return Vector(
        body.airspeed * math.cos(body.angle_of_attack) * cos_beta,
        body.airspeed * math.sin(body.sideslip),
        body.airspeed * math.sin(body.angle_of_attack) * cos_beta,
    )


@kernel
def ground_velocity(body: Body, velocity: Vector, conditions: Conditions) -> Vector:
    """Velocity over the ground, north, east and up, in m/s, by the quaternion as it is (not normalised)."""
    w, x, y, z = body.quaternion_w, body.quaternion_x, body.quaternion_y, body.quaternion_z
    north = (
        (w * w + x * x - y * y - z * z) * velocity.x
        + 2.0 * (x * y - w * z) * velocity.y
        + 2.0 * (x * z + w * y) * velocity.z
    )
    east = (
        2.0 * (x * y + w * z) * velocity.x
        + (w * w - x * x + y * y - z * z) * velocity.y
        + 2.0 * (y * z - w * x) * velocity.z
    )
    down = (
        2.0 * (x * z - w * y) * velocity.x
        + 2.0 * (y * z + w * x) * velocity.y
        + (w * w - x * x - y * y + z * z) * velocity.z
    )
    if conditions.wind_north == 0.0 and conditions.wind_east == 0.0 and conditions.wind_up == 0.0:
        return Vector(north, east, -down)
    return Vector(north + conditions.wind_north, east + conditions.wind_east, conditions.wind_up - down)


@inlined
def loads(body: Body, velocity: Vector, controls: SurfaceCommand, gust: Vector, gusty: bool, air: Air) -> Loads:
    """Aerodynamic and engine loads; ``gust`` is the air's own motion in body axes, in m/s, unless not ``gusty``."""
    airspeed, angle_of_attack, sideslip = body.airspeed, body.angle_of_attack, body.sideslip
    if gusty:
        u, v, w = velocity.x - gust.x, velocity.y - gust.y, velocity.z - gust.z
        airspeed = max(math.sqrt(u * u + v * v + w * w), LEAST_AIRSPEED)
        angle_of_attack = math.atan2(w, u)
        sideslip = math.asin(clip(v / airspeed, -1.0, 1.0))

    per_two_speeds = 0.5 / max(airspeed, LEAST_AIRSPEED)
    c = coefficients(
        angle_of_attack,
        sideslip,
        controls.aileron,
        controls.elevator,
        controls.rudder,
        body.roll_rate * WING_SPAN * per_two_speeds,
        body.pitch_rate * MEAN_CHORD * per_two_speeds,
        body.yaw_rate * WING_SPAN * per_two_speeds,
    )
    pressure_area = 0.5 * air.density * airspeed * airspeed * WING_AREA
    thrust = controls.throttle * maximum_thrust(airspeed, body.altitude, air)
    return Loads(
        pressure_area * c.cx + thrust,
        pressure_area * c.cy,
        pressure_area * c.cz,
        pressure_area * WING_SPAN * c.cl,
        pressure_area * MEAN_CHORD * c.cm - ENGINE_ANGULAR_MOMENTUM * body.yaw_rate,
        pressure_area * WING_SPAN * c.cn + ENGINE_ANGULAR_MOMENTUM * body.pitch_rate,
        thrust,
    )


@kernel
def rates(body: Body, velocity: Vector, over_ground: Vector, load: Loads, mass: float) -> Body:
    """Time derivative of everything integrated; the position moves with ``over_ground``."""
    u, v, w = velocity.x, velocity.y, velocity.z
    p, q, r = body.roll_rate, body.pitch_rate, body.yaw_rate
    e0, e1, e2, e3 = body.quaternion_w, body.quaternion_x, body.quaternion_y, body.quaternion_z

    per_mass = 1.0 / mass
    u_rate = r * v - q * w + GRAVITY * 2.0 * (e1 * e3 - e0 * e2) + load.force_x * per_mass
    v_rate = p * w - r * u + GRAVITY * 2.0 * (e2 * e3 + e0 * e1) + load.force_y * per_mass
    w_rate = q * u - p * v + GRAVITY * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3) + load.force_z * per_mass

    per_airspeed = 1.0 / max(body.airspeed, LEAST_AIRSPEED)
    in_plane = max(u * u + w * w, LEAST_AIRSPEED * LEAST_AIRSPEED)  # (V cos β)²
    airspeed_rate = (u * u_rate + v * v_rate + w * w_rate) * per_airspeed
    moment_x, moment_y, moment_z = load.moment_x, load.moment_y, load.moment_z
    correction = QUATERNION_CORRECTION * (1.0 - (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3))
    return Body(
        airspeed_rate,
        (u * w_rate - w * u_rate) / in_plane,
        (v_rate - v * airspeed_rate * per_airspeed) / math.sqrt(in_plane),
        (INERTIA_Z * moment_x + INERTIA_XZ * moment_z - _PP_QR * q * r + _CROSS * p * q) * (1.0 / _GAMMA),
        (moment_y + (INERTIA_Z - INERTIA_X) * p * r - INERTIA_XZ * (p * p - r * r)) * (1.0 / INERTIA_Y),
        (INERTIA_X * moment_z + INERTIA_XZ * moment_x + _RR_PQ * p * q - _CROSS * q * r) * (1.0 / _GAMMA),
        0.5 * (-p * e1 - q * e2 - r * e3) + correction * e0,
        0.5 * (p * e0 + r * e2 - q * e3) + correction * e1,
        0.5 * (q * e0 - r * e1 + p * e3) + correction * e2,
        0.5 * (r * e0 + q * e1 - p * e2) + correction * e3,
        over_ground.x,
        over_ground.y,
        over_ground.z,
    )
