"""Fly many episodes to their ends: recorded actions again, or an expert's, in one compiled loop.

The only place where `Episodes` come from, so that whatever is stored can be flown again.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.experts.laws import RECORDED, Figures, Pilot, make_pilot, write_action
from vvc_bench.experts.pid import APPENDIX_C, PidParameters
from vvc_bench.experts.pursuit import PursuitParameters
from vvc_bench.goals import SCALE, checked_goals
from vvc_bench.jit import entry_point
from vvc_bench.rollout.episodes import PER_TRANSITION, Episodes, concatenate
from vvc_bench.rollout.scenario import Scenario
from vvc_bench.sim.episodes import REPORT, begin_rows, fly_row
from vvc_bench.sim.fields import GuidanceCommand, Observation, State, SurfaceCommand, field_array
from vvc_bench.sim.parallel import available_threads, for_each_chunk
from vvc_bench.sim.rows import load_conditions, load_goal, load_task
from vvc_bench.sim.stepping import load_scheme
from vvc_bench.sim.task import Event, Memory, window_width
from vvc_bench.tasks import task_row

SIDE_BY_SIDE = 256
"""Episodes that one thread flies in step: enough to keep its core busy, few enough for its cache."""

_BLOCK = 4096
"""Episodes flown between two reports of progress, which bounds the memory for flights that reach nothing."""

_GUIDANCE_SCALE, _SURFACE_SCALE = field_array(GuidanceCommand, "scale"), field_array(SurfaceCommand, "scale")
_DEFLECTION_SCALE = field_array(SurfaceCommand, "scale")
_AILERON = State._fields.index("aileron")
_DEFLECTIONS = len(SurfaceCommand._fields)
_OBSERVED = len(Observation._fields)
_LOAD_FACTOR = REPORT.index("load_factor_g")
_RECORDED = int(RECORDED.law)
_ONE_SHARE = 1


@entry_point
def _law_rows(
    law: int,
    law_rows: NDArray[np.float64],
    seen: NDArray[np.float32],
    shown_goals: NDArray[np.float64],
    memories: NDArray[np.float64],
    actions: NDArray[np.float32],
) -> None:
    for i in range(seen.shape[0]):
        write_action(law, law_rows, 0, seen, i, load_goal(shown_goals, i), memories, 0.0, actions, i)


def law_actions(
    observations: NDArray[np.float32],
    desired_goals: NDArray[np.float32],
    parameters: PidParameters | PursuitParameters = APPENDIX_C,
) -> NDArray[np.float32]:
    """A law's answer to what is seen and nothing else.

    The PID law is flown so by `fly_law` too. There pursuit also minds the task's counters, which nobody sees.

    Args:
        observations: shape (B, 8), as environments give them.
        desired_goals: shape (B, 3), the same.
        parameters: the law's figures.

    Returns:
        Shape (B, 3), in the units of the action space of guidance mode.
    """
    actions = np.empty((len(observations), len(GuidanceCommand._fields)), dtype=np.float32)
    pilot, nothing = make_pilot(parameters), np.zeros((len(observations), len(Memory._fields)))
    seen = np.ascontiguousarray(observations)
    _law_rows(int(pilot.law), pilot.rows, seen, desired_goals / SCALE, nothing, actions)
    return actions


@entry_point
def _fly_episodes(
    starts: NDArray[np.float64],
    goals: NDArray[np.float64],
    shown_goals: NDArray[np.float64],
    law: int,
    law_rows: NDArray[np.float64],
    conditions: NDArray[np.float64],
    scheme_row: NDArray[np.float64],
    task_row: NDArray[np.float64],
    memory_width: int,
    offsets: NDArray[np.int64],
    actions: NDArray[np.float32],
    lengths: NDArray[np.int64],
    last_events: NDArray[np.int64],
    observations: NDArray[np.float32],
    final_observations: NDArray[np.float32],
    rewards: NDArray[np.float32],
    events: NDArray[np.uint8],
    deflections: NDArray[np.float32],
    load_factors: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Fly episodes start ≤ e < stop, side by side, until an event ends them or their room for actions is used up.

    ``law`` is a number of `vvc_bench.experts.laws.Law`; its actions are written, recorded ones are read. Where
    ``rewards`` has room, all that `Episodes` holds is written too.
    """
    count, width = stop - start, actions.shape[1]
    recording, law_for_all = rewards.shape[0] > 0, law_rows.shape[0] == 1
    scheme, task = load_scheme(scheme_row), load_task(task_row)
    rows, targets = starts[start:stop].copy(), goals[start:stop].copy()
    memories = np.zeros((count, memory_width))
    commands = np.zeros((count, width))
    seen = np.zeros((count, _OBSERVED), dtype=np.float32)
    achieved = np.zeros((count, 3), dtype=np.float32)
    report = np.zeros((count, len(REPORT)))
    happened = np.zeros(count, dtype=np.int64)
    weather = conditions if conditions.shape[0] == 1 else conditions[start:stop]
    flying = np.arange(count)
    begin_rows(rows, memories, targets, weather, task_row, seen, achieved, flying)
    left, step = count, 0
    while left > 0:
        still = 0
        for j in range(left):
            i = flying[j]
            episode = start + i
            place = offsets[episode] + step
            if law != _RECORDED:
                row, goal = 0 if law_for_all else episode, load_goal(shown_goals, episode)
                write_action(law, law_rows, row, seen, i, goal, memories, scheme.time_step, actions, place)
            for k in range(width):
                commands[i, k] = actions[place, k] / (_GUIDANCE_SCALE[k] if width == 3 else _SURFACE_SCALE[k])
            if recording:
                observations[place] = seen[i]
            here = load_conditions(weather, 0 if weather.shape[0] == 1 else i)
            fly_row(rows, memories, targets, commands, here, scheme, task, seen, achieved, report, happened, i)
            if recording:
                rewards[place] = report[i, 0]
                events[place] = happened[i]
                load_factors[place] = report[i, _LOAD_FACTOR]
                deflections[place] = rows[i, _AILERON : _AILERON + _DEFLECTIONS] * _DEFLECTION_SCALE
            if happened[i] != 0 or place + 1 == offsets[episode + 1]:
                lengths[episode] = step + 1
                last_events[episode] = happened[i]
                if recording:
                    final_observations[episode] = seen[i]
            else:
                flying[still] = i
                still += 1
        left = still
        step += 1


