"""Goals one after another within one episode, as in the paper's Fig. 5: a turn, an acceleration, a climb."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.envs.environment import Observed, VelocityVectorEnv
from vvc_bench.envs.fleet import Fleet
from vvc_bench.goals import checked_goals
from vvc_bench.sim.task import Event

TURN_CLIMB = ((200.0, 0.0, 60.0), (225.0, 0.0, 60.0), (225.0, 15.0, 60.0))
"""Level turn, straight acceleration, climb: speed in m/s, path angle and azimuth in degrees. The paper's Fig. 5 names
the three parts and not their figures; these are ours."""


class SubGoalFleet(Fleet):
    """A fleet whose aircraft get the next sub-goal in the step that reaches one; only the last ends an episode.

    Where a sub-goal but the last is reached, no event but the time limit is reported: success comes before failure, as
    everywhere.

    Args:
        fleet: whose aircraft and arrays these become.
        sub_goals: shape (K, 3), in outside units.

    Raises:
        ValueError: for goals that are none.
    """

    def __init__(self, fleet: Fleet, sub_goals: ArrayLike) -> None:
        vars(self).update(vars(fleet))
        self.sub_goals = np.atleast_2d(checked_goals(sub_goals))
        self.reached = np.zeros(self.count, dtype=np.int64)

    def begin(
        self, which: NDArray[np.int64], goals: ArrayLike | None = None, states: NDArray[np.float64] | None = None
    ) -> None:
        """Begin episodes with the first sub-goal.

        Raises:
            ValueError: for other goals.
        """
        if goals is not None:
            raise ValueError("the goals of this task are its sub-goals; options['goal'] cannot be given")
        super().begin(which, self.sub_goals[0], states)
        self.reached[which] = 0

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Go on with some of the aircraft alone."""
        super().keep(which)
        self.reached = self.reached[which]

    def step(self, actions: ArrayLike, threads: int | None = None) -> None:
        """Fly every aircraft one step, those that reach a sub-goal towards the next."""
        super().step(actions, threads)
        self._go_on()

    def step_one(self, action: ArrayLike) -> None:
        """Fly a fleet of one by one step, towards the next sub-goal if this one is reached."""
        super().step_one(action)
        self._go_on()

    def _go_on(self) -> None:
        """Give the next sub-goal to those that have just reached one."""
        there = np.flatnonzero(self.events & int(Event.REACH_TARGET))
        if not there.size:
            return
        self.reached[there] = np.minimum(self.reached[there] + 1, len(self.sub_goals))
        onward = there[self.reached[there] < len(self.sub_goals)]
        self.events[onward] &= int(Event.TIME_LIMIT)
        self.set_goals(onward, self.sub_goals[self.reached[onward]])


class SubGoalsEnv(VelocityVectorEnv):
    """Reaching a goal gives the next one; reaching the last ends the episode with success.

    Infos say how many are reached, ``sub_goals_reached``; ``is_success`` is about the last. Errors and reward of a step
    are those towards the goal that it was flown to; the observation has the next. The step limit is the whole
    episode's.

    Args:
        sub_goals: shape (K, 3): speed in m/s, path angle and azimuth in degrees.
        **options: as for `VelocityVectorEnv`, but no ``goals``.

    Raises:
        ValueError: for goals that are none, or no goal at all.
    """

    fleet: SubGoalFleet

    def __init__(self, *, sub_goals: ArrayLike = TURN_CLIMB, **options: Any) -> None:
        super().__init__(goals=sub_goals, **options)
        self.fleet = SubGoalFleet(self.fleet, sub_goals)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin with the first sub-goal; ``options["goal"]`` is not for this task."""
        observation, info = super().reset(seed=seed, options=options)
        return observation, info | {"sub_goals_reached": 0}

    def step(self, action: ArrayLike) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Fly one step, towards the next sub-goal if this one is reached."""
        observation, reward, terminated, truncated, info = super().step(action)
        info["sub_goals_reached"] = self.fleet.reached.item()
        return observation, reward, terminated, truncated, info
