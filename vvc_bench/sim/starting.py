"""Where flights begin: in trim, or in any state; and the conditions they are flown in.

What people type carries its unit: metres, metres per second, degrees. What comes out are rows for `step` and
`step_many`.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.jit import entry_point, kernel
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.dynamics import Body, air_velocity, ground_velocity, loads
from vvc_bench.sim.fields import Conditions, State, SurfaceCommand, checked_inside, columns
from vvc_bench.sim.gusts import GustState, gust_velocity
from vvc_bench.sim.integrate import load_factors
from vvc_bench.sim.rows import load_conditions, load_state, store_state
from vvc_bench.sim.stepping import STILL_ROW, Settings, describe
from vvc_bench.sim.trim import Trim, trim_rows

DEFAULT_ALTITUDE_M = 5000.0
DEFAULT_SPEED_MPS = 200.0
"""The paper's start (its Table 5): level flight, due north."""

_SETTABLE = (
    *("airspeed_mps", "angle_of_attack_deg", "sideslip_deg", "roll_rate_degps", "pitch_rate_degps", "yaw_rate_degps"),
    *("roll_deg", "pitch_deg", "yaw_deg", "north_m", "east_m", "altitude_m"),
    *("aileron_deg", "elevator_deg", "rudder_deg", "throttle"),
)


def make_conditions(**values: ArrayLike) -> NDArray[np.float64]:
    """Wind, gusts, offsets, actuators and delay, by column name with its unit; what is left out is zero.

    Each value is a number for all aircraft, or an array of N, as in
    ``make_conditions(wind_north_mps=10, gust_intensity_mps=2, seed=range(8))``.

    Returns:
        Shape (1, C), or (N, C) if any value is an array.

    Raises:
        ValueError: for an unknown name, a value that is not finite or out of bounds, or lengths that differ.
    """
    known = columns(Conditions)
    rows = _broadcast(values, known, "condition")
    table = np.zeros((len(rows), len(known)))
    for k, (name, field) in enumerate(known.items()):
        if name in values:
            table[:, k] = checked_inside(name, field, rows[:, list(values).index(name)])
    return table


def start(
    settings: Settings,
    *,
    altitude_m: ArrayLike = DEFAULT_ALTITUDE_M,
    speed_mps: ArrayLike = DEFAULT_SPEED_MPS,
    heading_deg: ArrayLike = 0.0,
    conditions: NDArray[np.float64] = STILL_ROW,
) -> NDArray[np.float64]:
    """Begin in trimmed, level flight.

    Args:
        settings: how it will be flown.
        altitude_m: altitude.
        speed_mps: true airspeed.
        heading_deg: course through the air, 0 north, 90 east.
        conditions: the ones that will be flown in; density and mass offsets change the trim.

    Returns:
        One row of shape (F,) if all of these are single values, else (N, F).

    Raises:
        ValueError: if there is no trim (the message says where and why), or a value is not finite.
    """
    wanted = {"altitude_m": altitude_m, "speed_mps": speed_mps, "heading_deg": heading_deg}
    rows = _broadcast(wanted, wanted, "start value", len(conditions))
    altitude, speed, heading = (np.ascontiguousarray(column) for column in rows.T)
    each = np.broadcast_to(conditions, (len(rows), conditions.shape[1]))
    density_factor = 1.0 + each[:, Conditions._fields.index("density_offset")]
    mass_factor = 1.0 + each[:, Conditions._fields.index("mass_offset")]
    solved = np.empty((len(rows), len(Trim._fields)))
    trim_rows(altitude, speed, density_factor, mass_factor, solved)
    _require_trim(altitude, speed, Trim(*solved.T))
    pitch = solved[:, 0]
    flight = {
        "airspeed": speed,
        "angle_of_attack": pitch,
        "pitch": pitch,
        "yaw": heading / columns(State)["yaw_deg"].unit.scale,
        "altitude": altitude,
        "elevator": solved[:, 1],
        "throttle": solved[:, 2],
    }
    states = _complete(flight, len(rows), settings, conditions)
    return states[0] if _all_single(wanted, conditions) else states


def start_from(
    settings: Settings, *, conditions: NDArray[np.float64] = STILL_ROW, **values: ArrayLike
) -> NDArray[np.float64]:
    """Begin anywhere, with the control law's integrators empty.

    Args:
        settings: how it will be flown.
        conditions: the ones that will be flown in.
        **values: any of airspeed_mps, angle_of_attack_deg, sideslip_deg, roll_rate_degps, pitch_rate_degps,
            yaw_rate_degps, roll_deg, pitch_deg, yaw_deg, north_m, east_m, altitude_m, aileron_deg, elevator_deg,
            rudder_deg and throttle; single values or arrays of N. What is left out is zero; the airspeed may not be.

    Returns:
        One row of shape (F,) if all values are single, else (N, F).

    Raises:
        ValueError: for an unknown name, a value that is not finite, an airspeed that is not positive, or lengths that
            differ.
    """
    known = columns(State)
    rows = _broadcast(values, _SETTABLE, "state", len(conditions))
    names = {column: name for column, name in zip(known, State._fields, strict=True) if column in values}
    flight = {names[column]: rows[:, k] / known[column].unit.scale for k, column in enumerate(values)}
    if "airspeed" not in flight or not (flight["airspeed"] > 0.0).all():
        raise ValueError(f"airspeed_mps must be given and positive, got {values.get('airspeed_mps')!r}")
    states = _complete(flight, len(rows), settings, conditions)
    return states[0] if _all_single(values, conditions) else states


