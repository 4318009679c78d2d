"""Through one time step: the reference's explicit Euler, or an accurate fourth-order Runge–Kutta in substeps.

Both are one loop over stages. A stage evaluates the forces once, moves the running total on by its weight, and places
the point where the next stage evaluates.
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

EULER_STAGES = 1
RUNGE_KUTTA_STAGES = 4
_EULER, _RUNGE_KUTTA = 0, 1
_WEIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]])
_REACH = np.array([[0.0, 0.0, 0.0, 0.0], [0.5, 0.5, 1.0, 0.0]])
"""Weight of each stage, and how far along its slope the next one lies, in steps."""


class Motion(NamedTuple):
    """Where one time step has led."""

    body: Body
    air_velocity: Vector
    ground_velocity: Vector
    controls: SurfaceCommand
    load: Loads
    """Reference: at the old state with the new deflections. Accurate: at the new state."""


@inlined
def integrate(
    body: Body,
    velocity: Vector,
    over_ground: Vector,
    air: Air,
    controls: SurfaceCommand,
    command: SurfaceCommand,
    gust: Vector,
    conditions: Conditions,
    accurate: bool,
    time_step: float,
    substeps: int,
) -> Motion:
    """One time step of ``time_step`` s in ``substeps`` equal parts, under a command held constant.

    ``velocity``, ``over_ground`` and ``air`` belong to ``body``. Deflections move between substeps and are held within
    one. The accurate dynamics normalise the quaternion after each substep; the reference never does.
    """
    scheme, stages = (_RUNGE_KUTTA, RUNGE_KUTTA_STAGES) if accurate else (_EULER, EULER_STAGES)
    mass = MASS * (1.0 + conditions.mass_offset)
    h = time_step / substeps
    here, total = body, body
    load = Loads(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    last = stages * substeps
    stage = 0
    for evaluation in range(last + 1 if accurate else last):
        if stage == 0 and evaluation < last:
            controls = deflect(controls, command, conditions, h)
        load = loads(here, velocity, controls, gust, conditions.gust_intensity > 0.0, air)
        if evaluation == last:  # only for the report of the accurate dynamics
            break
        rate = rates(here, velocity, over_ground, load, mass)
        total = shift(total, rate, h * _WEIGHT[scheme, stage])
        if stage < stages - 1:
            here = shift(body, rate, h * _REACH[scheme, stage])
            stage += 1
        else:
            if accurate:
                total = normalised(total)
            here, body = total, total
            stage = 0
        velocity = air_velocity(here)
        over_ground = ground_velocity(here, velocity, conditions)
        if accurate:
            air = air_at(here.altitude, 1.0 + conditions.density_offset)
    return Motion(body, velocity, over_ground, controls, load)


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
    """The same body with a quaternion of length 1."""
    w, x, y, z = body.quaternion_w, body.quaternion_x, body.quaternion_y, body.quaternion_z
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return Body(
        body.airspeed,
        body.angle_of_attack,
        body.sideslip,
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
