"""Flights for Tacview: its ACMI text format 2.2 (https://www.tacview.net/documentation/acmi/en/).

The simulator's ground is flat; Tacview wants longitude and latitude. North and east are laid on a sphere of the Earth's
equatorial radius, the one that Tacview computes with, as arcs from 0° N, 0° E. That point lies in the Gulf of Guinea:
sea level is the ground there, as in the simulator, and a degree of longitude is as long as one of latitude. Over 100 km
the distances are off by less than 1 in 10,000. The flat coordinates and the heading over them go with every position.
"""

import math
from collections.abc import Iterator

from vvc_bench.flight.goal import time_to_reach, wanted
from vvc_bench.flight.recording import Flight
from vvc_bench.sim import State
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.fields import Goal
from vvc_bench.sim.units import DEGREES_PER_RADIAN
from vvc_bench.version import __version__

EARTH_RADIUS = 6378137.0  # m, WGS 84, semi-major axis
REFERENCE_LATITUDE_DEG = 0.0
REFERENCE_LONGITUDE_DEG = 0.0
REFERENCE_TIME = "2000-01-01T12:00:00Z"
"""An arbitrary noon: a flight has no date, and the same flight gives the same file."""

AIRCRAFT = "101"
GOAL_MARKER = "102"
"""Object numbers, hexadecimal."""

_MARKER_DISTANCE = 2000.0  # m ahead of the aircraft, where the wanted velocity points


def acmi_text(flight: Flight) -> str:
    """A flight as the text of an ``.acmi`` file.

    The aircraft has its position, attitude, true airspeed, Mach number, angles of attack and sideslip, normal load
    factor and throttle at every step. If the flight has a goal, a waypoint 2 km away shows where its velocity vector
    points, and the aircraft is locked on it, which Tacview draws as a line; a bookmark says when the goal was reached.
    """
    return "\n".join(_lines(flight)) + "\n"


def geographic(north: float, east: float) -> tuple[float, float]:
    """Longitude and latitude in degrees of a point so many metres north and east of the reference point."""
    parallel = EARTH_RADIUS * math.cos(REFERENCE_LATITUDE_DEG / DEGREES_PER_RADIAN)
    return (
        REFERENCE_LONGITUDE_DEG + math.degrees(east / parallel),
        REFERENCE_LATITUDE_DEG + math.degrees(north / EARTH_RADIUS),
    )


def _lines(flight: Flight) -> Iterator[str]:
    settings = flight.settings
    yield "FileType=text/acmi/tacview"
    yield "FileVersion=2.2"
    yield f"0,ReferenceTime={REFERENCE_TIME}"
    yield f"0,DataSource=vvc-bench {__version__}"
    yield f"0,Title={_escaped(_title(flight))}"
    yield f"0,Comments={_escaped(f'{settings.dynamics} dynamics at {settings.frequency_hz:g} Hz')}"
    goal = None if flight.goal is None else wanted(flight)
    reached = math.inf if goal is None else time_to_reach(flight)
    for time, row in zip(flight.time, flight.states, strict=True):
        state = State(*row[: len(State._fields)])
        yield f"#{time:.4f}"
        yield f"{AIRCRAFT},{_aircraft(state)}"
        if goal is not None:
            yield f"{GOAL_MARKER},{_marker(state, goal)}"
        if time == 0.0:
            yield from _declarations(goal)
        if time == reached:
            yield f"0,Event=Bookmark|{AIRCRAFT}|Goal reached"


def _declarations(goal: Goal | None) -> Iterator[str]:
    """What is said of each object once."""
    yield f"{AIRCRAFT},Type=Air+FixedWing,Name=F-16,CallSign=vvc-bench,Color=Blue"
    if goal is not None:
        yield f"{GOAL_MARKER},Type=Navaid+Static+Waypoint,Name=Goal,Color=Orange"
        yield f"{AIRCRAFT},LockedTargetMode=1,LockedTarget={GOAL_MARKER}"


def _aircraft(state: State) -> str:
    longitude, latitude = geographic(state.north, state.east)
    yaw = state.yaw * DEGREES_PER_RADIAN
    mach = state.airspeed / air_at(state.altitude, 1.0).sound_speed
    place = (
        *(f"{longitude:.8f}", f"{latitude:.8f}", f"{state.altitude:.3f}"),
        *(f"{angle * DEGREES_PER_RADIAN:.3f}" for angle in (state.roll, state.pitch, state.yaw)),
        *(f"{state.east:.3f}", f"{state.north:.3f}", f"{yaw:.3f}"),
    )
    return (
        f"T={'|'.join(place)},TAS={state.airspeed:.3f},Mach={mach:.4f},"
        f"AOA={state.angle_of_attack * DEGREES_PER_RADIAN:.3f},AOS={state.sideslip * DEGREES_PER_RADIAN:.3f},"
        f"VerticalGForce={state.load_factor:.3f},Throttle={state.throttle:.4f}"
    )


def _marker(state: State, goal: Goal) -> str:
    level = _MARKER_DISTANCE * math.cos(goal.path_angle)
    north, east = state.north + level * math.cos(goal.azimuth), state.east + level * math.sin(goal.azimuth)
    altitude = state.altitude + _MARKER_DISTANCE * math.sin(goal.path_angle)
    longitude, latitude = geographic(north, east)
    return f"T={longitude:.8f}|{latitude:.8f}|{altitude:.3f}|{east:.3f}|{north:.3f}"


def _title(flight: Flight) -> str:
    if flight.goal is None:
        return "vvc-bench flight"
    speed, path_angle, azimuth = flight.goal
    return (
        f"Goal {speed:g} m/s, path angle {path_angle * DEGREES_PER_RADIAN:g}°, "
        f"azimuth {azimuth * DEGREES_PER_RADIAN:g}°"
    )


def _escaped(text: str) -> str:
    """Commas separate properties; the format wants those within a text escaped."""
    return text.replace("\\", "\\\\").replace(",", "\\,")
