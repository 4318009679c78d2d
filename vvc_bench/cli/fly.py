"""``vvc-bench fly``: one flight to a goal under a guidance law, summed up and written to files."""

import argparse
import functools
import math
import sys
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.experts import APPENDIX_C, PURSUIT, WEIGHT_COMPENSATED, pid_commands, pursuit_commands
from vvc_bench.flight import (
    Flight,
    available_formats,
    find_format,
    fly,
    goal_errors,
    time_to_reach,
    write_flight,
)
from vvc_bench.flight.goal import DEFAULT_TASK
from vvc_bench.goals import check_goals
from vvc_bench.jit import COMPILED, cache_folder
from vvc_bench.sim.fields import Goal
from vvc_bench.sim.starting import DEFAULT_ALTITUDE_M, DEFAULT_SPEED_MPS
from vvc_bench.sim.units import COUNT, DEGREES_PER_RADIAN

EXPERTS = {
    "weight-compensated": functools.partial(pid_commands, parameters=WEIGHT_COMPENSATED),
    "appendix-c": functools.partial(pid_commands, parameters=APPENDIX_C),
    "pursuit": functools.partial(pursuit_commands, parameters=PURSUIT),
}
LONGEST_FLIGHT_SECONDS = 3600.0
_START = ("altitude_m", "speed_mps", "heading_deg")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    parser.add_argument(
        "--goal",
        required=True,
        type=_goal,
        metavar="SPEED,PATH_ANGLE,AZIMUTH",
        help=f"wanted velocity vector: {', '.join(sim.columns(Goal))}, as in 220,20,-60",
    )
    parser.add_argument("--altitude-m", type=float, default=DEFAULT_ALTITUDE_M, help=_default("where it starts"))
    parser.add_argument("--speed-mps", type=float, default=DEFAULT_SPEED_MPS, help=_default("true airspeed there"))
    parser.add_argument("--heading-deg", type=float, default=0.0, help=_default("0 is north, 90 east"))
    parser.add_argument(
        "--seconds", type=_seconds, default=40.0, help=_default("how long; a flight ends early at the ground")
    )
    parser.add_argument("--frequency-hz", type=float, default=10.0, help=_default("time steps per second"))
    parser.add_argument(
        "--dynamics", choices=get_args(sim.Dynamics), default="reference", help=_default("equations of motion")
    )
    parser.add_argument(
        "--expert",
        choices=list(EXPERTS),
        default="weight-compensated",
        help=_default(
            "guidance law: as in Appendix C, whose throttle lets a climb settle too slow, with the throttle that the "
            "weight takes, or bank-to-turn pursuit"
        ),
    )
    parser.add_argument(
        "--output", type=Path, default=Path("flights"), metavar="FOLDER", help=_default("where the files go")
    )
    parser.add_argument(
        "--format",
        type=_formats,
        default=available_formats(),
        metavar="FORMATS",
        help=f"which files, separated by commas (default: {','.join(available_formats())})",
    )
    conditions = parser.add_argument_group("conditions", "what the paper leaves out; all zero by default")
    for name, field in sim.columns(sim.Conditions).items():
        conditions.add_argument(
            _option(name), type=int if field.unit is COUNT else float, default=0, metavar="X", help=field.meaning
        )


def run(options: argparse.Namespace) -> int:
    """Fly, print, write.

    Raises:
        ValueError: for a start without trim, or a value out of bounds.
        OSError: if the folder cannot be written to.
    """
    settings = sim.Settings(dynamics=options.dynamics, frequency_hz=options.frequency_hz)
    conditions = sim.make_conditions(**{name: getattr(options, name) for name in sim.columns(sim.Conditions)})
    options.output.mkdir(parents=True, exist_ok=True)
    _announce_compilation()
    state = sim.start(settings, conditions=conditions, **{name: getattr(options, name) for name in _START})
    goal: NDArray[np.float64] = options.goal
    commands = EXPERTS[options.expert]
    flight = fly(
        settings,
        state,
        lambda row: commands(row[None], goal[None])[0],
        options.seconds,
        goal=goal,
        conditions=conditions,
        stop=_is_below_ground,
    )
    stem = "_".join(["goal", *(f"{value:g}" for value in _outside(goal))])
    written = [write_flight(flight, options.output / f"{stem}.{name}") for name in options.format]
    print(_summary(flight, written, options.seconds))
    return 0


