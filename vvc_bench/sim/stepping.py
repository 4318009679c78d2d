"""One time step, for one aircraft and for many: the only two ways to fly.

`advance` is the single definition of a step. `step` runs it for one aircraft; `step_many` loads a row, runs it and
stores the row, for each row on its own, so that no result depends on the batch, its order or the threads.
"""

import functools
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.jit import entry_point, inlined, kernel
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.control_law import control_law
from vvc_bench.sim.dynamics import Body, Vector
from vvc_bench.sim.fields import (
    STILL,
    Conditions,
    GuidanceCommand,
    State,
    SurfaceCommand,
    field_array,
)
from vvc_bench.sim.gusts import GustState, gust_velocity, next_gust
from vvc_bench.sim.integrate import STAGES, euler_step, load_factors, runge_kutta_step
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.parallel import available_threads, for_each_chunk
from vvc_bench.sim.rows import load_conditions, load_state, store_state

ControlMode = Literal["guidance", "end_to_end"]
Dynamics = Literal["reference", "accurate"]

LOWEST_FREQUENCY_HZ = 1.0
HIGHEST_FREQUENCY_HZ = 100.0
ACCURATE_SUBSTEP = 0.01  # s; see docs/accurate-dynamics.md for the error that is left

SMALLEST_SHARE = 512
"""Force evaluations in a call below which another thread does not pay (benchmarks/threads.py)."""

_FIELDS = len(State._fields)
_CONDITIONS = len(Conditions._fields)


class Scheme(NamedTuple):
    """`Settings` as the kernels see it."""

    guidance: bool
    accurate: bool
    time_step: float
    """s"""
    substeps: int


@dataclass(frozen=True)
class Settings:
    """How to fly, the same for all aircraft of a call.

    Args:
        control_mode: ``"guidance"``: roll-rate, load-factor and throttle commands through the control law;
            ``"end_to_end"``: aileron, elevator, rudder and throttle.
        dynamics: ``"reference"``: as the paper's binaries, explicit Euler; ``"accurate"``: the same aircraft, fourth
            order in substeps of at most 0.01 s, without the reference's lag.
        frequency_hz: steps per second, 1 to 100.

    Raises:
        ValueError: for a choice outside of these.
    """

    control_mode: ControlMode = "guidance"
    dynamics: Dynamics = "reference"
    frequency_hz: float = 10.0

    def __post_init__(self) -> None:
        if self.control_mode not in get_args(ControlMode):
            raise ValueError(f"control_mode must be one of {get_args(ControlMode)}, got {self.control_mode!r}")
        if self.dynamics not in get_args(Dynamics):
            raise ValueError(f"dynamics must be one of {get_args(Dynamics)}, got {self.dynamics!r}")
        if not LOWEST_FREQUENCY_HZ <= self.frequency_hz <= HIGHEST_FREQUENCY_HZ:
            raise ValueError(
                f"frequency_hz must lie in [{LOWEST_FREQUENCY_HZ:g}, {HIGHEST_FREQUENCY_HZ:g}], "
                f"got {self.frequency_hz!r}"
            )

    @property
    def time_step(self) -> float:
        """Seconds from one state to the next."""
        return 1.0 / self.frequency_hz

    @property
    def command_fields(self) -> type[GuidanceCommand] | type[SurfaceCommand]:
        """The class that names the components of a command."""
        return GuidanceCommand if self.control_mode == "guidance" else SurfaceCommand

    @functools.cached_property
    def scheme(self) -> Scheme:
        """What the kernels are told."""
        accurate = self.dynamics == "accurate"
        substeps = math.ceil(self.time_step / ACCURATE_SUBSTEP - 1e-9) if accurate else 1
        return Scheme(self.control_mode == "guidance", accurate, self.time_step, substeps)

    @functools.cached_property
    def row(self) -> NDArray[np.float64]:
        """The same as an array: reading a tuple's fields on the way into a kernel takes 1 µs."""
        return np.array(self.scheme, dtype=np.float64)

    @functools.cached_property
    def command_width(self) -> int:
        """How many components a command has."""
        return len(self.command_fields._fields)


