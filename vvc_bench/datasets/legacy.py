"""Flights that the paper's public code wrote down, as episodes.

What the rows mean, and what they leave out:

- A row holds an action and the state *after* it: both of the public writers read the state after the step (the PID's
  through a dictionary that the step overwrites). The public loader takes row t's state for what was seen before row
  t's action; here each action goes with the state before it. Rows that begin at the very start, and so hold the state
  before the action, are recognised by that.
- The start is not recorded. The public code flies from level trim at 5,000 m and 200 m/s, due north; the actions are
  flown again from there, and how many flights come out the same is reported.
- Rewards and events are judged anew from the states (`vvc_bench.sim.task`); a flight that our rules do not count as
  reached ends without an event. Load factors and deflections are unknown: NaN.
- Flights that were mirrored (the sets with a bar) are no flights of the aircraft, which is not symmetric
  (docs/asymmetry.md): flown again they come out different.
"""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.catalogue import PAPER_GRID, PID
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.recordings import Recordings, read_recordings
from vvc_bench.datasets.store import Description, open_dataset, write_dataset
from vvc_bench.goals import SCALE, checked_goals
from vvc_bench.jit import entry_point
from vvc_bench.metrics import summary
from vvc_bench.rollout import Episodes, Scenario, replay
from vvc_bench.sim.fields import Goal, Observation, State, SurfaceCommand, columns, field_array
from vvc_bench.sim.rows import load_goal, load_state, load_task
from vvc_bench.sim.task import Memory, Rules, fresh_memory, judge, judge_demonstration, window_width
from vvc_bench.tasks import task_row

_START_TOLERANCE = 1e-4  # of a recorded start, in outside units; one step changes the speed by 0.1 m/s and more
_SAME = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 1.0, 1.0])
"""Flown again, a state is the same if it parts from the recorded one by less: 0.1° or m/s, 1°/s, 1 m."""

_SPEED = Observation._fields.index(Goal._fields[0])
_VELOCITY = slice(_SPEED, _SPEED + len(Goal._fields))
_TURNING = np.array([field.unit.outside == "deg" for field in columns(Observation).values()])
_SCALE, _LOW, _HIGH = (field_array(Observation, attribute) for attribute in ("scale", "low", "high"))
_SEEN = np.array([State._fields.index(name) for name in Observation._fields])
_ROLL = State._fields.index("roll")
_MEMORY = len(Memory._fields)


class Imported(NamedTuple):
    """Recordings as episodes, and what was found out about them."""

    episodes: Episodes
    report: dict[str, Any]


def import_recordings(path: Path | str, folder: Path | str, *, scenario: Scenario | None = None) -> Dataset:
    """Make a dataset of flights that the public code wrote.

    Args:
        path: a folder or an archive (zip, tar) of its CSV files, or one table (CSV, Parquet).
        folder: the dataset's; its last part is the dataset's name.
        scenario: by what rules flights are judged; by default those of ``pid-v0``.

    Raises:
        UnknownLayoutError: if it is in none of the layouts of `vvc_bench.datasets.recordings`; says what was found.
        ValueError: for values that are no numbers, or a hostile archive.
        OSError: if it cannot be read or written.
    """
    path, folder = Path(path), Path(folder)
    write_imported(read_recordings(path), folder, name=folder.name, origin=path.name, scenario=scenario)
    return open_dataset(folder)


def write_imported(
    recordings: Recordings, folder: Path, *, name: str, origin: str, scenario: Scenario | None = None
) -> None:
    """Write recordings as a dataset whose manifest says that it was imported, and what is not known of it.

    Args:
        recordings: what was read.
        folder: where to; it must not be there yet.
        name: of the dataset.
        origin: where the recordings came from.
        scenario: by what rules flights are judged; by default those of ``pid-v0``.
    """
    imported = to_episodes(recordings, scenario or PID, name)
    goals_flown = _goals_flown(recordings, imported.episodes)
    reached = int(imported.episodes.reached.sum())
    description = Description(
        name=name,
        specification={"imported": {"from": origin, **imported.report}},
        seed=0,
        last_events={"reach_target": reached, "none": len(imported.episodes) - reached},
        goals_flown=len(goals_flown),
        metrics=summary(imported.episodes, goals_flown).to_json(),
    )
    write_dataset(folder, imported.episodes, description)