class Flown(NamedTuple):
    """What became of a batch of goals."""

    episodes: Episodes
    """The flights that reached their goals, in the order of the goals."""
    last_events: NDArray[np.int64]
    """`Event` bits that each flight ended with, those that failed included, shape (E,)."""


def replay(
    scenario: Scenario,
    goals: ArrayLike,
    actions: NDArray[np.float32],
    offsets: NDArray[np.int64],
    *,
    seeds: ArrayLike = 0,
    sources: ArrayLike = "",
    starts: NDArray[np.float64] | None = None,
    threads: int | None = None,
) -> Episodes:
    """Fly recorded actions. An episode ends at its first event, though actions may be left then.

    Args:
        scenario: rules, settings, start and conditions.
        goals: shape (E, 3): speed in m/s, path angle and azimuth in degrees.
        actions: shape (N, 3) or (N, 4), float32, in the units of the action space.
        offsets: shape (E + 1,): where each episode's actions begin, and N.
        seeds: one for all or shape (E,).
        sources: one for all or shape (E,): where the flights came from.
        starts: full states, shape (E, F); the scenario's start by default.
        threads: at most so many; by default all cores. The result does not depend on them.

    Raises:
        ValueError: for shapes that do not fit together, an episode without actions, NaN, or goals that are none.
    """
    targets = np.atleast_2d(checked_goals(goals))
    _check(scenario, targets, actions, offsets)
    count, total = len(targets), len(actions)
    flight = _Flight(scenario, targets, np.broadcast_to(np.asarray(seeds, dtype=np.int64), count), starts)
    record = _make_record(total, count)
    lengths, _ = flight.fly(RECORDED, offsets, actions, record, threads)
    episodes = Episodes(
        scenario,
        targets,
        flight.seeds,
        np.broadcast_to(np.asarray(sources, dtype=np.str_), count),
        flight.starts,
        offsets,
        actions=actions,
        **record._asdict(),
    )
    return episodes if (lengths == episodes.lengths).all() else _cut(episodes, lengths)


