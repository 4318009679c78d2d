"""Fly a policy, a fixed chunk of aircraft at a time, and measure every flight.

A policy is asked about the aircraft of a chunk together, in the same rows until the last of them is done: those that
are done show what was seen of them last, and a chunk that is not full shows its last aircraft again. So what a policy
computes, to the last bit, does not depend on threads or on how many chunks fly at once.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench import metrics, sim
from vvc_bench.envs.fleet import Fleet
from vvc_bench.envs.sub_goals import SubGoalFleet
from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.protocols import Protocol
from vvc_bench.policies import Agent
from vvc_bench.rollout import Episodes, Policy, Scenario
from vvc_bench.sim.episodes import REPORT
from vvc_bench.sim.fields import Observation, State, SurfaceCommand, columns, field_array
from vvc_bench.sim.task import Event
from vvc_bench.tasks import termination

CHUNK = 256
"""Aircraft that a policy is asked about together."""

_DEFLECTION_SCALE = field_array(SurfaceCommand, "scale")
_AILERON = State._fields.index("aileron")
_DEFLECTIONS = slice(_AILERON, _AILERON + len(SurfaceCommand._fields))
_ALTITUDE = State._fields.index("altitude")
_CLIPPED = State._fields.index("clipped_commands")
_REWARD, _DIRECTION_ERROR, _LOAD_FACTOR = map(REPORT.index, ("reward", "direction_error_deg", "load_factor_g"))
_REACHED = int(Event.REACH_TARGET)


class Chunk(NamedTuple):
    """Flights of one scenario that are flown together."""

    protocol: Protocol
    seed: int
    condition: int
    goals: NDArray[np.int64]
    """Indices in the protocol, 1 to `CHUNK` of them."""

    @property
    def scenario(self) -> Scenario:
        """With its conditions."""
        return self.protocol.scenarios[self.condition]


def chunks(protocol: Protocol, seed: int) -> Iterator[Chunk]:
    """Every flight of an evaluation with one seed, once."""
    for condition in range(len(protocol.conditions)):
        alike = np.arange(condition, len(protocol), len(protocol.conditions))
        for first in range(0, len(alike), CHUNK):
            yield Chunk(protocol, seed, condition, alike[first : first + CHUNK])


class Flights(NamedTuple):
    """A chunk flown: what `Episodes` hold, and what they do not."""

    episodes: Episodes
    direction_errors_deg: NDArray[np.float64]
    minimum_altitudes_m: NDArray[np.float64]
    clipped_commands: NDArray[np.int64]
    sub_goals_reached: NDArray[np.int64]


def fly_chunk(agent: Agent, chunk: Chunk) -> Flights:
    """Fly a chunk to the end.

    Raises:
        ValueError: for actions of another shape, or NaN; names the goal and the step.
    """
    count = len(chunk.goals)
    fleet = begun_fleet(chunk, chunk.goals)
    begun = fleet.rows.copy()
    seeds = chunk.protocol.episode_seeds(chunk.seed)[chunk.goals]
    policy = agent.begin(_filled(seeds))
    shown = {name: _filled(values) for name, values in seen(fleet).items()}
    log = _Log(int(chunk.scenario.task.step_limit), fleet.commands.shape)
    final = _Final(count)
    lowest = begun[:, _ALTITUDE].copy()
    rows = np.arange(count)
    while rows.size and log.steps < len(log.rewards):
        actions = _asked(policy, shown, rows, chunk, log.steps)
        before = fleet.observations.copy()
        fleet.step(actions, threads=1)
        log.note(rows, before, actions, fleet)
        lowest[rows] = np.minimum(lowest[rows], fleet.rows[:, _ALTITUDE])
        for name, values in seen(fleet).items():
            shown[name][rows] = values
        over = fleet.events != 0
        if over.any():
            final.note(rows, over, fleet, log.steps)
            fleet.keep(~over)
            rows = rows[~over]
    episodes = _episodes(chunk, seeds, begun, log, final)
    return Flights(episodes, final.direction_errors_deg, lowest, final.clipped, final.reached)


def _filled(values: NDArray[Any]) -> NDArray[Any]:
    """A row for every aircraft of a full chunk."""
    return np.concatenate([values, np.repeat(values[-1:], CHUNK - len(values), axis=0)])


def begun_fleet(chunk: Chunk, goals: NDArray[np.int64]) -> Fleet:
    """Aircraft at the start of some of a chunk's flights."""
    protocol, scenario, count = chunk.protocol, chunk.scenario, len(goals)
    conditions = scenario.condition_rows(protocol.episode_seeds(chunk.seed)[goals])
    targets = protocol.goals[goals]
    fleet = Fleet(count, scenario.task, scenario.settings, targets, scenario.start, conditions)
    if protocol.starts is None:
        fleet.begin(np.arange(count), targets)
        return fleet
    altitudes, speeds, headings = protocol.starts[goals].T
    starts = sim.start(
        scenario.settings,
        altitude_m=altitudes,
        speed_mps=speeds,
        heading_deg=headings,
        conditions=np.broadcast_to(conditions, (count, conditions.shape[1])),
    )
    fleet = SubGoalFleet(fleet, protocol.sub_goals)
    fleet.begin(np.arange(count), states=starts)
    return fleet


