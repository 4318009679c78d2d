"""One aircraft as a Gymnasium environment."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench import sim
from vvc_bench.envs.fleet import Fleet
from vvc_bench.envs.options import checked_options, make_fleet, make_spaces
from vvc_bench.envs.relabelling import Relabelling
from vvc_bench.envs.rendering import Window, draw_frame
from vvc_bench.flight.recording import Flight
from vvc_bench.sim.episodes import REPORT
from vvc_bench.tasks import termination

Observed = dict[str, NDArray[np.float32]]

_ONE = np.zeros(1, dtype=np.int64)


class VelocityVectorEnv(Relabelling, gymnasium.Env[Observed, NDArray[np.float32]]):
    """Fly so that the velocity vector reaches the desired goal and stays there.

    Observations are a dictionary, as goal-conditioned learners expect: ``observation`` (8 values, `Observation`),
    ``achieved_goal`` and ``desired_goal`` (speed in m/s, path angle and azimuth in degrees). Arguments are those of
    `vvc_bench.envs.options.make_fleet`, and ``render_mode``.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012  (Gymnasium declares it so)

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be one of {self.metadata['render_modes']} or None, got {render_mode!r}")
        self.render_mode = render_mode
        self.fleet: Fleet = make_fleet(1, **options)
        self.metadata = self.metadata | {"render_fps": self.fleet.settings.frequency_hz}
        self.task = self.fleet.task
        self._states: list[NDArray[np.float64]] = []
        self._commands: list[NDArray[np.float64]] = []
        self._window: Window | None = None
        self._observation, self._achieved, self._desired, self._report = (  # views of the fleet's only row
            rows[0] for rows in (self.fleet.observations, self.fleet.achieved, self.fleet.desired, self.fleet.report)
        )
        self.observation_space, self.action_space = make_spaces(self.fleet.settings)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seeds the goals.
            options: ``"goal"``: (speed_mps, path_angle_deg, azimuth_deg) in place of a drawn one; ``"state"``: a row
                from `vvc_bench.sim.start` or `start_from`, in place of the usual start.

        Raises:
            ValueError: for an unknown option, or a goal or state that is none.
        """
        super().reset(seed=seed)
        options = checked_options(options, self.fleet)
        self.fleet.generators = [self.np_random]
        self.fleet.begin(_ONE, options.get("goal"), options.get("state"))
        self._states, self._commands = [], []
        self._record()
        return self._observed(), {"is_success": False, "events": 0, "termination": "", "steps": 0}

    def step(self, action: ArrayLike) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Fly one step.

        Returns:
            observation, reward, terminated (goal reached, or failed), truncated (time is up) and info: ``is_success``,
            ``events`` (`Event` bits), ``termination`` (name of the one that ended the episode, or ""), and the columns
            of `vvc_bench.sim.episodes.REPORT`.

        Raises:
            ValueError: for an action of another shape, or NaN.
        """
        self.fleet.step_one(action)
        if self.render_mode is not None:
            self._record()
        events = self.fleet.events.item()
        info: dict[str, Any] = dict(zip(REPORT, self._report.tolist(), strict=True))
        reward = info.pop("reward")
        terminated, truncated = self.fleet.outcomes(events)
        info["is_success"] = bool(events & 1)
        info["events"] = events
        info["termination"] = termination(self.task, events) if events else ""
        return self._observed(), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The episode so far: path, attitude, velocity vector and goal; histories of what was commanded and flown.

        With ``"human"``, `reset` and `step` do this themselves.

        Returns:
            An image of shape (540, 960, 3) with ``"rgb_array"``; None with ``"human"``, which is a window.

        Raises:
            ValueError: without a render mode.
            ImportError: without matplotlib (extra ``plot``).
            RuntimeError: with ``"human"``, without a display.
        """
        if self.render_mode is None:
            raise ValueError('nothing is recorded to be drawn; make the environment with render_mode="rgb_array"')
        if self.render_mode == "rgb_array":
            return draw_frame(self.flight)
        self._window = self._window or Window()
        self._window.show(self.flight, ended=bool(self.fleet.events[0]))
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    @property
    def flight(self) -> Flight:
        """The episode so far, where there is a render mode: for pictures, or for `vvc_bench.flight.write_flight`."""
        fleet = self.fleet
        commands = np.reshape(self._commands, (-1, fleet.settings.command_width))
        return Flight(fleet.settings, fleet.goals[0].copy(), np.stack(self._states), commands, fleet.conditions)

    def _record(self) -> None:
        """Keep the state, and the command that led to it."""
        if self._states:
            self._commands.append(self.fleet.commands[0].copy())
        self._states.append(self.fleet.rows[0].copy())
        if self.render_mode == "human":
            self.render()

    def set_goal(self, goal: ArrayLike) -> Observed:
        """Give another goal within the episode; what counts towards reaching it starts anew.

        Returns:
            The observation with the new desired goal.
        """
        self.fleet.set_goals(_ONE, goal)
        return self._observed()

    @property
    def state(self) -> sim.State:
        """The aircraft's full state, in SI units."""
        return sim.State(*self.fleet.rows[0, : len(sim.State._fields)].tolist())

    def _observed(self) -> Observed:
        return {
            "observation": self._observation.copy(),
            "achieved_goal": self._achieved.copy(),
            "desired_goal": self._desired.copy(),
        }