def _default(text: str) -> str:
    return f"{text} (default: %(default)s)"


def _option(column: str) -> str:
    return "--" + column.replace("_", "-")


def _goal(text: str) -> NDArray[np.float64]:
    """Three numbers in outside units as a goal in inside units."""
    scales = np.array([field.unit.scale for field in sim.columns(Goal).values()])
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != scales.shape:
        raise argparse.ArgumentTypeError(
            f"a goal is three numbers, {','.join(sim.columns(Goal))}, as in 220,20,-60; got {text!r}"
        )
    goal: NDArray[np.float64] = values / scales
    try:
        check_goals(goal)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return goal


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds <= LONGEST_FLIGHT_SECONDS:
        raise argparse.ArgumentTypeError(
            f"a flight lasts more than 0 and at most {LONGEST_FLIGHT_SECONDS:g} seconds, got {text!r}"
        )
    return seconds


def _formats(text: str) -> list[str]:
    names = [name.strip().lower() for name in text.split(",")]
    for name in names:
        try:
            find_format(name)
        except (ValueError, ImportError) as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    return list(dict.fromkeys(names))


def _announce_compilation() -> None:
    if COMPILED and sys.stderr.isatty() and not any(cache_folder().rglob("*.nbi")):
        print("compiling the simulator, once for this version: about 20 s", file=sys.stderr)


def _is_below_ground(row: NDArray[np.float64]) -> bool:
    return bool(row[sim.State._fields.index("altitude")] < 0.0)


def _outside(goal: NDArray[np.float64]) -> list[float]:
    """The components of a goal, or of the errors to it, in outside units, as they were typed."""
    scales = [field.unit.scale for field in sim.columns(Goal).values()]
    return [float(f"{value * scale:.9g}") for value, scale in zip(goal, scales, strict=True)]


def _summary(flight: Flight, written: list[Path], seconds: float) -> str:
    """What happened, in a few lines."""
    assert flight.goal is not None
    load_factor, altitude = np.asarray(flight.history.load_factor), np.asarray(flight.history.altitude)
    largest, lowest = int(np.abs(load_factor).argmax()), int(altitude.argmin())
    speed, path_angle, azimuth = _outside(flight.goal)
    speed_off, path_angle_off, azimuth_off = _outside(
        np.array([error[-1] for error in map(np.asarray, goal_errors(flight))])
    )
    how = f"{flight.settings.dynamics} dynamics at {flight.settings.frequency_hz:g} Hz{_ending(flight, seconds)}"
    lines = {
        "goal": f"{speed:g} m/s, path angle {path_angle:g}°, azimuth {azimuth:g}°",
        "flown": f"{flight.time[-1]:g} s, {how}",
        "reached": _verdict(flight),
        "final errors": f"speed {speed_off:+.1f} m/s, path angle {path_angle_off:+.2f}°, azimuth {azimuth_off:+.2f}°",
        "load factor": f"largest {load_factor[largest]:.2f} g, after {flight.time[largest]:g} s",
        "altitude": f"least {altitude[lowest]:.0f} m, after {flight.time[lowest]:g} s",
        "written": f"\n{'':14}".join(str(path) for path in written),
    }
    return "\n".join(f"{name:14}{text}" for name, text in lines.items())


def _ending(flight: Flight, seconds: float) -> str:
    """Why a flight was shorter than asked for."""
    if _is_below_ground(flight.states[-1]):
        return ", into the ground"
    is_short = flight.time[-1] < seconds - flight.settings.time_step
    return ", until the simulation diverged" if is_short else ""


def _verdict(flight: Flight) -> str:
    task = DEFAULT_TASK
    direction_deg = task.direction_band * DEGREES_PER_RADIAN
    criterion = f"within {task.speed_band:g} m/s and {direction_deg:g}° for {task.reach_steps:g} steps in a row"
    reached = time_to_reach(flight)
    return f"after {reached:g} s: {criterion}" if math.isfinite(reached) else f"no: not {criterion}"