def seen(fleet: Fleet) -> dict[str, NDArray[np.float32]]:
    """What is observed, in arrays that a policy may do with what it likes."""
    return {
        "observation": fleet.observations.copy(),
        "achieved_goal": fleet.achieved.copy(),
        "desired_goal": fleet.desired.copy(),
    }


def _asked(
    policy: Policy, shown: dict[str, NDArray[np.float32]], rows: NDArray[np.int64], chunk: Chunk, step: int
) -> NDArray[np.float32]:
    """The policy's actions for the rows that fly."""
    answer = np.asarray(policy({name: values.copy() for name, values in shown.items()}))
    expected = (CHUNK, chunk.scenario.settings.command_width)
    kind = list(columns(chunk.scenario.settings.command_fields))
    if answer.shape != expected:
        raise ValueError(
            f"the policy must answer with actions of shape {expected}: {', '.join(kind)}; at step {step} of goals "
            f"{chunk.goals[0]} to {chunk.goals[-1]} it gave shape {answer.shape}"
        )
    actions = answer[rows].astype(np.float32)
    if np.isnan(actions).any():
        row, component = np.argwhere(np.isnan(actions))[0]
        place = chunk.goals[rows[row]]
        goal = ", ".join(f"{value:g}" for value in chunk.protocol.goals[place])
        raise ValueError(
            f"the policy's {kind[component]} is NaN at step {step} of goal {place} ({goal}); actions must be numbers"
        )
    return actions


class _Log:
    """What happened in each step, in arrays of shape (steps, flights, …)."""

    def __init__(self, limit: int, commands: tuple[int, ...]) -> None:
        count, width = commands
        self.steps = 0
        self.observations = np.empty((limit, count, len(Observation._fields)), dtype=np.float32)
        self.actions = np.empty((limit, count, width), dtype=np.float32)
        self.rewards = np.empty((limit, count), dtype=np.float32)
        self.events = np.empty((limit, count), dtype=np.uint8)
        self.deflections = np.empty((limit, count, len(SurfaceCommand._fields)), dtype=np.float32)
        self.load_factors = np.empty((limit, count), dtype=np.float32)

    def note(
        self, rows: NDArray[np.int64], before: NDArray[np.float32], actions: NDArray[np.float32], fleet: Fleet
    ) -> None:
        step = self.steps
        self.observations[step, rows] = before
        self.actions[step, rows] = actions
        self.rewards[step, rows] = fleet.report[:, _REWARD]
        self.events[step, rows] = fleet.events
        self.deflections[step, rows] = fleet.rows[:, _DEFLECTIONS] * _DEFLECTION_SCALE
        self.load_factors[step, rows] = fleet.report[:, _LOAD_FACTOR]
        self.steps += 1