@kernel
def load_scheme(row: NDArray[np.float64]) -> Scheme:
    """The scheme that ``Settings.row`` holds."""
    return Scheme(row[0] != 0.0, row[1] != 0.0, row[2], int(row[3]))


_GUIDANCE_LOW, _GUIDANCE_HIGH = (field_array(GuidanceCommand, bound) for bound in ("low", "high"))
_SURFACE_LOW, _SURFACE_HIGH = (field_array(SurfaceCommand, bound) for bound in ("low", "high"))
STILL_ROW = np.array([STILL])
"""Conditions of the paper's world, as `make_conditions` gives them."""


@kernel
def _within(value: float, low: float, high: float) -> float:
    """1 if the value needs no clipping, else 0."""
    return 1.0 if low <= value <= high else 0.0


@inlined
def advance(
    state: State,
    first: float,
    second: float,
    third: float,
    fourth: float,
    scheme: Scheme,
    conditions: Conditions,
) -> State:
    """The state one time step later, under a command of three (guidance) or four (end to end) components."""
    air = air_at(state.altitude, 1.0 + conditions.density_offset)
    load_factor_integral, roll_rate_integral = state.load_factor_integral, state.roll_rate_integral
    if scheme.guidance:
        low, high = _GUIDANCE_LOW, _GUIDANCE_HIGH
        within = (
            1.0 + _within(first, low[0], high[0]) + _within(second, low[1], high[1]) + _within(third, low[2], high[2])
        )
        guidance = GuidanceCommand(
            clip(first, low[0], high[0]), clip(second, low[1], high[1]), clip(third, low[2], high[2])
        )
        law = control_law(state, guidance, air.density, scheme.time_step)
        command = law.command
        load_factor_integral, roll_rate_integral = law.load_factor_integral, law.roll_rate_integral
    else:
        low, high = _SURFACE_LOW, _SURFACE_HIGH
        within = (
            _within(first, low[0], high[0])
            + _within(second, low[1], high[1])
            + _within(third, low[2], high[2])
            + _within(fourth, low[3], high[3])
        )
        command = SurfaceCommand(
            clip(first, low[0], high[0]),
            clip(second, low[1], high[1]),
            clip(third, low[2], high[2]),
            clip(fourth, low[3], high[3]),
        )

    gust = GustState(
        state.gust_forward, state.gust_side, state.gust_side_lagged, state.gust_normal, state.gust_normal_lagged
    )
    if conditions.gust_intensity > 0.0:
        gust = next_gust(
            gust, state.airspeed, conditions.gust_intensity, conditions.seed, state.steps, scheme.time_step
        )

    body = Body(
        state.airspeed,
        state.angle_of_attack,
        state.sideslip,
        state.roll_rate,
        state.pitch_rate,
        state.yaw_rate,
        state.quaternion_w,
        state.quaternion_x,
        state.quaternion_y,
        state.quaternion_z,
        state.north,
        state.east,
        state.altitude,
    )
    controls = SurfaceCommand(state.aileron, state.elevator, state.rudder, state.throttle)
    old_over_ground = Vector(state.velocity_north, state.velocity_east, state.velocity_up)
    air_motion = gust_velocity(gust)
    if scheme.accurate:
        motion = runge_kutta_step(body, controls, command, air_motion, conditions, scheme.time_step, scheme.substeps)
    else:
        velocity = Vector(state.forward_velocity, state.side_velocity, state.normal_velocity)
        motion = euler_step(
            body, velocity, old_over_ground, air, controls, command, air_motion, conditions, scheme.time_step
        )
    path = motion.ground_velocity if scheme.accurate else old_over_ground  # the reference reports it one step late
    return describe(
        motion.body,
        motion.air_velocity,
        motion.ground_velocity,
        path,
        load_factors(motion.load, conditions),
        motion.controls,
        motion.load.thrust,
        conditions,
        load_factor_integral,
        roll_rate_integral,
        gust,
        state.steps + 1.0,
        state.clipped_commands + (4.0 - within),
    )


