"""Plans flown and improved, goal by goal, in one compiled loop."""

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.laws import Law, write_action
from vvc_bench.experts.manoeuvre import WIDTH
from vvc_bench.jit import entry_point, routine
from vvc_bench.search.plans import PLAIN, draw, guess, move, take, vary
from vvc_bench.sim.episodes import REPORT, begin_rows, fly_row
from vvc_bench.sim.fields import GuidanceCommand, Observation, State, degrees, field_array
from vvc_bench.sim.rows import load_conditions, load_goal, load_task
from vvc_bench.sim.stepping import load_scheme
from vvc_bench.sim.task import Event, Memory
from vvc_bench.sim.units import DEGREES_PER_RADIAN

FAILED = 1e6
"""Scores from here on are of flights that did not reach; what is more says by how much, in bands."""
NICHES = 4
"""Ways to reach a goal that are told apart: higher or lower than the start, to its right or left."""

_OBSERVED, _REPORTED = len(Observation._fields), len(REPORT)
_MANOEUVRE = int(Law.MANOEUVRE)
_REACHED = int(Event.REACH_TARGET)
_SCALE = field_array(GuidanceCommand, "scale")
_SPEED_ERROR, _DIRECTION_ERROR = (REPORT.index(name) for name in ("speed_error_mps", "direction_error_deg"))
_STEPS_IN_BAND = Memory._fields.index("steps_in_band")
_ALTITUDE, _EAST = (State._fields.index(name) for name in ("altitude", "east"))
UNSOLVED_SHARE = 3
"""How many times as much is tried in a sweep for a goal that was not reached before."""
_TURNS = 3
"""Sweeps in which each neighbour's plan is tried once as it is; by a goal that was not reached, in each sweep."""
_FASTEST_TURN = degrees(30.0) * DEGREES_PER_RADIAN
"""deg/s, nearly twice what 6 g give at 200 m/s. A flight that would have to turn faster to be in time is given up."""
_FASTEST_CHANGE = 50.0
"""m/s², of the speed, more than twice what full thrust gives in a vertical dive; in the same way."""


@routine
def fly_population(
    start: NDArray[np.float64],
    goal_rows: NDArray[np.float64],
    shown_goal: NDArray[np.float64],
    plans: NDArray[np.float64],
    conditions: NDArray[np.float64],
    scheme_row: NDArray[np.float64],
    task_row: NDArray[np.float64],
    memory_width: int,
    limit: float,
    patience: float,
    scores: NDArray[np.float64],
    niches: NDArray[np.int64],
) -> int:
    """Fly all plans to one goal side by side; returns the steps flown.

    A plan's score is its number of steps, plus a part of a step that is smaller the nearer it came to reaching one step
    earlier; or `FAILED` plus the least error, in bands, that it did not exceed over the steps that reaching takes. A
    flight is given up once it must be longer than ``limit``, or than ``patience`` times the shortest of the others.
    """
    count = plans.shape[0]
    scheme, task = load_scheme(scheme_row), load_task(task_row)
    here, shown = load_conditions(conditions, 0), load_goal(shown_goal, 0)
    size, band = int(task.reach_steps), task.direction_band * DEGREES_PER_RADIAN
    rows, memories = np.empty((count, start.size)), np.zeros((count, memory_width))
    for i in range(count):
        rows[i] = start
    actions, commands = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3))
    seen = np.zeros((count, _OBSERVED), dtype=np.float32)
    achieved = np.zeros((count, 3), dtype=np.float32)
    report, happened = np.zeros((count, _REPORTED)), np.zeros(count, dtype=np.int64)
    window, least, outside = np.full((count, size), np.inf), np.full(count, 1e5), np.ones(count)
    flying = np.arange(count)
    begin_rows(rows, memories, goal_rows, conditions, task_row, seen, achieved, flying)
    left, step, flown = count, 0, 0
    while left > 0:
        still = 0
        flown += left
        for j in range(left):
            i = flying[j]
            write_action(_MANOEUVRE, plans, i, seen, i, shown, memories, scheme.time_step, actions, i)
            for k in range(3):
                commands[i, k] = actions[i, k] / _SCALE[k]
            fly_row(rows, memories, goal_rows, commands, here, scheme, task, seen, achieved, report, happened, i)
            speed_error, angle = abs(report[i, _SPEED_ERROR]), report[i, _DIRECTION_ERROR]
            error = max(speed_error / task.speed_band, angle / band)
            scores[i] = FAILED + least[i]
            niches[i] = 0
            if happened[i] & _REACHED:
                scores[i] = step + 2.0 - 1.0 / outside[i]
                niches[i] = 2 * int(rows[i, _ALTITUDE] > start[_ALTITUDE]) + int(rows[i, _EAST] > start[_EAST])
                limit = min(limit, patience * (step + 1.0))
            if happened[i] != 0:
                continue
            window[i, step % size] = error
            if error < least[i]:
                least[i] = min(least[i], np.max(window[i]))
            needed = task.reach_steps - memories[i, _STEPS_IN_BAND]
            if error >= 1.0:
                outside[i] = error
                turn, change = (angle - band) / _FASTEST_TURN, (speed_error - task.speed_band) / _FASTEST_CHANGE
                needed += np.floor(max(turn, change, 0.0) / scheme.time_step)
            if step + 1.0 + needed <= limit:
                flying[still] = i
                still += 1
        left = still
        step += 1
    return flown


