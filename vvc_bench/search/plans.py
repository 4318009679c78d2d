"""Where the search draws its plans from: bounds, first guesses and variations of manoeuvres.

All random numbers are a function of (seed, goal, sweep, number of the draw), so nothing depends on threads or order.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.manoeuvre import MIRROR, WIDTH, Caution, Manoeuvre, Preparation, manoeuvre_row
from vvc_bench.experts.pursuit import PursuitParameters
from vvc_bench.jit import kernel, routine
from vvc_bench.sim.fields import Goal, degrees
from vvc_bench.sim.interpolation import clip
from vvc_bench.sim.random_numbers import threefry

_WORD = 2.0**32
_STAGE = len(Preparation._fields)
_STAGES = 2
_OFFSET = _STAGES * _STAGE
_DURATION, _PATH_ANGLE, _AZIMUTH, _LOAD_FACTOR, _THROTTLE = range(_STAGE)

_LONGEST = 8.0
"""s, of a preparation in a first guess."""
_STAGE_LOW = Preparation(0.0, degrees(-88.0), -math.pi, 1.5, 0.0)
_STAGE_HIGH = Preparation(15.0, degrees(88.0), math.pi, 9.0, 1.0)
_STAGE_SPREAD = Preparation(1.0, degrees(15.0), degrees(20.0), 1.0, 0.3)
LOW = manoeuvre_row(
    Manoeuvre(
        _STAGE_LOW,
        _STAGE_LOW,
        Goal(-9.5, degrees(-2.9), degrees(-10.0)),
        PursuitParameters(0.3, 2.0, 0.0, 0.7, 0.005, 0.0, -60.0, 0.0),
        Caution(6.0, 6.0),
    )
)
HIGH = manoeuvre_row(
    Manoeuvre(
        _STAGE_HIGH,
        _STAGE_HIGH,
        Goal(9.5, degrees(2.9), degrees(10.0)),
        PursuitParameters(5.0, 9.0, 4.0, 7.0, 0.5, 0.05, 120.0, 30.0),
        Caution(20.0, 20.0),
    )
)
"""Bounds of a plan's numbers; a stage's azimuth goes round."""
_SPREAD = manoeuvre_row(
    Manoeuvre(
        _STAGE_SPREAD,
        _STAGE_SPREAD,
        Goal(3.0, degrees(1.0), degrees(2.0)),
        PursuitParameters(0.3, 1.0, 0.5, 0.5, 0.05, 0.005, 10.0, 4.0),
        Caution(2.0, 2.0),
    )
)
"""A large step of each number."""
_ANGLES = np.zeros(WIDTH, dtype=np.bool_)
_ANGLES[[_AZIMUTH, _STAGE + _AZIMUTH]] = True
PLAIN = manoeuvre_row(Manoeuvre())
"""The goal pursued from the start."""
_MIRROR = MIRROR


@routine
def draw(seed: int, goal: int, sweep: int, number: int) -> tuple[float, float]:
    """A number uniform in [0, 1) and a standard normal one, of which only one may be used."""
    a, b = threefry(seed, goal, number, sweep)
    radius = math.sqrt(-2.0 * math.log((a + 1.0) / _WORD))
    return a / _WORD, radius * math.cos(2.0 * math.pi * b / _WORD)


@kernel
def _uniform(seed: int, goal: int, sweep: int, number: int) -> float:
    return draw(seed, goal, sweep, number)[0]


@kernel
def _round_turn(angle: float) -> float:
    """An angle brought into [−π, π)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@routine
def guess_stage(
    plan: NDArray[np.float64], stage: int, azimuth: float, seed: int, goal: int, sweep: int, number: int
) -> int:
    """A preparation at random; returns the number of the next draw."""
    first = stage * _STAGE
    plan[first + _DURATION] = _LONGEST * _uniform(seed, goal, sweep, number)
    plan[first + _PATH_ANGLE] = _STAGE_HIGH.path_angle * (2.0 * _uniform(seed, goal, sweep, number + 1) - 1.0)
    share, scatter = _uniform(seed, goal, sweep, number + 2), draw(seed, goal, sweep, number + 3)[1]
    plan[first + _AZIMUTH] = _round_turn(1.3 * share * azimuth + 0.6 * scatter)
    plan[first + _LOAD_FACTOR] = 2.0 + 7.0 * math.sqrt(_uniform(seed, goal, sweep, number + 4))
    lever = _uniform(seed, goal, sweep, number + 5)
    plan[first + _THROTTLE] = clip(3.0 * lever - 1.0, 0.0, 1.0)
    return number + 6


@routine
def guess(plan: NDArray[np.float64], azimuth: float, seed: int, goal: int, sweep: int, number: int) -> int:
    """A plan at random; returns the number of the next draw."""
    for k in range(WIDTH):
        plan[k] = PLAIN[k]
    for stage in range(_STAGES):
        number = guess_stage(plan, stage, azimuth, seed, goal, sweep, number)
        if _uniform(seed, goal, sweep, number) < 0.25 + 0.35 * stage:
            plan[stage * _STAGE + _DURATION] = 0.0
        number += 1
    for k in range(_OFFSET, WIDTH):
        plan[k] += _SPREAD[k] * draw(seed, goal, sweep, number + k)[1]
    bound(plan)
    return number + WIDTH


@routine
def vary(plan: NDArray[np.float64], azimuth: float, seed: int, goal: int, sweep: int, number: int) -> int:
    """Change a plan, now a little and now a lot; returns the number of the next draw."""
    kind = _uniform(seed, goal, sweep, number)
    stage = int(_STAGES * _uniform(seed, goal, sweep, number + 1))
    number += 2
    if kind < 0.06:
        number = guess_stage(plan, stage, azimuth, seed, goal, sweep, number)
    elif kind < 0.10:
        plan[stage * _STAGE + _DURATION] = 0.0
    step = math.pow(10.0, 1.8 * _uniform(seed, goal, sweep, number) - 1.6)
    share = 0.1 + 0.4 * _uniform(seed, goal, sweep, number + 1)
    number += 2
    for k in range(WIDTH):
        if _uniform(seed, goal, sweep, number + 2 * k) < share:
            plan[k] += step * _SPREAD[k] * draw(seed, goal, sweep, number + 2 * k + 1)[1]
    bound(plan)
    return number + 2 * WIDTH


@routine
def move(plan: NDArray[np.float64], origin: NDArray[np.float64], target: NDArray[np.float64], share: float) -> None:
    """Add a share of the difference of two plans."""
    for k in range(WIDTH):
        difference = target[k] - origin[k]
        plan[k] += share * (_round_turn(difference) if _ANGLES[k] else difference)
    bound(plan)


@routine
def bound(plan: NDArray[np.float64]) -> None:
    """Bring every number inside its bounds."""
    for k in range(WIDTH):
        plan[k] = _round_turn(plan[k]) if _ANGLES[k] else clip(plan[k], LOW[k], HIGH[k])


@routine
def take(plan: NDArray[np.float64], other: NDArray[np.float64], mirrored: bool) -> None:
    """Copy a plan, or its mirror image."""
    for k in range(WIDTH):
        plan[k] = other[k] * _MIRROR[k] if mirrored else other[k]
