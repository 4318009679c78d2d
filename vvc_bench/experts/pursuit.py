"""Bank-to-turn pursuit: roll the lift vector towards the wanted direction, pull in proportion to the angle.

The law has no memory and works at any attitude, as it knows directions and no bank angle of the horizon. With u the
direction of flight, d the wanted one, ε the angle between them, t the unit vector at right angles to u towards d, k the
direction of up, V the speed and g = 9.81 m/s²:

- lift wanted, in g: n = (V · gain · ε / g) t + (k − (k·u) u): the turn, and what carries the weight;
- roll rate: `bank_gain` times the angle about u from the lift vector that is to the one that is wanted. Where that is
  more than 90° away and a push of at most `largest_push` will do, the wings stay and the lift is negative;
- load factor: the part of n along the lift vector that is, so that nothing is pulled sideways while the roll goes on;
- throttle: what carries the weight along the wanted path, and `speed_gain` for each m/s that is missing;
- energy: while the speed is wrong by more than `speed_margin`, the path aimed at lies lower by `height_gain` for each
  m/s that is missing, and higher for each that is too much. What the way to a steep path will take or give counts: the
  wanted speed is v_c + `speed_reserve` · ε · sin μ_c on the way.

All is read off an `Observation`, so that the law is a policy like any other.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.experts.pid import check_states_and_goals
from vvc_bench.jit import entry_point, kernel
from vvc_bench.sim.aircraft import GRAVITY, MASS
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.dynamics import Vector
from vvc_bench.sim.fields import Goal, GuidanceCommand, Observation, State, degrees, fields_of
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.propulsion import maximum_thrust
from vvc_bench.sim.rows import load_goal, load_state

_FASTEST_ROLL = fields_of(GuidanceCommand)["roll_rate"].high
_STEEPEST = degrees(88.0)  # an aim beyond the vertical would turn round
_SMALL = 1e-9


class PursuitParameters(NamedTuple):
    """The law's figures, in SI units and radians; the defaults are `PURSUIT`."""

    turn_gain: float = 0.85
    """Turn rate for each radian between the directions, 1/s."""
    largest_load_factor: float = 6.1
    """Of the command, g; the control law has limits of its own."""
    largest_push: float = 0.24
    """Negative load, g, up to which the law pushes in place of rolling over."""
    bank_gain: float = 1.28
    """Roll rate for each radian of bank error, 1/s."""
    speed_gain: float = 0.05
    """Throttle for each m/s that is missing, s/m."""
    height_gain: float = 0.012
    """How much lower the path aimed at is for each m/s that is missing, rad·s/m."""
    speed_reserve: float = 53.0
    """Speed to have in hand for each radian on the way to a vertical climb, m/s."""
    speed_margin: float = 6.1
    """Speed error that height is not used for, m/s."""


PURSUIT = PursuitParameters()
"""Found by a cross-entropy search for the figures that reach most of 1,500 goals of the paper's grid under the rules of
VVC/Hard-v0."""


class Steering(NamedTuple):
    """A `GuidanceCommand` without its throttle."""

    roll_rate: float
    load_factor: float


@kernel
def _dot(a: Vector, b: Vector) -> float:
    return a.x * b.x + a.y * b.y + a.z * b.z


@kernel
def _lift_axis(roll: float, pitch: float, yaw: float) -> Vector:
    """Body −z, north, east, up: where positive lift points."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return Vector(-(cr * sp * cy + sr * sy), -(cr * sp * sy - sr * cy), cr * cp)


@kernel
def _aimed_path_angle(goal: Goal, speed: float, to_go: float, parameters: PursuitParameters) -> float:
    """Path angle to aim at: below the goal's where speed is missing, above where there is too much."""
    missing = goal.speed + parameters.speed_reserve * to_go * math.sin(goal.path_angle) - speed
    beyond = missing - clip(missing, -parameters.speed_margin, parameters.speed_margin)
    return clip(goal.path_angle - parameters.height_gain * beyond, -_STEEPEST, _STEEPEST)


