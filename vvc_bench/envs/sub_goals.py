"""Goals one after another within one episode, as in the paper's Fig. 5: a turn, an acceleration, a climb."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.envs.environment import Observed, VelocityVectorEnv
from vvc_bench.goals import checked_goals

TURN_CLIMB = ((200.0, 0.0, 60.0), (225.0, 0.0, 60.0), (225.0, 15.0, 60.0))
"""Level turn, straight acceleration, climb: speed in m/s, path angle and azimuth in degrees. The paper's Fig. 5 names
the three parts and not their figures; these are ours."""


class SubGoals(gymnasium.Wrapper[Observed, NDArray[np.float32], Observed, NDArray[np.float32]]):
    """Reaching a goal gives the next one; reaching the last ends the episode with success.

    Infos say how many are reached, ``sub_goals_reached``; ``is_success`` is about the last. The step limit is the
    whole episode's.

    Args:
        env: a `VelocityVectorEnv`.
        sub_goals: shape (K, 3), in outside units.

    Raises:
        TypeError: for another environment.
        ValueError: for goals that are none, or no goal at all.
    """

    def __init__(self, env: gymnasium.Env[Observed, NDArray[np.float32]], sub_goals: ArrayLike) -> None:
        super().__init__(env)
        if not isinstance(env.unwrapped, VelocityVectorEnv):
            raise TypeError(f"sub-goals need a VelocityVectorEnv, got {env.unwrapped!r}")
        self.sub_goals = np.atleast_2d(checked_goals(sub_goals))
        self._base = env.unwrapped
        self._reached = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin with the first sub-goal; ``options["goal"]`` is not for this task."""
        if options and "goal" in options:
            raise ValueError("the goals of this task are its sub-goals; options['goal'] cannot be given")
        self._reached = 0
        observation, info = self.env.reset(seed=seed, options={**(options or {}), "goal": self.sub_goals[0]})
        return observation, info | {"sub_goals_reached": 0}

    def step(self, action: NDArray[np.float32]) -> tuple[Observed, Any, bool, bool, dict[str, Any]]:
        """Fly one step, towards the next sub-goal if this one is reached."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if info["is_success"]:
            self._reached += 1
            if self._reached < len(self.sub_goals):
                observation = self._base.set_goal(self.sub_goals[self._reached])
                truncated = self._base.task.step_limit <= info["steps"]
                terminated = False
                info |= {"is_success": False, "termination": "time_limit" if truncated else ""}
        return observation, reward, terminated, truncated, info | {"sub_goals_reached": self._reached}


def make_turn_climb(sub_goals: Sequence[Sequence[float]] = TURN_CLIMB, **options: Any) -> SubGoals:
    """The environment ``VVC/TurnClimb-v0``: `TURN_CLIMB`, or other sub-goals, under the rules of ``VVC/Hard-v0``."""
    return SubGoals(VelocityVectorEnv(**options), sub_goals)
