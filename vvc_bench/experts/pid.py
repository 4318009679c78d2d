"""The guidance law of the paper's Appendix C: from a wanted velocity vector to roll rate, load factor and throttle.

The law has no memory. Its structure is Appendix C's; its figures are those that the paper's own expert shows from
outside (model.md, "Guidance expert (Appendix C)"), unless said otherwise. With Δμ = μ_c − μ, Δχ = χ_c − χ by the
shorter way round, V the speed and g = 9.81 m/s²:

- turn: n_yc = V cos μ · Δχ / (T_χ g), in the plane of the horizon;
- pull: n_zc,e = cos μ + V · Δμ / (T_μ g), in the vertical plane through the flight path;
- load factor: n_zc = √(n_yc² + n_zc,e²) with the sign of n_zc,e, limited by `load_factor_limit`;
- bank: tan φ_c = V · Δχ / (T_χ g), positive to the right. It does not look at the pull: the expert's bank is the same
  for a climb and for a level turn. (Taking tan φ_c = n_yc / n_zc,e, the direction of the vector that n_zc is the length
  of, reaches as many goals: 20.5 % of 2,000 against 20.4 %.)
- roll rate: p_c = ε / (1 s) with ε = φ_c − φ by the shorter way round, at most 150 deg/s, and 150 deg/s with the sign
  of ε while |ε − 0.1 s · p| ≥ 60°;
- throttle: 0.05 s/m · (v_c − v) + 0.002.

The throttle has no integrator, so a climb at `APPENDIX_C` settles too slow: 12 m/s short of 220 m/s at a path angle of
20°, as the paper's expert does. `WEIGHT_COMPENSATED` adds the throttle that carries the weight along the wanted path.
Of 2,000 goals drawn from 100 to 300 m/s, ±85° and ±170° (from 5000 m and 200 m/s, reference dynamics at 10 Hz, within
10 m/s and 3° for 10 steps in a row out of 400) `APPENDIX_C` reaches 20.4 % and `WEIGHT_COMPENSATED` 39.1 %.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.goals import check_goals
from vvc_bench.jit import entry_point, kernel
from vvc_bench.sim.aircraft import GRAVITY, MASS
from vvc_bench.sim.atmosphere import SEA_LEVEL_DENSITY, air_at
from vvc_bench.sim.fields import Goal, GuidanceCommand, Observation, State, degrees, fields_of
from vvc_bench.sim.interpolation import clip, linear, locate, make_axis
from vvc_bench.sim.propulsion import maximum_thrust
from vvc_bench.sim.rows import load_goal, load_state
from vvc_bench.sim.task import wrapped

# Measured on the paper's expert from 0 to 10 km and 80 to 400 m/s, it is a function of the equivalent airspeed alone,
# and gives all eight figures of model.md.
_LIMIT_AIRSPEED = make_axis([120.0, 200.0, 400.0], bin_width=40.0)
_LIMIT_LOAD_FACTOR = np.array([1.5, 5.0, 9.0])
_LEAST_LOAD_FACTOR = fields_of(GuidanceCommand)["load_factor"].low


class PidParameters(NamedTuple):
    """The law's figures, in SI units and radians; the defaults are `APPENDIX_C`."""

    azimuth_time_constant: float = 4.19
    """T_χ, s."""
    path_angle_time_constant: float = 1.79
    """T_μ, s."""
    bank_gain: float = 1.0
    """Roll rate for each radian of bank error, 1/s."""
    fast_roll_rate: float = degrees(150.0)
    """Largest command, and the one while the bank is far off, rad/s."""
    fast_roll_error: float = degrees(60.0)
    """How far off that is, rad."""
    roll_rate_lead: float = 0.1
    """How far ahead the roll is looked at for that, s."""
    speed_gain: float = 0.05
    """Throttle for each m/s that is missing, s/m."""
    throttle_bias: float = 0.002
    """Throttle at the wanted speed."""
    weight_compensation: float = 0.0
    """Share of the weight along the wanted path that the throttle carries, 0 to 1; not in Appendix C."""


APPENDIX_C = PidParameters()
"""The paper's expert."""

TABLE_1 = PidParameters(azimuth_time_constant=6.5, path_angle_time_constant=1.1)
"""The same law with two time constants fitted so that its flights match the first row of the paper's Table 1: measured
at small errors, the paper's expert turns and pulls as `APPENDIX_C`, at large ones it turns more slowly."""

WEIGHT_COMPENSATED = PidParameters(weight_compensation=1.0)
"""The same with a throttle that knows what a climb takes: it holds the speed in climbs and reaches more goals."""


@kernel
def load_factor_limit(airspeed: float, density: float) -> float:
    """Largest load factor that the expert asks for: 1.5 g below 120 m/s equivalent airspeed, 5 g at 200, 9 g at 400."""
    cell, fraction = locate(_LIMIT_AIRSPEED, airspeed * math.sqrt(density / SEA_LEVEL_DENSITY))
    return linear(_LIMIT_LOAD_FACTOR, cell, fraction)


