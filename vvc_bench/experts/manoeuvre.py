"""Staged manoeuvres: fly somewhere else first, then after the goal.

Dive and pull up, climb and roll off, turn the long way round: each is one or two preparations, a direction that is
pursued for a while with a throttle and a load factor of its own, before the pursuit of the goal itself, or of a point
beside it inside the bands. A manoeuvre is a plan, not a policy: it counts steps, and it minds two terminations of the
task, moving away from the goal for long and negative load while banked for long, by a moment of the opposite.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.pursuit import PURSUIT, PursuitParameters, hold_speed, load_pursuit, steer
from vvc_bench.jit import kernel
from vvc_bench.sim.fields import MIRRORED, Goal, GuidanceCommand, Observation
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.task import wrapped


class Preparation(NamedTuple):
    """A direction to fly in first, in SI units and radians."""

    duration: float = 0.0
    """s; 0 leaves it out."""
    path_angle: float = 0.0
    azimuth: float = 0.0
    load_factor: float = 9.0
    """Largest, g."""
    throttle: float = 1.0


class Caution(NamedTuple):
    """How long to let the task's counters run."""

    moving_away_steps: float = 15.0
    """Steps of growing direction error after which the goal itself is pursued, until the error shrinks."""
    negative_load_steps: float = 14.0
    """Steps of negative load at a steep bank after which the load becomes positive."""


class Manoeuvre(NamedTuple):
    """What is flown: two preparations, then the pursuit of the goal with an offset."""

    first: Preparation = Preparation()
    second: Preparation = Preparation()
    offset: Goal = Goal(0.0, 0.0, 0.0)
    """Added to the goal."""
    pursuit: PursuitParameters = PURSUIT
    caution: Caution = Caution()


_SECOND, _OFFSET = len(Preparation._fields), 2 * len(Preparation._fields)
_PURSUIT = _OFFSET + len(Goal._fields)
_CAUTION = _PURSUIT + len(PursuitParameters._fields)
WIDTH = _CAUTION + len(Caution._fields)
"""Numbers in a manoeuvre."""
MIRROR = np.ones(WIDTH)
"""What the numbers of a manoeuvre are multiplied with to fly its mirror image, left for right."""
MIRROR[[k + Preparation._fields.index("azimuth") for k in (0, _SECOND)]] = MIRRORED
MIRROR[_OFFSET + Goal._fields.index("azimuth")] = MIRRORED
_POSITIVE_LOAD = 0.5  # g


def manoeuvre_row(manoeuvre: Manoeuvre) -> NDArray[np.float64]:
    """All numbers of a manoeuvre, shape (WIDTH,)."""
    return np.concatenate([np.array(part, dtype=np.float64) for part in manoeuvre])


@kernel
def load_preparation(rows: NDArray[np.float64], i: int, first: int) -> Preparation:
    """The preparation that a row holds from column ``first`` on."""
    return Preparation(rows[i, first], rows[i, first + 1], rows[i, first + 2], rows[i, first + 3], rows[i, first + 4])


@kernel
def load_manoeuvre(rows: NDArray[np.float64], i: int) -> Manoeuvre:
    """The manoeuvre that a row holds."""
    return Manoeuvre(
        load_preparation(rows, i, 0),
        load_preparation(rows, i, _SECOND),
        Goal(rows[i, _OFFSET], rows[i, _OFFSET + 1], rows[i, _OFFSET + 2]),
        load_pursuit(rows, i, _PURSUIT),
        Caution(rows[i, _CAUTION], rows[i, _CAUTION + 1]),
    )


@kernel
def manoeuvre_command(
    view: Observation, goal: Goal, seconds: float, counters: Caution, manoeuvre: Manoeuvre
) -> GuidanceCommand:
    """What a manoeuvre commands ``seconds`` after its start, given the task's counters."""
    first, second, law = manoeuvre.first, manoeuvre.second, manoeuvre.pursuit
    in_first = seconds < first.duration
    preparing = in_first or seconds < first.duration + second.duration
    stage = first if in_first else second
    turning_back = counters.moving_away_steps >= manoeuvre.caution.moving_away_steps
    elsewhere = preparing and not turning_back
    aim = Goal(
        goal.speed + manoeuvre.offset.speed,
        stage.path_angle if elsewhere else goal.path_angle + manoeuvre.offset.path_angle,
        stage.azimuth if elsewhere else wrapped(goal.azimuth + manoeuvre.offset.azimuth),
    )
    parameters = PursuitParameters(
        law.turn_gain,
        min(law.largest_load_factor, stage.load_factor) if elsewhere else law.largest_load_factor,
        law.largest_push,
        law.bank_gain,
        law.speed_gain,
        0.0 if preparing or turning_back else law.height_gain,
        law.speed_reserve,
        law.speed_margin,
    )
    steering = steer(view, aim, parameters)
    throttle = clip(stage.throttle, 0.0, 1.0) if preparing else hold_speed(view, aim, parameters)
    load_factor = steering.load_factor
    if counters.negative_load_steps >= manoeuvre.caution.negative_load_steps:
        load_factor = max(load_factor, _POSITIVE_LOAD)
    return GuidanceCommand(steering.roll_rate, load_factor, throttle)