@routine
def make_plan(
    plan: NDArray[np.float64],
    azimuth: float,
    own: NDArray[np.float64],
    own_scores: NDArray[np.float64],
    pool: NDArray[np.float64],
    seed: int,
    goal: int,
    sweep: int,
    number: int,
) -> int:
    """The next plan to try for a goal; returns the number of the next draw.

    The goal's own plans and its neighbours', in ``pool``, are varied, and moved along differences between them; now and
    then, and at first, there is a new guess.
    """
    neighbours = pool.shape[0]
    best = int(np.argmin(own_scores))
    solved, begun = own_scores[best] < FAILED, own_scores[best] < np.inf
    if (not begun and neighbours == 0) or draw(seed, goal, sweep, number)[0] < (0.05 if solved else 0.3):
        return guess(plan, azimuth, seed, goal, sweep, number + 1)
    lot = draw(seed, goal, sweep, number + 1)[0]
    if begun and (neighbours == 0 or lot < 0.7):
        niche = int(own_scores.shape[0] * draw(seed, goal, sweep, number + 2)[0])
        take(plan, own[niche if own_scores[niche] < np.inf else best], False)
    else:
        take(plan, pool[int(neighbours * draw(seed, goal, sweep, number + 2)[0])], False)
    lot, share = draw(seed, goal, sweep, number + 3)[0], draw(seed, goal, sweep, number + 4)[0]
    one = int(neighbours * draw(seed, goal, sweep, number + 5)[0])
    other = int(neighbours * draw(seed, goal, sweep, number + 6)[0])
    number += 7
    if neighbours > 0 and lot < 0.25:
        move(plan, pool[other], pool[one], share)
    elif neighbours > 0 and lot < 0.5:
        move(plan, plan, pool[one], 1.5 * share - 0.5)
    if lot > 0.4:
        number = vary(plan, azimuth, seed, goal, sweep, number)
    return number


@routine
def ask_neighbours(
    pool: NDArray[np.float64],
    trial: NDArray[np.float64],
    plans: NDArray[np.float64],
    scores: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    mirrored: NDArray[np.bool_],
    solved: bool,
    seed: int,
    goal: int,
    sweep: int,
) -> tuple[int, int, int]:
    """Fill ``pool`` with the neighbours' plans, and ``trial`` with those to be tried as they are.

    Returns how many are in either, and the number of the next draw. Where there is nothing, the goal is pursued.
    """
    known, tried, number = 0, 0, 0
    for k in range(neighbours.size):
        other = neighbours[k]
        if other < 0:
            continue
        niche = int(scores.shape[1] * draw(seed, goal, sweep, number)[0])
        number += 1
        if scores[other, niche] >= FAILED:
            niche = int(np.argmin(scores[other]))
        if scores[other, niche] < np.inf:
            take(pool[known], plans[other, niche], mirrored[k])
            known += 1
            if tried < trial.shape[0] and (not solved or (k + sweep) % _TURNS == 0):
                take(trial[tried], pool[known - 1], False)
                tried += 1
    if tried == 0 and not np.isfinite(np.min(scores[goal])):
        take(trial[0], PLAIN, False)
        tried = 1
    return known, tried, number


@routine
def keep_better(
    own: NDArray[np.float64],
    own_scores: NDArray[np.float64],
    trial: NDArray[np.float64],
    trial_scores: NDArray[np.float64],
    trial_niches: NDArray[np.int64],
) -> None:
    """Put each trial in the place of the goal's own plan of its niche, if it is better."""
    for i in range(trial.shape[0]):
        niche = trial_niches[i] % own_scores.size
        if trial_scores[i] < own_scores[niche]:
            own_scores[niche] = trial_scores[i]
            own[niche] = trial[i]


@entry_point
def improve(
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    shown_goals: NDArray[np.float64],
    plans: NDArray[np.float64],
    scores: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    mirrored: NDArray[np.bool_],
    conditions: NDArray[np.float64],
    scheme_row: NDArray[np.float64],
    task_row: NDArray[np.float64],
    memory_width: int,
    seed: int,
    sweep: int,
    generations: int,
    population: int,
    patience: float,
    new_plans: NDArray[np.float64],
    new_scores: NDArray[np.float64],
    first: int,
    last: int,
) -> int:
    """Look for better plans for goals first ≤ g < last; returns the steps flown.

    ``plans``, shape (G, K, `WIDTH`), and ``scores``, shape (G, K), are all goals' so far, infinite where there is none,
    one for each niche; ``neighbours`` says for each goal whose plans are worth a try, −1 for nobody.
    """
    flown = 0
    trial, trial_scores = np.zeros((population, WIDTH)), np.zeros(population)
    trial_niches = np.zeros(population, dtype=np.int64)
    pool, goal_rows = np.zeros((neighbours.shape[1], WIDTH)), np.zeros((population, 3))
    step_limit = load_task(task_row).step_limit
    for g in range(first, last):
        own, own_scores = plans[g].copy(), scores[g].copy()
        solved = np.min(own_scores) < FAILED
        goal_rows[:] = goals[g]
        known, tried, number = ask_neighbours(
            pool, trial, plans, scores, neighbours[g], mirrored, solved, seed, g, sweep
        )
        for generation in range(generations * (1 if solved else UNSOLVED_SHARE)):
            for i in range(tried if generation == 0 else 0, population):
                number = make_plan(trial[i], goals[g, 2], own, own_scores, pool[:known], seed, g, sweep, number)
            limit = min(step_limit, patience * np.floor(np.min(own_scores)))
            flown += fly_population(
                start,
                goal_rows,
                shown_goals[g : g + 1],
                trial,
                conditions,
                scheme_row,
                task_row,
                memory_width,
                limit,
                patience,
                trial_scores,
                trial_niches,
            )
            keep_better(own, own_scores, trial, trial_scores, trial_niches)
        new_plans[g], new_scores[g] = own, own_scores
    return flown
