"""The task: what counts as reaching a goal, as failing, and what each step is worth (the paper's Section 3).

A task is a value, and a variant of it another: ``task._replace(reach_steps=30)``. Terminations are predicates over the
reports so far; what they must remember lives in one `Memory`, updated in one place. Every predicate sets a bit, so why
an episode ended is a number that can be stored.

Two sets of rules stand side by side: the paper's text, and the public code (flycraft 0.2.0) to the letter.
"""

import math
from enum import IntEnum, IntFlag
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vvc_bench.jit import kernel, routine
from vvc_bench.sim.fields import Field, Goal, State, degrees, field_array
from vvc_bench.sim.units import ANGLE, ANGULAR_RATE, COUNT, METRE, METRE_PER_SECOND, ONE, STANDARD_GRAVITY


class Event(IntFlag):
    """Why an episode ends: the terminations of the paper's Section 3.3, by its abbreviations."""

    REACH_TARGET = 1
    """RT: the goal is reached, and held."""
    CRASH = 2
    """C: below the least altitude."""
    EXTREME_STATE = 4
    """ES: too fast, or rolling too fast."""
    TIME_LIMIT = 8
    """T: all steps are used up. It truncates."""
    MOVE_AWAY = 16
    """CMA: the direction error has grown for many steps in a row."""
    ROLL_ON = 32
    """CR: rolled on in one direction through too large an angle."""
    NEGATIVE_LOAD_BANKED = 64
    """NOBR: negative load factor while banked steeply, for many steps in a row."""


ALL_EVENTS = Event(sum(Event))
FAILURES = ALL_EVENTS & ~(Event.REACH_TARGET | Event.TIME_LIMIT)
Events: TypeAlias = int | NDArray[np.integer[Any]]


class Reward(IntEnum):
    """How steps are rewarded."""

    DENSE = 0
    """Eq. 1 of the paper: minus the weighted, scaled errors; 0 on reaching, the penalty alone on failing."""
    SPARSE = 1
    """0 on reaching, −1 otherwise, the penalty on failing."""
    DISTANCE = 2
    """The plain goal distance r_g at every step, whatever happens ("without environment designs")."""


class Penalty(IntEnum):
    """What a failure costs."""

    CONSTANT = 0
    """``constant_penalty``."""
    PESSIMISTIC = 1
    """As if every step left were worth −1: −(1 − γ^(T_max − t)) / (1 − γ)."""


class Rules(IntEnum):
    """Whose rules."""

    PAPER = 0
    PUBLIC_CODE = 1
    """flycraft 0.2.0: reach by the mean of a window, time out one step early, and so on (docs/environments.md)."""
    DEMONSTRATION = 2
    """How the paper's PID demonstrations were kept: over the last ``reach_steps`` reports, the start not among them,
    the mean errors of speed, path angle and azimuth each lie inside their band; otherwise as `PAPER`."""