@kernel
def describe(
    body: Body,
    velocity: Vector,
    over_ground: Vector,
    path: Vector,
    load_factor: Vector,
    controls: SurfaceCommand,
    thrust: float,
    conditions: Conditions,
    load_factor_integral: float,
    roll_rate_integral: float,
    gust: GustState,
    steps: float,
    clipped_commands: float,
) -> State:
    """Put a `State` together: attitude angles from the normalised quaternion, flight path from ``path``."""
    w, x, y, z = body.quaternion_w, body.quaternion_x, body.quaternion_y, body.quaternion_z
    squared_length = max(w * w + x * x + y * y + z * z, 1e-12)
    speed = body.airspeed
    if conditions.wind_north != 0.0 or conditions.wind_east != 0.0 or conditions.wind_up != 0.0:
        speed = math.sqrt(over_ground.x * over_ground.x + over_ground.y * over_ground.y + over_ground.z * over_ground.z)
    return State(
        airspeed=body.airspeed,
        angle_of_attack=body.angle_of_attack,
        sideslip=body.sideslip,
        roll_rate=body.roll_rate,
        pitch_rate=body.pitch_rate,
        yaw_rate=body.yaw_rate,
        quaternion_w=body.quaternion_w,
        quaternion_x=body.quaternion_x,
        quaternion_y=body.quaternion_y,
        quaternion_z=body.quaternion_z,
        north=body.north,
        east=body.east,
        altitude=body.altitude,
        forward_velocity=velocity.x,
        side_velocity=velocity.y,
        normal_velocity=velocity.z,
        velocity_north=over_ground.x,
        velocity_east=over_ground.y,
        velocity_up=over_ground.z,
        roll=math.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z),
        pitch=math.asin(clip(2.0 * (w * y - x * z) / squared_length, -1.0, 1.0)),
        yaw=math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z),
        speed=speed,
        path_angle=math.asin(clip(path.z / max(speed, 1e-6), -1.0, 1.0)),
        azimuth=math.atan2(path.y, path.x),
        load_factor_x=load_factor.x,
        load_factor_y=load_factor.y,
        load_factor=load_factor.z,
        aileron=controls.aileron,
        elevator=controls.elevator,
        rudder=controls.rudder,
        throttle=controls.throttle,
        thrust=thrust,
        load_factor_integral=load_factor_integral,
        roll_rate_integral=roll_rate_integral,
        gust_forward=gust.gust_forward,
        gust_side=gust.gust_side,
        gust_side_lagged=gust.gust_side_lagged,
        gust_normal=gust.gust_normal,
        gust_normal_lagged=gust.gust_normal_lagged,
        steps=steps,
        clipped_commands=clipped_commands,
    )


@inlined
def advance_row(
    rows: NDArray[np.float64],
    commands: NDArray[np.float64],
    conditions: Conditions,
    scheme: Scheme,
    out: NDArray[np.float64],
    i: int,
) -> State:
    """Load, step, store row i, and return its new state; ``out`` may be ``rows``.

    Behind the state's fields a row may hold a ring of commands still on their way.
    """
    state = load_state(rows, i)
    width = commands.shape[1]
    first, second, third = commands[i, 0], commands[i, 1], commands[i, 2]
    fourth = commands[i, 3] if width > 3 else 0.0
    ring = (rows.shape[1] - _FIELDS) // width
    if ring > 0:
        slot = _FIELDS + width * (int(state.steps) % ring)
        due = _FIELDS + width * ((int(state.steps) - int(conditions.delay_steps)) % ring)
        if conditions.delay_steps > 0.0:
            first, second, third = rows[i, due], rows[i, due + 1], rows[i, due + 2]
            fourth = rows[i, due + 3] if width > 3 else 0.0
        for k in range(_FIELDS, rows.shape[1]):
            out[i, k] = rows[i, k]
        for k in range(width):
            out[i, slot + k] = commands[i, k]
    state = advance(state, first, second, third, fourth, scheme, conditions)
    store_state(state, out, i)
    return state


@entry_point
def _step_rows(
    rows: NDArray[np.float64],
    commands: NDArray[np.float64],
    conditions: NDArray[np.float64],
    scheme_row: NDArray[np.float64],
    out: NDArray[np.float64],
    start: int,
    stop: int,
) -> bool:
    """Step rows start ≤ i < stop; False, with nothing written, if a command of theirs is NaN.

    ``conditions`` has one row for all, or one for each.
    """
    for i in range(start, stop):
        for k in range(commands.shape[1]):
            if math.isnan(commands[i, k]):
                return False
    scheme = load_scheme(scheme_row)
    shared = conditions.shape[0] == 1
    for i in range(start, stop):
        advance_row(rows, commands, load_conditions(conditions, 0 if shared else i), scheme, out, i)
    return True