def to_episodes(recordings: Recordings, scenario: Scenario, source: str) -> Imported:
    """Recordings as episodes, judged by a scenario's rules, and how far they part from the same actions flown here.

    Args:
        recordings: what was read.
        scenario: rules, start and way of flying; its frequency gives way to the recorded one.
        source: what every episode's ``source`` says.

    Raises:
        ValueError: for goals that are out of bounds.
    """
    if recordings.frequency_hz is not None:
        settings = dataclasses.replace(scenario.settings, frequency_hz=recordings.frequency_hz)
        scenario = dataclasses.replace(scenario, settings=settings)
    flights, before = _aligned(recordings, _start_seen(scenario))
    goals = flights.goals if flights.goals is not None else _achieved(flights, int(scenario.task.reach_steps))
    rewards, events = _judged(scenario, goals, flights.states, flights.offsets)
    last = flights.offsets[1:] - 1
    final_events = np.zeros_like(events)
    final_events[last] = events[last]
    observations = _before(flights.states, flights.offsets, _start_seen(scenario))
    count, steps = len(goals), len(flights.states)
    episodes = Episodes(
        scenario,
        goals,
        seeds=np.zeros(count, dtype=np.int64),
        sources=np.full(count, source),
        starts=np.tile(scenario.start, (count, 1)),
        offsets=flights.offsets,
        observations=_observed(observations),
        final_observations=_observed(flights.states[last]),
        actions=flights.actions.astype(np.float32),
        rewards=rewards,
        events=final_events,
        deflections=np.full((steps, len(SurfaceCommand._fields)), np.nan, dtype=np.float32),
        load_factors=np.full(steps, np.nan, dtype=np.float32),
    )
    report = {
        **recordings.notes,
        "rows_hold": "the state before the action" if before else "the state after the action",
        "goals": "as recorded" if flights.goals is not None else "not recorded: the mean velocity of the last second",
        "assumed": ["start", "dynamics", *([] if recordings.frequency_hz else ["frequency_hz"])],
        "unknown": ["deflections", "load_factors"],
        "judged": {
            "reached_at_the_end": int(episodes.reached.sum()),
            "ended_earlier": int((np.add.reduceat(events != final_events, flights.offsets[:-1]) > 0).sum()),
        },
        "reflown": _reflown(episodes),
    }
    return Imported(episodes, report)


def _goals_flown(recordings: Recordings, episodes: Episodes) -> NDArray[np.float64]:
    """All goals that were tried: the index's, else the paper's grid if the flights' goals lie on it, else those."""
    on_grid = set(map(tuple, PAPER_GRID.goals.tolist()))
    if recordings.goals_flown is None and on_grid.issuperset(map(tuple, episodes.goals.tolist())):
        return PAPER_GRID.goals
    indexed = np.empty((0, 3)) if recordings.goals_flown is None else recordings.goals_flown
    return np.unique(np.concatenate([indexed, episodes.goals]), axis=0)


def _reflown(episodes: Episodes) -> dict[str, int]:
    """How many flights stay what they are when their actions are flown from the assumed start."""
    endless = dataclasses.replace(episodes.scenario, task=episodes.scenario.task._replace(terminations=0.0))
    again = replay(endless, episodes.goals, episodes.actions, episodes.offsets)
    apart = np.abs(again.next_observations.astype(np.float64) - episodes.next_observations)
    apart[:, _TURNING] = np.minimum(apart[:, _TURNING], 360.0 - apart[:, _TURNING])
    same: NDArray[np.bool_] = np.all(apart < _SAME, axis=1)
    judged_again = replay(episodes.scenario, episodes.goals, episodes.actions, episodes.offsets)
    return {
        "flights": len(episodes),
        "same_after_one_step": int(same[episodes.offsets[:-1]].sum()),
        "same_throughout": int(np.logical_and.reduceat(same, episodes.offsets[:-1]).sum()),
        "reaching": int(judged_again.reached.sum()),
    }


