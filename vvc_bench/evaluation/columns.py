"""Columns of ``episodes.parquet``: names, types and meanings, once."""

from collections.abc import Mapping
from typing import NamedTuple

from vvc_bench import sim
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.sim.fields import SurfaceCommand, columns


class Column(NamedTuple):
    """One column."""

    dtype: str
    meaning: str


SEED, GOAL, CONDITION = "seed", "goal", "condition"
SUCCESS, TERMINATION, LENGTH, RETURN = "success", "termination", "length_steps", "return"
ERRORS = ("speed_error_mps", "path_angle_error_deg", "azimuth_error_deg", "direction_error_deg")
MINIMUM_ALTITUDE, MAXIMUM_LOAD, CLIPPED = "minimum_altitude_m", "maximum_load_factor_g", "clipped_commands"
TIME_RATIO, SEEN = "time_ratio", "seen"
SUB_GOALS_REACHED = "sub_goals_reached"

GOAL_OF_EPISODE = tuple(f"goal_{name}" for name in GOAL_COLUMNS)

_FIXED = {
    SEED: Column("int64", "of the evaluation"),
    GOAL: Column("int64", "index in the protocol"),
    CONDITION: Column("int64", "index of the conditions flown in, in the protocol"),
    **{name: Column("float64", "wanted") for name in GOAL_OF_EPISODE},
    SUCCESS: Column("bool", "the goal was reached"),
    TERMINATION: Column("string", "the event that ended the episode"),
    LENGTH: Column("int64", "steps flown"),
    RETURN: Column("float64", "sum of rewards"),
    "speed_error_mps": Column("float64", "absolute, as seen, mean over the last second"),
    "path_angle_error_deg": Column("float64", "absolute, as seen, mean over the last second"),
    "azimuth_error_deg": Column("float64", "absolute, as seen, mean over the last second"),
    "direction_error_deg": Column("float64", "angle between the velocity and the goal at the end"),
    MINIMUM_ALTITUDE: Column("float64", "lowest flown"),
    MAXIMUM_LOAD: Column("float64", "largest normal load factor flown"),
    CLIPPED: Column("int64", "components of actions beyond the bounds of the action space"),
    SUB_GOALS_REACHED: Column("int64", "goals reached one after another; 1 at most without sub-goals"),
    TIME_RATIO: Column("float64", "length over the shortest known one; none where none is known or it was not reached"),
}

ALWAYS = tuple(_FIXED)
"""Columns that every evaluation has."""


def at_bounds(command: str) -> str:
    """Share of the steps with a command at a bound of the action space."""
    return f"{command}_at_bounds_percent"


def travel(deflection: str) -> str:
    """Travel of a surface or the throttle for each second flown."""
    return f"{deflection}_travel_per_s"


def smoothness(measure: str, variable: str) -> str:
    """A measure of smoothness, s1 or s2, of a component of the action."""
    return f"{variable}_{measure}"


def episode_columns(settings: sim.Settings) -> Mapping[str, Column]:
    """All columns in order; commands are those of the control mode. `SEEN` is there only beside a training set."""
    commands = tuple(columns(settings.command_fields))
    return (
        _FIXED
        | {at_bounds(name): Column("float64", "steps with the command at a bound") for name in commands}
        | {travel(name): Column("float64", "absolute change for each second") for name in columns(SurfaceCommand)}
        | {
            smoothness(measure, name): Column("float64", f"smoothness of the command, the paper's eq. {equation}")
            for measure, equation in (("s1", 23), ("s2", 24))
            for name in commands
        }
    )