def step(
    state: NDArray[np.float64],
    command: ArrayLike,
    settings: Settings,
    conditions: NDArray[np.float64] = STILL_ROW,
    *,
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Fly one aircraft for one time step.

    Args:
        state: one row, as `vvc_bench.sim.start` makes it.
        command: the components of ``settings.command_fields``, in their order, in SI units and radians. Components
            outside their bounds are clipped, and counted in the state.
        settings: how to fly.
        conditions: one row from `make_conditions`, shape (1, C).
        out: where to write, ``state`` itself allowed; a new array by default.

    Returns:
        The row one time step later.

    Raises:
        ValueError: for wrong shapes or a command with NaN; the state is then as it was.
    """
    out = np.empty(state.shape) if out is None else out
    rows, commands = _plain(state)[None], _plain(command)[None]
    _check_shapes(rows, commands, conditions, settings, out[None])
    if not _step_rows(rows, commands, _plain(conditions), settings.row, out[None], 0, 1):
        raise _nan_command(commands, settings)
    return out


def step_many(
    states: NDArray[np.float64],
    commands: ArrayLike,
    settings: Settings,
    conditions: NDArray[np.float64] = STILL_ROW,
    *,
    out: NDArray[np.float64] | None = None,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Fly N aircraft for one time step, each as `step` would, on all cores.

    Args:
        states: shape (N, F), as `vvc_bench.sim.start` makes it.
        commands: shape (N, 3) or (N, 4).
        settings: how to fly.
        conditions: from `make_conditions`, shape (1, C) for all alike or (N, C).
        out: where to write, ``states`` itself allowed; a new array by default.
        threads: at most this many threads; by default `vvc_bench.sim.parallel.available_threads`.

    Returns:
        The rows one time step later.

    Raises:
        ValueError: for wrong shapes or a command with NaN; the states are then as they were.
    """
    states, commands, conditions = _plain(states), _plain(commands), _plain(conditions)
    out = np.empty(states.shape) if out is None else out
    _check_shapes(states, commands, conditions, settings, out)
    if np.isnan(commands).any():
        raise _nan_command(commands, settings)

    def work(start: int, stop: int) -> None:
        _step_rows(states, commands, conditions, settings.row, out, start, stop)

    for_each_chunk(work, len(states), threads or available_threads(), smallest_share(settings))
    return out


def smallest_share(settings: Settings) -> int:
    """Aircraft below which another thread does not pay."""
    evaluations = settings.scheme.substeps * (STAGES if settings.scheme.accurate else 1)
    return max(1, SMALLEST_SHARE // evaluations)


def _plain(values: ArrayLike) -> NDArray[np.float64]:
    """The kind of array that the kernel is compiled for: another kind, as a read-only one, would compile it anew."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    return array if array.flags.writeable else array.copy()


def _check_shapes(
    states: NDArray[np.float64],
    commands: NDArray[np.float64],
    conditions: NDArray[np.float64],
    settings: Settings,
    out: NDArray[np.float64],
) -> None:
    count = len(states)
    if (
        commands.shape == (count, settings.command_width)
        and states.ndim == 2
        and states.shape[1] >= _FIELDS
        and out.shape == states.shape
        and len(conditions) in (1, count)
        and conditions.shape[1:] == (_CONDITIONS,)
    ):
        return
    names = settings.command_fields._fields
    raise ValueError(
        f"for N aircraft, states and out must be (N, {_FIELDS}) or wider, commands (N, {len(names)}): "
        f"{', '.join(names)}, and conditions (1 or N, {_CONDITIONS}); "
        f"got states {states.shape}, out {out.shape}, commands {commands.shape}, conditions {conditions.shape}"
    )


def _nan_command(commands: NDArray[np.float64], settings: Settings) -> ValueError:
    aircraft, component = np.argwhere(np.isnan(commands))[0]
    name = settings.command_fields._fields[component]
    return ValueError(f"command {name!r} of aircraft {aircraft} is NaN; commands must be numbers")
