"""Many aircraft as one vector environment of Stable-Baselines3, moved by one compiled loop (extra ``train``)."""

import time
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.envs import ENVIRONMENT_IDS
from vvc_bench.envs.fleet import Fleet
from vvc_bench.envs.options import checked_options, make_fleet, make_spaces
from vvc_bench.envs.relabelling import Relabelling
from vvc_bench.sim.episodes import REPORT
from vvc_bench.tasks import termination

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError("this takes Stable-Baselines3, which is missing: pip install vvc-bench[train]") from error

Observed = dict[str, NDArray[np.float32]]
Flags = NDArray[np.bool_]
Indices: TypeAlias = int | Iterable[int] | None

_TASK_METHODS = ("compute_reward", "compute_terminated", "compute_truncated")


class VelocityVectorVecEnv(Relabelling, VecEnv):  # type: ignore[misc]  # whose types are not there without the extra
    """`VelocityVectorEnv`, N at a time, for Stable-Baselines3: ``VelocityVectorVecEnv("VVC/Hard-v0", 256)``.

    An aircraft among many flies as it would alone with its seed, and begins its next episode in the step that ends the
    last. Rewards are float32.

    Infos are empty while an episode runs. Where one ended they hold ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return, length, and seconds since the environment was made, as from `Monitor`), and what the single
    environment's last info does.

    There is one task and one source of goals for all aircraft, so `get_attr` and `env_method` answer the same for each.

    Args:
        environment_id: one of `vvc_bench.envs.ENVIRONMENT_IDS`.
        num_envs: how many aircraft.
        seed: as if given to `seed`: the first reset seeds aircraft i with ``seed + i``.
        threads: at most so many; by default all cores.
        **options: as for `vvc_bench.envs.options.make_fleet`; conditions may be arrays of ``num_envs``.

    Raises:
        ValueError: for an unknown id, or an impossible option.
    """

    render_mode: str | None = None

    def __init__(
        self,
        environment_id: str,
        num_envs: int,
        *,
        seed: int | None = None,
        threads: int | None = None,
        **options: Any,
    ) -> None:
        if environment_id not in ENVIRONMENT_IDS:
            raise ValueError(f"unknown environment {environment_id!r}; known are {', '.join(ENVIRONMENT_IDS)}")
        self.fleet: Fleet = make_fleet(num_envs, task=ENVIRONMENT_IDS[environment_id], **options)
        self.task = self.fleet.task
        super().__init__(num_envs, *make_spaces(self.fleet.settings))
        self._threads = threads
        self._returns = np.zeros(num_envs)
        self._made_at = time.time()
        if seed is not None:
            self.seed(seed)

    def reset(self) -> Observed:
        """Begin all episodes anew, with what `seed` and `set_options` (``"goal"``, ``"state"``) were told since.

        Raises:
            ValueError: for an unknown option, or a goal or state that is none.
        """
        options = [checked_options(each, self.fleet) for each in self._options]
        if self._seeds[0] is not None or not self.fleet.generators:
            self.fleet.seed(self._seeds)
        for i, each in enumerate(options):
            self.fleet.begin(np.array([i]), each.get("goal"), each.get("state"))
        self._returns[:] = 0.0
        self._reset_seeds()
        self._reset_options()
        return self._observed()

    def step_async(self, actions: ArrayLike) -> None:
        """Take the actions, shape (N, 3) or (N, 4), that `step_wait` flies."""
        self._actions = actions

    def step_wait(self) -> tuple[Observed, NDArray[np.float32], Flags, list[dict[str, Any]]]:
        """Fly every aircraft one step.

        Returns:
            observations (of the new episode where one ended), rewards, whether episodes ended, infos.

        Raises:
            ValueError: for actions of another shape, or NaN; nothing is changed then.
        """
        fleet = self.fleet
        fleet.step(self._actions, self._threads)
        rewards = fleet.report[:, 0]
        self._returns += rewards
        terminated, truncated = fleet.outcomes(fleet.events)
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in dones]  # one each, as wrappers write into them
        ended = np.flatnonzero(dones)
        if ended.size:
            for i in ended.tolist():
                infos[i] = self._last_info(i, bool(truncated[i] and not terminated[i]))
            self._returns[ended] = 0.0
            fleet.begin(ended)
        return self._observed(), rewards.astype(np.float32), dones, infos

    def _last_info(self, i: int, only_truncated: bool) -> dict[str, Any]:
        fleet = self.fleet
        events = int(fleet.events[i])
        report = dict(zip(REPORT, fleet.report[i].tolist(), strict=True))
        del report["reward"]
        return report | {
            "is_success": bool(events & 1),
            "events": events,
            "termination": termination(self.task, events),
            "TimeLimit.truncated": only_truncated,
            "terminal_observation": self._observed(i),
            "episode": {
                "r": float(self._returns[i]),
                "l": int(report["steps"]),
                "t": round(time.time() - self._made_at, 6),
            },
        }

    def _observed(self, which: int | slice = slice(None)) -> Observed:
        fleet = self.fleet
        return {
            "observation": fleet.observations[which].copy(),
            "achieved_goal": fleet.achieved[which].copy(),
            "desired_goal": fleet.desired[which].copy(),
        }

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """An attribute, as often as there are aircraft asked for."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute, as ``goals``, for all aircraft.

        Raises:
            ValueError: for indices that leave some out.
        """
        if set(self._get_indices(indices)) != set(range(self.num_envs)):
            raise ValueError(f"{attr_name!r} is one for all {self.num_envs} aircraft; set it without indices")
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``compute_reward``, ``compute_terminated`` or ``compute_truncated`` for each aircraft asked for.

        Raises:
            AttributeError: for another method: aircraft share one environment.
        """
        if method_name not in _TASK_METHODS:
            raise AttributeError(f"env_method calls {', '.join(_TASK_METHODS)}; got {method_name!r}")
        method = getattr(self, method_name)
        return [method(*method_args, **method_kwargs) for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Indices = None) -> list[bool]:
        """True for `Monitor`, whose ``episode`` is in the infos, as `evaluate_policy` wants to know; else False."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> list[None]:
        """No pictures; a single environment draws them."""
        return [None] * self.num_envs

    def close(self) -> None:
        """Nothing is open."""
