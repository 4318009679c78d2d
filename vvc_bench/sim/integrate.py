"""Through one time step: the reference's explicit Euler, or an accurate fourth-order Runge–Kutta in substeps.

They are written out apart: Euler as one pass of the Runge–Kutta loop would cost a tenth of the speed.
"""

import math
from typing import NamedTuple

import numpy as np

from vvc_bench.jit import inlined, kernel
from vvc_bench.sim.actuators import deflect
from vvc_bench.sim.aircraft import GRAVITY, MASS
from vvc_bench.sim.atmosphere import Air, air_at
from vvc_bench.sim.dynamics import Body, Loads, Vector, air_velocity, ground_velocity, loads, rates
from vvc_bench.sim.fields import Conditions, SurfaceCommand

STAGES = 4
_WEIGHT = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
_REACH = np.array([0.5, 0.5, 1.0, 0.0])
"""Of the classical Runge–Kutta scheme: each stage's weight, and how far along its slope the next one lies, in steps."""


class Motion(NamedTuple):
    """Where one time step has led."""

    body: Body
    air_velocity: Vector
    ground_velocity: Vector
    controls: SurfaceCommand
    load: Loads
    """Reference: at the old state with the new deflections. Accurate: at the new state."""


@inlined
def euler_step(
    body: Body,
    velocity: Vector,
    over_ground: Vector,
    air: Air,
    controls: SurfaceCommand,
    command: SurfaceCommand,
    gust: Vector,
    conditions: Conditions,
    time_step: float,
) -> Motion:
    """Reference dynamics: one force evaluation at the old state, with the new deflections.

    ``velocity``, ``over_ground`` and ``air`` belong to ``body``. The quaternion is never normalised.
    """
    deflections = deflect(controls, command, conditions, time_step)
    load = loads(body, velocity, deflections, gust, conditions.gust_intensity > 0.0, air)
    rate = rates(body, velocity, over_ground, load, MASS * (1.0 + conditions.mass_offset))
    after = shift(body, rate, time_step)
    new_velocity = air_velocity(after)
    return Motion(after, new_velocity, ground_velocity(after, new_velocity, conditions), deflections, load)


@inlined
def runge_kutta_step(
    body: Body,
    controls: SurfaceCommand,
    command: SurfaceCommand,
    gust: Vector,
    conditions: Conditions,
    time_step: float,
    substeps: int,
) -> Motion:
    """Accurate dynamics: ``substeps`` equal parts, the quaternion normalised after each.

    One loop over stages: a stage evaluates the forces, moves the running total on by its weight, and places the point
    where the next stage evaluates. One evaluation more, at the end, is for the report. Deflections move between
    substeps and are held within one.
    """
    mass = MASS * (1.0 + conditions.mass_offset)
    h = time_step / substeps
    here, total, deflections = body, body, controls
    last = STAGES * substeps
    stage = 0
    for evaluation in range(last + 1):
        if stage == 0 and evaluation < last:
            deflections = deflect(deflections, command, conditions, h)
        velocity = air_velocity(here)
        over_ground = ground_velocity(here, velocity, conditions)
        air = air_at(here.altitude, 1.0 + conditions.density_offset)
        load = loads(here, velocity, deflections, gust, conditions.gust_intensity > 0.0, air)
        rate = rates(here, velocity, over_ground, load, mass)
        if evaluation == last:
            break
        total = shift(total, rate, h * _WEIGHT[stage])
        if stage < STAGES - 1:
            here = shift(body, rate, h * _REACH[stage])
            stage += 1
        else:
            total = normalised(total)
            here, body = total, total
            stage = 0
    return Motion(body, velocity, over_ground, deflections, load)


@kernel
def shift(body: Body, rate: Body, time: float) -> Body:
    """``body + time · rate``, component by component."""
    return Body(
        body.airspeed + time * rate.airspeed,
        body.angle_of_attack + time * rate.angle_of_attack,
        body.sideslip + time * rate.sideslip,
        body.roll_rate + time * rate.roll_rate,
        body.pitch_rate + time * rate.pitch_rate,
        body.yaw_rate + time * rate.yaw_rate,
        body.quaternion_w + time * rate.quaternion_w,
        body.quaternion_x + time * rate.quaternion_x,
        body.quaternion_y + time * rate.quaternion_y,
        body.quaternion_z + time * rate.quaternion_z,
        body.north + time * rate.north,
        body.east + time * rate.east,
        body.altitude + time * rate.altitude,
    )


@kernel
def normalised(body: Body) -> Body:
    """The same body with a quaternion of length 1, and its velocity by angles that the tables know (±180°, ±90°)."""
    airspeed, angle_of_attack, sideslip = body.airspeed, body.angle_of_attack, body.sideslip
    if airspeed < 0.0 or abs(angle_of_attack) > math.pi or abs(sideslip) > 0.5 * math.pi:
        velocity = air_velocity(body)
        in_plane = math.sqrt(velocity.x * velocity.x + velocity.z * velocity.z)
        airspeed = abs(airspeed)
        angle_of_attack = math.atan2(velocity.z, velocity.x)
        sideslip = math.atan2(velocity.y, in_plane)
    w, x, y, z = body.quaternion_w, body.quaternion_x, body.quaternion_y, body.quaternion_z
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return Body(
        airspeed,
        angle_of_attack,
        sideslip,
        body.roll_rate,
        body.pitch_rate,
        body.yaw_rate,
        w / length,
        x / length,
        y / length,
        z / length,
        body.north,
        body.east,
        body.altitude,
    )


@kernel
def load_factors(load: Loads, conditions: Conditions) -> Vector:
    """Load factors n_x, n_y, n_z in g; n_z is positive upwards, the other two along the body axes."""
    weight = MASS * (1.0 + conditions.mass_offset) * GRAVITY
    return Vector(load.force_x / weight, load.force_y / weight, -load.force_z / weight)