class _Final:
    """What was the case in the step that ended each flight."""

    def __init__(self, count: int) -> None:
        self.lengths = np.zeros(count, dtype=np.int64)
        self.observations = np.zeros((count, len(Observation._fields)), dtype=np.float32)
        self.direction_errors_deg = np.zeros(count)
        self.clipped = np.zeros(count, dtype=np.int64)
        self.reached = np.zeros(count, dtype=np.int64)

    def note(self, rows: NDArray[np.int64], over: NDArray[np.bool_], fleet: Fleet, steps: int) -> None:
        ended = rows[over]
        self.lengths[ended] = steps
        self.observations[ended] = fleet.observations[over]
        self.direction_errors_deg[ended] = fleet.report[over, _DIRECTION_ERROR]
        self.clipped[ended] = fleet.rows[over, _CLIPPED]
        single = (fleet.events & _REACHED) != 0
        self.reached[ended] = (fleet.reached if isinstance(fleet, SubGoalFleet) else single)[over]


def _episodes(
    chunk: Chunk, seeds: NDArray[np.int64], starts: NDArray[np.float64], log: _Log, final: _Final
) -> Episodes:
    """One flight after another."""
    flown = np.arange(log.steps) < final.lengths[:, None]

    def in_turn(values: NDArray[Any]) -> NDArray[Any]:
        return values[: log.steps].swapaxes(0, 1)[flown]

    transitions = ("observations", "actions", "rewards", "events", "deflections", "load_factors")
    return Episodes(
        chunk.scenario,
        chunk.protocol.goals[chunk.goals],
        seeds,
        np.full(len(seeds), "policy"),
        starts,
        np.concatenate([[0], np.cumsum(final.lengths)]),
        final_observations=final.observations,
        **{name: in_turn(getattr(log, name)) for name in transitions},
    )


def measured(flights: Flights, chunk: Chunk, best: metrics.BestLengths | None) -> dict[str, NDArray[Any]]:
    """Every column of `columns.episode_columns` for the flights of a chunk."""
    episodes = flights.episodes
    count = len(episodes)
    errors = metrics.final_errors(episodes)
    endings = [termination(chunk.scenario.task, int(events)) for events in episodes.final_events]
    table: dict[str, NDArray[Any]] = {
        names.SEED: np.full(count, chunk.seed),
        names.GOAL: chunk.goals,
        names.CONDITION: np.full(count, chunk.condition),
        **dict(zip(names.GOAL_OF_EPISODE, episodes.goals.T, strict=True)),
        names.SUCCESS: episodes.reached,
        names.TERMINATION: np.array(endings, dtype=np.str_),
        names.LENGTH: episodes.lengths,
        names.RETURN: metrics.returns(episodes),
        **dict(zip(names.ERRORS, (*errors.T, flights.direction_errors_deg), strict=True)),
        names.MINIMUM_ALTITUDE: flights.minimum_altitudes_m,
        names.MAXIMUM_LOAD: np.maximum.reduceat(episodes.load_factors, episodes.offsets[:-1]).astype(np.float64),
        names.CLIPPED: flights.clipped_commands,
        names.SUB_GOALS_REACHED: flights.sub_goals_reached,
        names.TIME_RATIO: np.full(count, np.nan) if best is None else metrics.length_ratios(episodes, best),
    }
    return table | _wear_and_smoothness(episodes)


def _wear_and_smoothness(episodes: Episodes) -> dict[str, NDArray[Any]]:
    worn = metrics.episode_wear(episodes)
    smooth = metrics.action_smoothness(episodes)
    return (
        {names.at_bounds(name): values for name, values in worn.at_bounds_percent.items()}
        | {names.travel(name): values for name, values in worn.travel_per_s.items()}
        | {names.smoothness("s1", name): smooth.s1[:, k] for k, name in enumerate(smooth.columns)}
        | {names.smoothness("s2", name): smooth.s2[:, k] for k, name in enumerate(smooth.columns)}
    )