@kernel
def steer(state: State | Observation, goal: Goal, parameters: PursuitParameters) -> Steering:
    """Roll rate and load factor of the law."""
    cos_path = math.cos(state.path_angle)
    flight = Vector(cos_path * math.cos(state.azimuth), cos_path * math.sin(state.azimuth), math.sin(state.path_angle))
    north, east = math.cos(goal.azimuth), math.sin(goal.azimuth)
    cos_aim, sin_aim = math.cos(goal.path_angle), math.sin(goal.path_angle)
    if parameters.height_gain > 0.0:
        along_goal = _dot(flight, Vector(cos_aim * north, cos_aim * east, sin_aim))
        aimed = _aimed_path_angle(goal, state.speed, math.acos(clip(along_goal, -1.0, 1.0)), parameters)
        cos_aim, sin_aim = math.cos(aimed), math.sin(aimed)
    aim = Vector(cos_aim * north, cos_aim * east, sin_aim)

    along = _dot(flight, aim)
    across = Vector(aim.x - along * flight.x, aim.y - along * flight.y, aim.z - along * flight.z)
    sine = math.sqrt(_dot(across, across))
    turn = state.speed * parameters.turn_gain * math.atan2(sine, along) / GRAVITY / max(sine, _SMALL)
    wanted = Vector(
        turn * across.x - flight.z * flight.x,
        turn * across.y - flight.z * flight.y,
        turn * across.z + 1.0 - flight.z * flight.z,
    )

    axis = _lift_axis(state.roll, state.pitch, state.yaw)
    leaning = _dot(axis, flight)
    lift = Vector(axis.x - leaning * flight.x, axis.y - leaning * flight.y, axis.z - leaning * flight.z)
    per_length = 1.0 / max(math.sqrt(_dot(lift, lift)), _SMALL)
    pull = _dot(wanted, lift) * per_length
    # about the direction of flight, positive to the right: earth axes here have up, not down
    sideways = per_length * (
        flight.x * (lift.z * wanted.y - lift.y * wanted.z)
        + flight.y * (lift.x * wanted.z - lift.z * wanted.x)
        + flight.z * (lift.y * wanted.x - lift.x * wanted.y)
    )
    largest_push = parameters.largest_push
    pushing = pull < 0.0 and sideways * sideways + pull * pull <= largest_push * largest_push
    bank_error = math.atan2(-sideways, -pull) if pushing else math.atan2(sideways, pull)
    return Steering(
        clip(parameters.bank_gain * bank_error, -_FASTEST_ROLL, _FASTEST_ROLL),
        clip(pull, -largest_push, parameters.largest_load_factor),
    )


@kernel
def hold_speed(state: State | Observation, goal: Goal, parameters: PursuitParameters) -> float:
    """Throttle of the law: what carries the weight along the wanted path, and more where speed is missing."""
    full_thrust = maximum_thrust(state.speed, state.altitude, air_at(state.altitude, 1.0))
    weight_along_path = MASS * GRAVITY * math.sin(goal.path_angle)
    return clip(parameters.speed_gain * (goal.speed - state.speed) + weight_along_path / full_thrust, 0.0, 1.0)


@kernel
def pursuit_command(state: State | Observation, goal: Goal, parameters: PursuitParameters) -> GuidanceCommand:
    """What the law commands in one state, within the bounds of `GuidanceCommand`; what a learner sees is enough."""
    steering = steer(state, goal, parameters)
    return GuidanceCommand(steering.roll_rate, steering.load_factor, hold_speed(state, goal, parameters))


@kernel
def load_pursuit(rows: NDArray[np.float64], i: int, first: int) -> PursuitParameters:
    """The parameters that a row holds from column ``first`` on."""
    return PursuitParameters(
        rows[i, first],
        rows[i, first + 1],
        rows[i, first + 2],
        rows[i, first + 3],
        rows[i, first + 4],
        rows[i, first + 5],
        rows[i, first + 6],
        rows[i, first + 7],
    )


@entry_point
def _pursuit_rows(
    states: NDArray[np.float64],
    goals: NDArray[np.float64],
    parameter_row: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    parameters = load_pursuit(parameter_row.reshape(1, -1), 0, 0)
    for i in range(states.shape[0]):
        command = pursuit_command(load_state(states, i), load_goal(goals, i), parameters)
        out[i, 0] = command.roll_rate
        out[i, 1] = command.load_factor
        out[i, 2] = command.throttle


def pursuit_commands(
    states: NDArray[np.float64], goals: ArrayLike, parameters: PursuitParameters = PURSUIT
) -> NDArray[np.float64]:
    """The law's commands for N aircraft, each with its own goal.

    Args:
        states: shape (N, F), as `vvc_bench.sim.start` and `vvc_bench.sim.step_many` make it.
        goals: shape (N, 3): the components of `Goal` in SI units and radians.
        parameters: the law's figures.

    Returns:
        Shape (N, 3): the components of `GuidanceCommand`, for `vvc_bench.sim.step_many`.

    Raises:
        ValueError: for wrong shapes, goals outside of `Goal`'s bounds, or parameters that are not finite.
    """
    goals = np.ascontiguousarray(goals, dtype=np.float64)
    check_states_and_goals(states, goals)
    if not np.isfinite(parameters).all():
        raise ValueError(f"parameters must be finite, got {parameters}")
    commands = np.empty((len(states), len(GuidanceCommand._fields)))
    _pursuit_rows(states, goals, np.array(parameters, dtype=np.float64), commands)
    return commands
