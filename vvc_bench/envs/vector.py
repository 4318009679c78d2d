"""Thousands of aircraft as one Gymnasium vector environment, moved by one compiled loop."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from vvc_bench.envs.fleet import Fleet
from vvc_bench.envs.options import checked_options, make_fleet, make_spaces, seeds_for
from vvc_bench.envs.relabelling import Relabelling
from vvc_bench.sim.episodes import REPORT

try:
    from gymnasium.vector import AutoresetMode, VectorEnv
except ImportError as error:
    raise ImportError(
        f"the vector environment takes Gymnasium 1.1 or newer, this is {gymnasium.__version__}: upgrade it, or use "
        "single environments, or VelocityVectorVecEnv of vvc_bench.envs.stable_baselines"
    ) from error

Observed = dict[str, NDArray[np.float32]]
Flags = NDArray[np.bool_]


class VelocityVectorVectorEnv(Relabelling, VectorEnv[Observed, NDArray[np.float32], NDArray[Any]]):
    """`VelocityVectorEnv`, N at a time; an aircraft among many flies as it would alone with its seed.

    Infos are Gymnasium's: arrays over all environments, each with a mask of its name and an underscore. Every step
    reports ``is_success``, ``events`` (`Event` bits) and the columns of `vvc_bench.sim.episodes.REPORT`. With same-step
    autoreset, ``final_obs`` holds the last observations of the episodes that ended (rows of the others are those of the
    step), and ``final_info`` their infos.

    Args:
        num_envs: how many aircraft.
        autoreset_mode: ``AutoresetMode.NEXT_STEP`` (Gymnasium's default: the step after the last returns the new
            episode's first observation), ``SAME_STEP`` or ``DISABLED``, or their names.
        threads: at most so many; by default all cores.
        **options: as for `vvc_bench.envs.options.make_fleet`; conditions may be arrays of ``num_envs``.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 10}  # noqa: RUF012  (Gymnasium declares it so)

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **options: Any,
    ) -> None:
        options.pop("render_mode", None)  # make_vec always passes one
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.fleet: Fleet = make_fleet(num_envs, **options)
        self.task = self.fleet.task
        self.single_observation_space, self.single_action_space = make_spaces(self.fleet.settings)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._threads = threads
        self._ended = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin episodes: all, or those of ``options["reset_mask"]``.

        Args:
            seed: one for each environment, or a first one: environment i gets ``seed + i``.
            options: ``"goal"``, shape (3,) or (N, 3); ``"state"``, a row or N of them; ``"reset_mask"``, N truths.

        Raises:
            ValueError: for an unknown option, or a goal or state that is none.
        """
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(f"options['reset_mask'] must be {self.num_envs} truths, not all false, got {mask!r}")
        options = checked_options(options, self.fleet)
        if seed is not None or not self.fleet.generators:
            super().reset(seed=seed if isinstance(seed, int) else None)
            self.fleet.seed(seeds_for(self.num_envs, seed, self.np_random))
        which = np.flatnonzero(mask)
        goal, state = options.get("goal"), options.get("state")
        self.fleet.begin(which, _rows(goal, which), _rows(state, which))
        self._ended[which] = False
        return self._observed(), {}

    def step(self, actions: ArrayLike) -> tuple[Observed, NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Fly every aircraft one step.

        Raises:
            ValueError: for actions of another shape, or NaN; nothing is changed then.
        """
        fleet = self.fleet
        stale = np.flatnonzero(self._ended & (self.autoreset_mode == AutoresetMode.NEXT_STEP))
        fleet.step(actions, self._threads)
        if stale.size:
            fleet.begin(stale)
            fleet.report[stale] = 0.0
            fleet.events[stale] = 0
        rewards = fleet.report[:, 0].copy()
        terminated, truncated = fleet.outcomes(fleet.events)
        self._ended = terminated | truncated
        infos = self._infos()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._ended.any():
            infos |= {"final_obs": self._observed(), "_final_obs": self._ended}
            infos |= {"final_info": dict(infos), "_final_info": self._ended}
            fleet.begin(np.flatnonzero(self._ended))
        return self._observed(), rewards, terminated, truncated, infos

    def set_goals(self, goals: ArrayLike, which: ArrayLike | None = None) -> Observed:
        """Give some aircraft (all by default) other goals within their episodes."""
        chosen = np.arange(self.num_envs) if which is None else np.asarray(which, dtype=np.int64)
        self.fleet.set_goals(chosen, goals)
        return self._observed()

    def _observed(self) -> Observed:
        fleet = self.fleet
        return {
            "observation": fleet.observations.copy(),
            "achieved_goal": fleet.achieved.copy(),
            "desired_goal": fleet.desired.copy(),
        }

    def _infos(self) -> dict[str, Any]:
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        report, events = self.fleet.report.copy(), self.fleet.events.copy()
        infos: dict[str, Any] = {name: report[:, k] for k, name in enumerate(REPORT) if k > 0}
        infos |= {"events": events, "is_success": (events & 1).astype(np.bool_)}
        return infos | {f"_{name}": everyone for name in infos}


def _rows(values: Any, which: NDArray[np.int64]) -> Any:
    """Those rows of a reset option that has one for each environment; one for all, or none, as it is."""
    return values if values is None or np.ndim(values) < 2 else np.asarray(values)[which]