class Task(NamedTuple):
    """Every number of the task (the paper's Table 6), in SI units and radians."""

    speed_band: Annotated[float, Field(METRE_PER_SECOND, "", "largest speed error of a reached goal", low=0.0)] = 10.0
    direction_band: Annotated[float, Field(ANGLE, "", "largest direction error of a reached goal", 1, 0.0, math.pi)] = (
        degrees(3.0)
    )
    reach_steps: Annotated[float, Field(COUNT, "T_R", "steps in a row inside the bands", 1, 1.0, 1000.0)] = 10.0
    step_limit: Annotated[float, Field(COUNT, "T_max", "steps of an episode", 1, 1.0, 1e6)] = 400.0
    speed_weight: Annotated[float, Field(ONE, "w_v", "weight of the speed error", low=0.0)] = 0.5
    direction_weight: Annotated[float, Field(ONE, "w_d", "weight of the direction error", low=0.0)] = 0.5
    speed_scale: Annotated[float, Field(METRE_PER_SECOND, "σ_v", "speed error that costs all its weight", low=1e-6)] = (
        100.0
    )
    direction_scale: Annotated[float, Field(ANGLE, "σ_d", "direction error that costs all its weight", low=1e-6)] = (
        degrees(180.0)
    )
    exponent: Annotated[float, Field(ONE, "b", "exponent of the scaled errors", low=1e-6)] = 0.5
    discount: Annotated[float, Field(ONE, "γ", "discount in the pessimistic penalty", 1, 0.0, 1.0)] = 0.995
    reward: Annotated[float, Field(COUNT, "", "how steps are rewarded (`Reward`)", 1, 0.0, 2.0)] = float(Reward.DENSE)
    penalty: Annotated[float, Field(COUNT, "", "what a failure costs (`Penalty`)", 1, 0.0, 1.0)] = float(
        Penalty.PESSIMISTIC
    )
    constant_penalty: Annotated[float, Field(ONE, "", "what a failure costs, if that is constant")] = -1.0
    least_altitude: Annotated[float, Field(METRE, "h₀", "lower is a crash")] = 0.0
    largest_speed: Annotated[float, Field(METRE_PER_SECOND, "", "faster is an extreme state", low=0.0)] = 400.0
    largest_roll_rate: Annotated[float, Field(ANGULAR_RATE, "", "faster is an extreme state", low=0.0)] = degrees(300.0)
    move_away_steps: Annotated[float, Field(COUNT, "T_M", "steps in a row of growing error", 1, 1.0, 1e6)] = 20.0
    largest_roll_on: Annotated[float, Field(ANGLE, "φ_max", "angle rolled in one direction", low=0.0)] = degrees(720.0)
    steep_bank: Annotated[float, Field(ANGLE, "", "bank that is steep under negative load", 1, 0.0, math.pi)] = degrees(
        60.0
    )
    least_load_factor: Annotated[float, Field(STANDARD_GRAVITY, "", "below it, the load is negative")] = 0.0
    negative_load_steps: Annotated[float, Field(COUNT, "T_N", "steps in a row of that", 1, 1.0, 1e6)] = 20.0
    terminations: Annotated[float, Field(COUNT, "", "which events end an episode (`Event` bits)", 1, 0.0, 127.0)] = (
        float(ALL_EVENTS)
    )
    rules: Annotated[float, Field(COUNT, "", "whose rules (`Rules`)", 1, 0.0, 2.0)] = float(Rules.PAPER)


class Memory(NamedTuple):
    """What the terminations remember within an episode. Under rules that take means a window of errors follows."""

    steps: float
    steps_on_goal: float
    """Since the goal was set."""
    steps_in_band: float
    direction_error: float
    """Of the last report."""
    steps_moving_away: float
    path_angle_error: float
    azimuth_error: float
    steps_path_angle_away: float
    steps_azimuth_away: float
    rolled: float
    """Signed angle rolled on in one direction."""
    steps_negative_load: float


class Outcome(NamedTuple):
    """What one step means."""

    memory: Memory
    events: int
    reward: float
    speed_error: float
    direction_error: float


_ALONG_ENOUGH = 0.7
_NO_ROLL = degrees(0.01)  # flycraft's ROLL_THRESHOLD
_IGNORED_ERROR = degrees(1.0)  # flycraft's ignore_mu_error, ignore_chi_error
_BEFORE_ANY_ERROR = degrees(-360.0)
_DIVERGED = 1e4
"""m/s and rad/s together, that nothing flies."""
_RT, _C, _ES, _T = (int(event) for event in (Event.REACH_TARGET, Event.CRASH, Event.EXTREME_STATE, Event.TIME_LIMIT))
_CMA, _CR, _NOBR = (int(event) for event in (Event.MOVE_AWAY, Event.ROLL_ON, Event.NEGATIVE_LOAD_BANKED))
_FAILURES = int(FAILURES)
_TERMINAL = int(Event.REACH_TARGET | FAILURES)
_PUBLICLY_TRUNCATED = int(Event.CRASH | Event.EXTREME_STATE | Event.TIME_LIMIT)
_SPEED_SCALE, _ANGLE_SCALE, _ = field_array(Goal, "scale").tolist()
_DISTANCE, _SPARSE = int(Reward.DISTANCE), int(Reward.SPARSE)


@kernel
def direction_error(path_angle: float, azimuth: float, goal: Goal) -> float:
    """Angle between the velocity vector and the goal's, in rad, 0 to π."""
    cos_path, sin_path = math.cos(path_angle), math.sin(path_angle)
    cos_goal, sin_goal = math.cos(goal.path_angle), math.sin(goal.path_angle)
    turn = goal.azimuth - azimuth
    cos_turn, sin_turn = math.cos(turn), math.sin(turn)
    across = cos_goal * sin_turn
    above = cos_path * sin_goal - sin_path * cos_goal * cos_turn
    along = sin_path * sin_goal + cos_path * cos_goal * cos_turn
    if abs(along) < _ALONG_ENOUGH:
        return math.acos(along)
    angle = math.asin(min(math.sqrt(across * across + above * above), 1.0))  # precise where the cosine is flat
    return angle if along > 0.0 else math.pi - angle


