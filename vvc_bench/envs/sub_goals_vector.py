"""Sub-goals for thousands of aircraft at once; a module of its own, as it takes Gymnasium 1.1."""

from typing import Any

from numpy.typing import ArrayLike

from vvc_bench.envs.sub_goals import TURN_CLIMB, SubGoalFleet
from vvc_bench.envs.vector import VelocityVectorVectorEnv


class SubGoalsVectorEnv(VelocityVectorVectorEnv):
    """`SubGoalsEnv`, N at a time; ``sub_goals_reached`` is in the infos of every step.

    Args:
        num_envs: how many aircraft.
        sub_goals: shape (K, 3): speed in m/s, path angle and azimuth in degrees.
        **options: as for `VelocityVectorVectorEnv`, but no ``goals``.

    Raises:
        ValueError: for goals that are none, or no goal at all.
    """

    fleet: SubGoalFleet

    def __init__(self, num_envs: int = 1, *, sub_goals: ArrayLike = TURN_CLIMB, **options: Any) -> None:
        super().__init__(num_envs, goals=sub_goals, **options)
        self.fleet = SubGoalFleet(self.fleet, sub_goals)

    def _infos(self) -> dict[str, Any]:
        infos = super()._infos()
        return infos | {"sub_goals_reached": self.fleet.reached.copy(), "_sub_goals_reached": infos["_events"]}
