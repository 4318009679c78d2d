"""The one core under every environment: N aircraft, their episodes, and their own random generators."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench import sim
from vvc_bench.goals import SCALE, GoalDistribution, as_distribution, checked_goals
from vvc_bench.sim.episodes import REPORT, begin_rows, fly_rows
from vvc_bench.sim.fields import Goal, Observation
from vvc_bench.sim.parallel import available_threads, for_each_chunk
from vvc_bench.sim.stepping import smallest_share
from vvc_bench.sim.task import Events, Memory, Task, outcomes, window_width
from vvc_bench.tasks import task_row

_KEPT = np.array([Memory._fields.index(name) for name in ("steps", "rolled", "steps_negative_load")])
"""What is remembered although the goal changes."""

_PER_AIRCRAFT = ("rows", "memories", "goals", "observations", "achieved", "desired", "report", "events", "commands")


class Fleet:
    """N aircraft in episodes of one task. Arrays are the fleet's own: environments hand out copies.

    Args:
        count: how many aircraft.
        task: the rules.
        settings: how they fly.
        goals: where new goals come from; may be replaced at any time.
        start: state rows that episodes begin from, shape (F,).
        conditions: shape (1, C) or (count, C).
    """

    def __init__(
        self,
        count: int,
        task: Task,
        settings: sim.Settings,
        goals: object,
        start: NDArray[np.float64],
        conditions: NDArray[np.float64],
    ) -> None:
        self.count = count
        self.task = task
        self.settings = settings
        self.distribution: GoalDistribution = as_distribution(goals)
        self.start = start
        self.conditions = conditions
        self.generators: list[np.random.Generator] = []
        self._task_row = task_row(task)
        self.rows = np.tile(start, (count, 1))
        self.memories = np.zeros((count, len(Memory._fields) + window_width(task)))
        self.goals = np.zeros((count, len(Goal._fields)))
        self.observations = np.zeros((count, len(Observation._fields)), dtype=np.float32)
        self.achieved = np.zeros((count, 3), dtype=np.float32)
        self.desired = np.zeros((count, 3), dtype=np.float32)
        self.report = np.zeros((count, len(REPORT)))
        self.events = np.zeros(count, dtype=np.int64)
        self.commands = np.zeros((count, settings.command_width))

    def seed(self, seeds: Sequence[int | None]) -> None:
        """One generator for each aircraft; an aircraft alone and one among many draw the same."""
        self.generators = [np.random.default_rng(seed) for seed in seeds]

    def begin(
        self, which: NDArray[np.int64], goals: ArrayLike | None = None, states: NDArray[np.float64] | None = None
    ) -> None:
        """Begin episodes for some aircraft, with drawn goals and the usual start unless given."""
        if goals is None:
            goals = [self.distribution.sample(self.generators[i]) for i in which]
        self.rows[which] = self.start if states is None else states
        self._aim(which, np.broadcast_to(checked_goals(goals), (len(which), 3)))
        self._begin(which)

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Go on with some of the aircraft alone.

        Args:
            which: shape (count,).
        """
        for name in _PER_AIRCRAFT:
            setattr(self, name, getattr(self, name)[which])
        if len(self.conditions) > 1:
            self.conditions = self.conditions[which]
        self.generators = [generator for generator, kept in zip(self.generators, which, strict=False) if kept]
        self.count = len(self.rows)

    def set_goals(self, which: NDArray[np.int64], goals: ArrayLike) -> None:
        """Change goals within the episode: the step count goes on, what counts towards reaching starts anew."""
        self._aim(which, np.broadcast_to(checked_goals(goals), (len(which), 3)))
        kept = self.memories[np.ix_(which, _KEPT)]
        self._begin(which)
        self.memories[np.ix_(which, _KEPT)] = kept

    def _begin(self, which: NDArray[np.int64]) -> None:
        begin_rows(
            self.rows,
            self.memories,
            self.goals,
            self.conditions,
            self._task_row,
            self.observations,
            self.achieved,
            which,
        )

    def _fly(self, actions: NDArray[np.float32], start: int, stop: int) -> bool:
        return fly_rows(
            self.rows,
            self.memories,
            self.goals,
            actions,
            self.commands,
            self.conditions,
            self.settings.row,
            self._task_row,
            self.observations,
            self.achieved,
            self.report,
            self.events,
            start,
            stop,
        )

    def _aim(self, which: NDArray[np.int64], goals: NDArray[np.float64]) -> None:
        self.goals[which] = goals / SCALE
        self.desired[which] = goals

    def step(self, actions: ArrayLike, threads: int | None = None) -> None:
        """Fly every aircraft one step.

        Args:
            actions: shape (N, 3) or (N, 4), in the units of the action space; clipped to it and counted.
            threads: at most so many.

        Raises:
            ValueError: for another shape, or NaN; nothing is changed then.
        """
        checked = np.ascontiguousarray(actions, dtype=np.float32)
        self._check_shape(checked)
        if np.isnan(checked).any():
            raise _nan_action(checked, self.settings)

        def work(start: int, stop: int) -> None:
            self._fly(checked, start, stop)

        for_each_chunk(work, self.count, threads or available_threads(), smallest_share(self.settings))

    def step_one(self, action: ArrayLike) -> None:
        """Fly a fleet of one by one step: the same for one action, without what only many need."""
        actions = np.array(action, dtype=np.float32, ndmin=2)
        self._check_shape(actions)
        if not self._fly(actions, 0, 1):
            raise _nan_action(actions, self.settings)

    def _check_shape(self, actions: NDArray[np.float32]) -> None:
        if actions.shape != self.commands.shape:
            names = ", ".join(sim.columns(self.settings.command_fields))
            raise ValueError(f"actions must have shape {self.commands.shape}: {names}; got {actions.shape}")

    def outcomes(self, events: Events) -> tuple[Any, Any]:
        """``terminated`` and ``truncated`` for one aircraft's events, or for an array of them."""
        return outcomes(self.task, events)


def _nan_action(actions: NDArray[np.float32], settings: sim.Settings) -> ValueError:
    aircraft, component = np.argwhere(np.isnan(actions))[0]
    name = list(sim.columns(settings.command_fields))[component]
    return ValueError(f"action {name!r} of aircraft {aircraft} is NaN; actions must be numbers")