def _broadcast(values: dict[str, ArrayLike], known: Iterable[str], what: str, count: int = 1) -> NDArray[np.float64]:
    """Named single values and arrays as one finite table with a column each, and at least ``count`` rows."""
    unknown = set(values) - set(known)
    if unknown:
        raise ValueError(f"unknown {what} {min(unknown)!r}; known are {', '.join(known)}")
    arrays = {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}
    for name, array in arrays.items():
        if array.ndim > 1 or not np.isfinite(array).all():
            raise ValueError(f"{name} must be a finite number or a one-dimensional array of them, got {values[name]!r}")
    lengths = {array.size for array in arrays.values() if array.ndim == 1} | ({count} if count > 1 else set())
    if len(lengths) > 1:
        raise ValueError(f"{what} arrays must have one length, got {sorted(lengths)}")
    length = lengths.pop() if lengths else 1
    return np.stack([np.broadcast_to(a, length) for a in arrays.values()], axis=-1) if arrays else np.zeros((length, 0))


def _all_single(values: dict[str, ArrayLike], conditions: NDArray[np.float64]) -> bool:
    return len(conditions) == 1 and all(np.ndim(value) == 0 for value in values.values())


def _require_trim(altitude: NDArray[np.float64], speed: NDArray[np.float64], solved: Trim) -> None:
    throttle = np.asarray(solved.throttle)
    bad = ~((throttle >= 0.0) & (throttle <= 1.0))
    if not bad.any():
        return
    i = int(np.flatnonzero(bad)[0])
    if math.isnan(throttle[i]):
        reason = "no angle of attack carries the weight with a balanced pitching moment"
    elif throttle[i] > 1.0:
        reason = f"it would take {100 * throttle[i]:.0f} % of full thrust"
    else:
        reason = "drag is less than idle thrust there"
    raise ValueError(
        f"no trim at {altitude[i]:g} m and {speed[i]:g} m/s: {reason}; choose another altitude or speed, "
        "or give a full state with start_from"
    )


def _complete(
    flight: dict[str, NDArray[np.float64]], count: int, settings: Settings, conditions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rows whose other fields follow from the given ones, with commands that hold the start in the delay ring."""
    width = settings.command_width
    ring = int(conditions[:, Conditions._fields.index("delay_steps")].max())
    rows = np.zeros((count, len(State._fields) + ring * width))
    for name, values in flight.items():
        rows[:, State._fields.index(name)] = values
    _complete_rows(rows, conditions)
    if ring:
        state = State(*rows[:, : len(State._fields)].T)
        zero = np.zeros(count)
        if settings.scheme.guidance:
            hold = np.stack([zero, state.load_factor, state.throttle], axis=-1)
        else:
            hold = np.stack([state.aileron, state.elevator, state.rudder, state.throttle], axis=-1)
        rows[:, len(State._fields) :] = np.tile(hold, ring)
    return rows


@entry_point
def _complete_rows(rows: NDArray[np.float64], conditions: NDArray[np.float64]) -> None:
    for i in range(rows.shape[0]):
        given = load_state(rows, i)
        store_state(_complete_state(given, load_conditions(conditions, i if conditions.shape[0] > 1 else 0)), rows, i)


@kernel
def _complete_state(given: State, conditions: Conditions) -> State:
    """Quaternion, velocities, flight path and load factors of a state given by its angles."""
    cr, sr = math.cos(0.5 * given.roll), math.sin(0.5 * given.roll)
    cp, sp = math.cos(0.5 * given.pitch), math.sin(0.5 * given.pitch)
    cy, sy = math.cos(0.5 * given.yaw), math.sin(0.5 * given.yaw)
    body = Body(
        given.airspeed,
        given.angle_of_attack,
        given.sideslip,
        given.roll_rate,
        given.pitch_rate,
        given.yaw_rate,
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        given.north,
        given.east,
        given.altitude,
    )
    velocity = air_velocity(body)
    over_ground = ground_velocity(body, velocity, conditions)
    controls = SurfaceCommand(given.aileron, given.elevator, given.rudder, given.throttle)
    still = GustState(0.0, 0.0, 0.0, 0.0, 0.0)
    air = air_at(body.altitude, 1.0 + conditions.density_offset)
    load = loads(body, velocity, controls, gust_velocity(still), False, air)
    return describe(
        body,
        velocity,
        over_ground,
        over_ground,
        load_factors(load, conditions),
        controls,
        load.thrust,
        conditions,
        0.0,
        0.0,
        still,
        0.0,
        0.0,
    )