def _start_seen(scenario: Scenario) -> NDArray[np.float64]:
    """What the start looks like, shape (8,), in outside units."""
    seen: NDArray[np.float64] = scenario.start[_SEEN] * _SCALE
    return seen


def _aligned(recordings: Recordings, start: NDArray[np.float64]) -> tuple[Recordings, bool]:
    """The same with the state after each action, and whether the rows held the state before it.

    Where they did, the last action goes: what it led to was not written down.
    """
    first = recordings.states[recordings.offsets[:-1]]
    if not (np.abs(first - start) < _START_TOLERANCE).all():
        return recordings, False
    lengths = np.diff(recordings.offsets) - 1
    is_first, is_last = (np.zeros(len(recordings.states), dtype=np.bool_) for _ in range(2))
    is_first[recordings.offsets[:-1]] = is_last[recordings.offsets[1:] - 1] = True
    kept = lengths > 0
    goals = recordings.goals
    shifted = dataclasses.replace(
        recordings,
        goals=None if goals is None else goals[kept],
        offsets=np.concatenate([[0], np.cumsum(lengths[kept])]),
        states=recordings.states[~is_first],
        actions=recordings.actions[~is_last],
    )
    return shifted, True


def _before(states: NDArray[np.float64], offsets: NDArray[np.int64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the states after each action, those before it."""
    before = np.roll(states, 1, axis=0)
    before[offsets[:-1]] = start
    return before


def _observed(states: NDArray[np.float64]) -> NDArray[np.float32]:
    """States as observations: clipped to the bounds, as the environment clips them."""
    return np.clip(states, _LOW * _SCALE, _HIGH * _SCALE).astype(np.float32)


def _achieved(flights: Recordings, rows: int) -> NDArray[np.float64]:
    """The mean velocity, as a goal, of each flight's last rows."""
    goals = []
    for start, stop in zip(flights.offsets[:-1], flights.offsets[1:], strict=True):
        speed, path_angle, azimuth = flights.states[max(start, stop - rows) : stop, _VELOCITY].T
        turned = np.exp(1j * np.radians(azimuth)).mean()
        goals.append((speed.mean(), path_angle.mean(), np.degrees(np.angle(turned))))
    return checked_goals(goals)


def _judged(
    scenario: Scenario, goals: NDArray[np.float64], states: NDArray[np.float64], offsets: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    rewards, events = np.empty(len(states), dtype=np.float32), np.empty(len(states), dtype=np.uint8)
    task = scenario.task
    if task.rules == Rules.PUBLIC_CODE:
        raise ValueError("recordings are judged by the paper's or the demonstrations' rules, not by the public code's")
    _judge_rows(
        *(states / _SCALE, scenario.start.reshape(1, -1), goals / SCALE, task_row(task)),
        *(_MEMORY + window_width(task), offsets, rewards, events),
    )
    return rewards, events


@entry_point
def _judge_rows(
    reports: NDArray[np.float64],
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    task_values: NDArray[np.float64],
    memory_width: int,
    offsets: NDArray[np.int64],
    rewards: NDArray[np.float32],
    events: NDArray[np.uint8],
) -> None:
    """Judge reports of which only `Observation` is known; what depends on the load factor never happens."""
    task = load_task(task_values)
    rows = np.full((1, start.shape[1]), np.nan)
    window = np.zeros((1, memory_width))
    for e in range(len(goals)):
        goal, memory = load_goal(goals, e), fresh_memory(task, load_state(start, 0), load_goal(goals, e))
        roll = start[0, _ROLL]
        for t in range(offsets[e], offsets[e + 1]):
            for k in range(len(_SEEN)):
                rows[0, _SEEN[k]] = reports[t, k]
            after = load_state(rows, 0)
            if task.rules == 0.0:
                outcome = judge(task, memory, roll, after, goal)
            else:
                outcome = judge_demonstration(task, memory, window, 0, roll, after, goal)
            memory, roll = outcome.memory, after.roll
            rewards[t] = outcome.reward
            events[t] = outcome.events