def fly_law(
    scenario: Scenario,
    goals: ArrayLike,
    figures: Figures = APPENDIX_C,
    *,
    seeds: ArrayLike = 0,
    source: str | None = None,
    threads: int | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Flown:
    """Fly every goal by a law, as it answers to observations, and keep the flights that reach.

    Args:
        scenario: rules, settings, start and conditions; guidance mode.
        goals: shape (E, 3): speed in m/s, path angle and azimuth in degrees.
        figures: the law's parameters; or manoeuvres, shape (E, `vvc_bench.experts.manoeuvre.WIDTH`).
        seeds: one for all or shape (E,).
        source: what the episodes are labelled with; by default the law's name.
        threads: at most so many; by default all cores. The result does not depend on them.
        progress: told how many goals have been flown since it was last told.

    Raises:
        ValueError: for another control mode, goals that are none, or not as many manoeuvres as goals.
    """
    if scenario.settings.control_mode != "guidance":
        raise ValueError(f"a guidance law needs control_mode='guidance', got {scenario.settings.control_mode!r}")
    targets = np.atleast_2d(checked_goals(goals))
    every_seed = np.broadcast_to(np.asarray(seeds, dtype=np.int64), len(targets))
    pilot, room = make_pilot(figures), int(scenario.task.step_limit)
    if len(pilot.rows) not in (1, len(targets)):
        raise ValueError(f"need one manoeuvre for all or one for each of {len(targets)} goals, got {len(pilot.rows)}")
    parts, events = [], []
    for first in range(0, len(targets), _BLOCK):
        block = slice(first, first + _BLOCK)
        flight = _Flight(scenario, targets[block], every_seed[block], None)
        count = len(flight.goals)
        actions = np.empty((count * room, len(GuidanceCommand._fields)), dtype=np.float32)
        mine = pilot if len(pilot.rows) == 1 else pilot._replace(rows=pilot.rows[block])
        lengths, last_events = flight.fly(mine, np.arange(count + 1) * room, actions, _make_record(0, 0), threads)
        reached = np.flatnonzero(last_events & int(Event.REACH_TARGET))
        flown = np.concatenate([actions[e * room : e * room + lengths[e]] for e in reached] or [actions[:0]])
        offsets = np.concatenate([[0], np.cumsum(lengths[reached])])
        kept = flight.goals[reached], flown, offsets
        sources = pilot.source if source is None else source
        parts.append(replay(scenario, *kept, seeds=flight.seeds[reached], sources=sources, threads=threads))
        events.append(last_events)
        progress(count)
    return Flown(concatenate(parts), np.concatenate(events))


class _Flight(NamedTuple):
    """A batch about to be flown."""

    scenario: Scenario
    goals: NDArray[np.float64]
    seeds: NDArray[np.int64]
    given_starts: NDArray[np.float64] | None

    @property
    def starts(self) -> NDArray[np.float64]:
        if self.given_starts is not None:
            return self.given_starts
        start = self.scenario.start
        return np.broadcast_to(start, (len(self.goals), start.size))

    def fly(
        self,
        pilot: Pilot,
        offsets: NDArray[np.int64],
        actions: NDArray[np.float32],
        record: "_Record",
        threads: int | None,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Lengths and last events; actions, or the record's arrays, are written in place."""
        count, scenario = len(self.goals), self.scenario
        lengths, last_events = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        inside = (
            np.ascontiguousarray(self.starts),
            self.goals / SCALE,
            self.goals.astype(np.float32) / SCALE,
            int(pilot.law),
            pilot.rows,
            scenario.condition_rows(self.seeds),
            scenario.settings.row,
            task_row(scenario.task),
            len(Memory._fields) + window_width(scenario.task),
        )

        def work(first: int, last: int) -> None:
            for start in range(first * SIDE_BY_SIDE, min(last * SIDE_BY_SIDE, count), SIDE_BY_SIDE):
                stop = min(start + SIDE_BY_SIDE, count)
                _fly_episodes(*inside, offsets, actions, lengths, last_events, *record, start, stop)

        for_each_chunk(work, -(-count // SIDE_BY_SIDE), threads or available_threads(), _ONE_SHARE)
        return lengths, last_events


class _Record(NamedTuple):
    """Columns of `Episodes` that flying fills."""

    observations: NDArray[np.float32]
    final_observations: NDArray[np.float32]
    rewards: NDArray[np.float32]
    events: NDArray[np.uint8]
    deflections: NDArray[np.float32]
    load_factors: NDArray[np.float32]


def _make_record(transitions: int, episodes: int) -> _Record:
    return _Record(
        np.empty((transitions, _OBSERVED), dtype=np.float32),
        np.empty((episodes, _OBSERVED), dtype=np.float32),
        np.empty(transitions, dtype=np.float32),
        np.empty(transitions, dtype=np.uint8),
        np.empty((transitions, _DEFLECTIONS), dtype=np.float32),
        np.empty(transitions, dtype=np.float32),
    )


def _cut(episodes: Episodes, lengths: NDArray[np.int64]) -> Episodes:
    """The episodes without the transitions after their ends."""
    inside = np.arange(len(episodes.rewards)) - np.repeat(episodes.offsets[:-1], episodes.lengths)
    kept = inside < np.repeat(lengths, episodes.lengths)
    columns = {name: getattr(episodes, name)[kept] for name in PER_TRANSITION}
    return dataclasses.replace(episodes, offsets=np.concatenate([[0], np.cumsum(lengths)]), **columns)


def _check(
    scenario: Scenario, goals: NDArray[np.float64], actions: NDArray[np.float32], offsets: NDArray[np.int64]
) -> None:
    width = scenario.settings.command_width
    if actions.ndim != 2 or actions.shape[1] != width or actions.dtype != np.float32:
        raise ValueError(f"actions must be float32 of shape (N, {width}), got {actions.dtype} {actions.shape}")
    lengths = np.diff(offsets)
    fits = offsets.shape == (len(goals) + 1,) and offsets[0] == 0 and offsets[-1] == len(actions)
    if not fits or (lengths < 1).any():
        raise ValueError(
            f"offsets must rise from 0 to {len(actions)} in {len(goals) + 1} values, one more than there are goals; "
            f"got {len(offsets)} values from {offsets[0]} to {offsets[-1]}, least length {lengths.min(initial=0)}"
        )
    if np.isnan(actions).any():
        raise ValueError(f"action {int(np.argwhere(np.isnan(actions))[0][0])} is NaN; actions must be numbers")