@kernel
def pid_command(state: State | Observation, goal: Goal, parameters: PidParameters) -> GuidanceCommand:
    """What the law commands in one state, within the bounds of `GuidanceCommand`; what a learner sees is enough."""
    air = air_at(state.altitude, 1.0)
    turn_rate = wrapped(goal.azimuth - state.azimuth) / parameters.azimuth_time_constant
    path_rate = (goal.path_angle - state.path_angle) / parameters.path_angle_time_constant

    bank_error = wrapped(math.atan(state.speed * turn_rate / GRAVITY) - state.roll)
    roll_rate = clip(parameters.bank_gain * bank_error, -parameters.fast_roll_rate, parameters.fast_roll_rate)
    if abs(bank_error - parameters.roll_rate_lead * state.roll_rate) >= parameters.fast_roll_error:
        roll_rate = math.copysign(parameters.fast_roll_rate, bank_error)

    turn = state.speed * math.cos(state.path_angle) * turn_rate / GRAVITY
    pull = math.cos(state.path_angle) + state.speed * path_rate / GRAVITY
    limit = load_factor_limit(state.speed, air.density)
    load_factor = math.copysign(math.sqrt(turn * turn + pull * pull), pull)

    full_thrust = maximum_thrust(state.speed, state.altitude, air)
    weight_along_path = MASS * GRAVITY * math.sin(goal.path_angle)
    throttle = (
        parameters.speed_gain * (goal.speed - state.speed)
        + parameters.throttle_bias
        + parameters.weight_compensation * weight_along_path / full_thrust
    )
    return GuidanceCommand(
        roll_rate,
        clip(load_factor, max(-limit, _LEAST_LOAD_FACTOR), limit),
        clip(throttle, 0.0, 1.0),
    )


@kernel
def load_pid(rows: NDArray[np.float64], i: int) -> PidParameters:
    """The parameters that a row holds."""
    return PidParameters(
        rows[i, 0],
        rows[i, 1],
        rows[i, 2],
        rows[i, 3],
        rows[i, 4],
        rows[i, 5],
        rows[i, 6],
        rows[i, 7],
        rows[i, 8],
    )


@entry_point
def _pid_rows(
    states: NDArray[np.float64],
    goals: NDArray[np.float64],
    parameter_row: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    parameters = load_pid(parameter_row.reshape(1, -1), 0)
    for i in range(states.shape[0]):
        command = pid_command(load_state(states, i), load_goal(goals, i), parameters)
        out[i, 0] = command.roll_rate
        out[i, 1] = command.load_factor
        out[i, 2] = command.throttle


def pid_commands(
    states: NDArray[np.float64], goals: ArrayLike, parameters: PidParameters = APPENDIX_C
) -> NDArray[np.float64]:
    """The law's commands for N aircraft, each with its own goal.

    Args:
        states: shape (N, F), as `vvc_bench.sim.start` and `vvc_bench.sim.step_many` make it.
        goals: shape (N, 3): the components of `Goal` in SI units and radians.
        parameters: the law's figures.

    Returns:
        Shape (N, 3): the components of `GuidanceCommand`, for `vvc_bench.sim.step_many`.

    Raises:
        ValueError: for wrong shapes, goals outside of `Goal`'s bounds, parameters that are not finite, or a time
            constant that is not positive. A state that is not finite gets a command that is, of no use but harmless to
            the other aircraft.
    """
    goals = np.ascontiguousarray(goals, dtype=np.float64)
    check_states_and_goals(states, goals)
    _check(parameters)
    commands = np.empty((len(states), len(GuidanceCommand._fields)))
    _pid_rows(states, goals, np.array(parameters, dtype=np.float64), commands)
    return commands


def check_states_and_goals(states: NDArray[np.float64], goals: NDArray[np.float64]) -> None:
    """Refuse states and goals that do not fit together.

    Raises:
        ValueError: for wrong shapes, or goals outside of `Goal`'s bounds.
    """
    width, goal_width = len(State._fields), len(Goal._fields)
    if states.ndim != 2 or states.shape[1] < width or goals.shape != (len(states), goal_width):
        raise ValueError(
            f"for N aircraft, states must be (N, {width}) or wider and goals (N, {goal_width}): "
            f"{', '.join(Goal._fields)}; got states {states.shape} and goals {goals.shape}"
        )
    check_goals(goals)


def _check(parameters: PidParameters) -> None:
    if not np.isfinite(parameters).all():
        raise ValueError(f"parameters must be finite, got {parameters}")
    for name in ("azimuth_time_constant", "path_angle_time_constant"):
        if getattr(parameters, name) <= 0.0:
            raise ValueError(f"{name} must be positive, got {getattr(parameters, name)!r}")