@kernel
def distance_reward(speed_error: float, direction_error: float, task: Task) -> float:
    """The goal part of the reward, −(w_v min(|Δv|/σ_v, 1)^b + w_d min(∠/σ_d, 1)^b) (eq. 1; Appendix L.4)."""
    speed_part = min(speed_error / task.speed_scale, 1.0)
    direction_part = min(direction_error / task.direction_scale, 1.0)
    if task.exponent == 0.5:
        return -(task.speed_weight * math.sqrt(speed_part) + task.direction_weight * math.sqrt(direction_part))
    speed_cost: float = speed_part**task.exponent
    direction_cost: float = direction_part**task.exponent
    return -(task.speed_weight * speed_cost + task.direction_weight * direction_cost)


@kernel
def failure_penalty(step: float, task: Task) -> float:
    """What failing at step ``step`` costs."""
    if task.penalty == 0.0:
        return task.constant_penalty
    left = max(task.step_limit - step, 0.0)
    if task.discount == 1.0:
        return -left
    missed: float = math.pow(task.discount, left)
    return -(1.0 - missed) / (1.0 - task.discount)


@kernel
def wrapped(angle: float) -> float:
    """A difference of two angles in [−π, π], brought into [−π, π]."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle < -math.pi else angle


@kernel
def _run(condition: bool, count: float) -> float:
    """How many steps in a row a condition has held."""
    return count + 1.0 if condition else 0.0


@kernel
def _rolled_on(rolled: float, before: float, after: float) -> float:
    """Angle rolled on in one direction; a pause or a reversal starts anew. Steps of less than 180° are assumed."""
    turn = wrapped(after - before)
    if abs(after - before) < _NO_ROLL:
        return 0.0
    return rolled + turn if rolled * turn > 0.0 else turn


@kernel
def has_diverged(state: State) -> bool:
    """Whether a state is none any more, which NaN is not either.

    Past `Event.EXTREME_STATE` an aircraft may roll faster than a time step follows, and the equations then grow without
    end within a few steps.
    """
    return not abs(state.speed) + abs(state.roll_rate) < _DIVERGED


@kernel
def judge_diverged(task: Task, memory: Memory) -> Outcome:
    """The end of an episode whose state has diverged: an extreme state, also where that ends no others."""
    steps = memory.steps + 1.0
    ended = Memory(
        steps,
        memory.steps_on_goal + 1.0,
        0.0,
        memory.direction_error,
        0.0,
        memory.path_angle_error,
        memory.azimuth_error,
        0.0,
        0.0,
        0.0,
        0.0,
    )
    return Outcome(ended, _ES, failure_penalty(steps, task), math.nan, math.nan)


@kernel
def _rounded(value: float, scale: float) -> float:
    return float(np.float32(value * scale)) / scale


@kernel
def as_seen(motion: State | Goal) -> Goal:
    """Speed and direction as a learner sees them: float32 in outside units.

    Judged by these, a step is worth to the last bit what relabelling makes of its observations.
    """
    return Goal(
        _rounded(motion.speed, _SPEED_SCALE),
        _rounded(motion.path_angle, _ANGLE_SCALE),
        _rounded(motion.azimuth, _ANGLE_SCALE),
    )


@kernel
def judge(task: Task, memory: Memory, roll_before: float, after: State, goal: Goal) -> Outcome:
    """What a step means by the paper's text: every event of the new report, and its reward.

    Success comes before failure, and failure before the time limit; only enabled events are reported.
    """
    achieved, wanted = as_seen(after), as_seen(goal)
    speed_error = abs(wanted.speed - achieved.speed)
    angle = direction_error(achieved.path_angle, achieved.azimuth, wanted)
    near = speed_error < task.speed_band and angle < task.direction_band
    fast = after.speed > task.largest_speed or abs(after.roll_rate) > task.largest_roll_rate
    banked = abs(after.roll) > task.steep_bank and after.load_factor < task.least_load_factor
    memory = Memory(
        steps=memory.steps + 1.0,
        steps_on_goal=memory.steps_on_goal + 1.0,
        steps_in_band=_run(near, memory.steps_in_band),
        direction_error=angle,
        steps_moving_away=_run(angle > memory.direction_error, memory.steps_moving_away),
        path_angle_error=memory.path_angle_error,
        azimuth_error=memory.azimuth_error,
        steps_path_angle_away=memory.steps_path_angle_away,
        steps_azimuth_away=memory.steps_azimuth_away,
        rolled=_rolled_on(memory.rolled, roll_before, after.roll),
        steps_negative_load=_run(banked, memory.steps_negative_load),
    )
    events = (
        _RT * int(memory.steps_in_band >= task.reach_steps)
        + _C * int(after.altitude < task.least_altitude)
        + _ES * int(fast)
        + _T * int(memory.steps >= task.step_limit)
        + _CMA * int(memory.steps_moving_away >= task.move_away_steps)
        + _CR * int(abs(memory.rolled) > task.largest_roll_on)
        + _NOBR * int(memory.steps_negative_load >= task.negative_load_steps)
    ) & int(task.terminations)
    return Outcome(memory, events, _reward(task, events, memory.steps, speed_error, angle), speed_error, angle)


@kernel
def _reward(task: Task, events: int, step: float, speed_error: float, angle: float) -> float:
    """Eq. 1 in its split form (Appendix L.4), or one of the alternatives."""
    if int(task.reward) == _DISTANCE:
        return distance_reward(speed_error, angle, task)
    if events & _RT:
        return 0.0
    if events & _FAILURES:
        return failure_penalty(step, task)
    return -1.0 if int(task.reward) == _SPARSE else distance_reward(speed_error, angle, task)


@routine
def judge_publicly(
    task: Task, memory: Memory, window: NDArray[np.float64], i: int, roll_before: float, after: State, goal: Goal
) -> Outcome:
    """What a step means by the public code's rules; ``window[i]`` holds the last errors, speed and direction in turn.

    Reaching is a mean over the window, the initial report included; moving away is judged on path angle and azimuth
    apart; the time limit comes one step early; the dense reward is added on final steps too.
    """
    achieved, wanted = as_seen(after), as_seen(goal)
    speed_error = abs(wanted.speed - achieved.speed)
    angle = direction_error(achieved.path_angle, achieved.azimuth, wanted)
    path_angle_error = abs(wanted.path_angle - achieved.path_angle)
    azimuth_error = abs(wrapped(wanted.azimuth - achieved.azimuth))
    fast = after.speed > task.largest_speed or abs(after.roll_rate) > task.largest_roll_rate
    banked = abs(after.roll) > task.steep_bank and after.load_factor < task.least_load_factor
    memory = Memory(
        steps=memory.steps + 1.0,
        steps_on_goal=memory.steps_on_goal + 1.0,
        steps_in_band=memory.steps_in_band,
        direction_error=angle,
        steps_moving_away=memory.steps_moving_away,
        path_angle_error=path_angle_error,
        azimuth_error=azimuth_error,
        steps_path_angle_away=_away(path_angle_error, memory.path_angle_error, memory.steps_path_angle_away),
        steps_azimuth_away=_away(azimuth_error, memory.azimuth_error, memory.steps_azimuth_away),
        rolled=_rolled_on(memory.rolled, roll_before, after.roll),
        steps_negative_load=_run(banked, memory.steps_negative_load),
    )
    away = min(memory.steps_path_angle_away, memory.steps_azimuth_away)
    events = (
        _RT * int(_reached_on_average(task, memory, window, i, speed_error, angle))
        + _C * int(after.altitude < task.least_altitude)
        + _ES * int(fast)
        + _T * int(memory.steps >= task.step_limit - 1.0)
        + _CMA * int(away >= task.move_away_steps)
        + _CR * int(abs(memory.rolled) > task.largest_roll_on)
        + _NOBR * int(memory.steps_negative_load >= task.negative_load_steps)
    ) & int(task.terminations)
    reward = -1.0 if int(task.reward) == _SPARSE else distance_reward(speed_error, angle, task)
    first = first_event(events)
    if first == _T:
        reward += task.constant_penalty
    elif first & _FAILURES:
        reward += failure_penalty(memory.steps, task)
    return Outcome(memory, events, reward, speed_error, angle)


@kernel
def _means_inside(task: Task, window: NDArray[np.float64], i: int) -> bool:
    size = int(task.reach_steps)
    speed_sum, path_angle_sum, azimuth_sum = 0.0, 0.0, 0.0
    for k in range(size):
        speed_sum += window[i, 3 * k]
        path_angle_sum += window[i, 3 * k + 1]
        azimuth_sum += window[i, 3 * k + 2]
    return speed_sum < task.speed_band * size and max(path_angle_sum, azimuth_sum) < task.direction_band * size


@routine
def judge_demonstration(
    task: Task, memory: Memory, window: NDArray[np.float64], i: int, roll_before: float, after: State, goal: Goal
) -> Outcome:
    """What a step means where reaching is a mean of each error; ``window[i]`` holds the last ones, three in turn."""
    outcome = judge(task, memory, roll_before, after, goal)
    size = int(task.reach_steps)
    slot = 3 * (int(memory.steps_on_goal) % size)
    achieved, wanted = as_seen(after), as_seen(goal)
    path_angle_error = abs(wanted.path_angle - achieved.path_angle)
    azimuth_error = abs(wrapped(wanted.azimuth - achieved.azimuth))
    window[i, slot] = outcome.speed_error
    window[i, slot + 1] = path_angle_error
    window[i, slot + 2] = azimuth_error
    reached = (
        outcome.memory.steps_on_goal >= task.reach_steps
        and outcome.speed_error < task.speed_band * size  # else the newest error alone is too much for the mean
        and max(path_angle_error, azimuth_error) < task.direction_band * size
        and _means_inside(task, window, i)
    )
    events = (outcome.events & ~_RT) | (_RT * int(reached) & int(task.terminations))
    reward = _reward(task, events, outcome.memory.steps, outcome.speed_error, outcome.direction_error)
    return Outcome(outcome.memory, events, reward, outcome.speed_error, outcome.direction_error)


_WINDOW_COLUMNS = {Rules.PAPER: 0, Rules.PUBLIC_CODE: 2, Rules.DEMONSTRATION: 3}


def window_width(task: Task) -> int:
    """How many values a row needs after its `Memory`: the window of errors, where the rules take means."""
    return _WINDOW_COLUMNS[Rules(int(task.rules))] * int(task.reach_steps)


@kernel
def _away(error: float, before: float, count: float) -> float:
    return count + 1.0 if error > before and error > _IGNORED_ERROR else 0.0


@kernel
def _reached_on_average(
    task: Task, memory: Memory, window: NDArray[np.float64], i: int, speed_error: float, angle: float
) -> bool:
    size = int(task.reach_steps)
    slot = 2 * (int(memory.steps_on_goal) % size)
    window[i, slot] = speed_error
    window[i, slot + 1] = angle
    speed_sum, angle_sum = 0.0, 0.0
    for k in range(size):
        speed_sum += window[i, 2 * k]
        angle_sum += window[i, 2 * k + 1]
    full = memory.steps_on_goal + 1.0 >= task.reach_steps
    return full and speed_sum < task.speed_band * size and angle_sum < task.direction_band * size


def outcomes(task: Task, events: Events) -> tuple[Any, Any]:
    """``terminated`` and ``truncated`` for the events of one step, or for an array of them."""
    if task.rules == Rules.PUBLIC_CODE:
        return events != 0, (events & -events & _PUBLICLY_TRUNCATED) != 0
    terminated = (events & _TERMINAL) != 0
    return terminated, (events != 0) != terminated


@kernel
def first_event(events: int) -> int:
    """The event that counts where several coincide: the lowest bit, which is the public code's order."""
    return events & -events


@kernel
def fresh_memory(task: Task, state: State, goal: Goal) -> Memory:
    """What is remembered at the start of an episode."""
    public = task.rules == 1.0
    achieved, wanted = as_seen(state), as_seen(goal)
    return Memory(
        steps=0.0,
        steps_on_goal=0.0,
        steps_in_band=0.0,
        direction_error=direction_error(achieved.path_angle, achieved.azimuth, wanted),
        steps_moving_away=0.0,
        path_angle_error=_BEFORE_ANY_ERROR,
        azimuth_error=_BEFORE_ANY_ERROR,
        steps_path_angle_away=-1.0 if public else 0.0,
        steps_azimuth_away=-1.0 if public else 0.0,
        rolled=0.0,
        steps_negative_load=0.0,
    )
