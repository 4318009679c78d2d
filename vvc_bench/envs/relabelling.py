"""The goal part of the task for any achieved and desired goal, as hindsight relabelling needs it."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vvc_bench.envs.fleet import Fleet
from vvc_bench.goals import SCALE, GoalDistribution, as_distribution
from vvc_bench.sim.episodes import judge_goals
from vvc_bench.sim.task import Reward, Task
from vvc_bench.tasks import task_row


class Relabelling:
    """What the single and the vector environment share: where goals come from, and what pairs of goals are worth.

    `compute_reward` and its kin are as in Gymnasium-Robotics, for one pair of goals, shape (3,), or a batch, (N, 3).

    They see goals alone: whether a goal was *held*, and whether a flight failed, is not theirs to say
    (docs/environments.md).
    """

    task: Task
    fleet: Fleet

    @property
    def goals(self) -> GoalDistribution:
        """Where new goals come from; a curriculum may set another one at any time."""
        return self.fleet.distribution

    @goals.setter
    def goals(self, source: object) -> None:
        self.fleet.distribution = as_distribution(source)

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any = None) -> Any:
        """Reward of reports that end no episode by failure.

        Dense and distance reward: the distance r_g. Sparse: 0 inside the bands, −1 outside.
        """
        del info
        distance, near = self._judged(achieved_goal, desired_goal)
        return np.where(near, 0.0, -1.0)[()] if self.task.reward == Reward.SPARSE else distance

    def compute_terminated(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any = None) -> Any:
        """Whether reaching would end the episode: inside the bands, where one report is enough (``reach_steps=1``)."""
        del info
        _, near = self._judged(achieved_goal, desired_goal)
        return near & (self.task.reach_steps == 1)

    def compute_truncated(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any = None) -> Any:
        """Never: goals do not tell the time."""
        del info
        _, near = self._judged(achieved_goal, desired_goal)
        return np.zeros_like(near)[()]

    def _judged(self, achieved_goal: ArrayLike, desired_goal: ArrayLike) -> tuple[Any, Any]:
        """Distance reward, and whether inside the bands, of the batch's shape."""
        achieved, desired = np.broadcast_arrays(np.asarray(achieved_goal) / SCALE, np.asarray(desired_goal) / SCALE)
        shape = achieved.shape[:-1]
        distances, near = np.empty(int(np.prod(shape))), np.empty(int(np.prod(shape)), dtype=np.bool_)
        judge_goals(
            np.ascontiguousarray(achieved.reshape(-1, 3)),
            np.ascontiguousarray(desired.reshape(-1, 3)),
            task_row(self.task),
            *(distances, near),
        )
        return distances.reshape(shape)[()], near.reshape(shape)[()]
