"""How a policy trained elsewhere sees an environment: which parts, in which order and bounds, and how it commands.

Its own observation and action space tell. The paper's authors' policies see all parts scaled to [0, 1] and answer in
[0, 1]; the bounds that they scale from are those of our spaces.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.envs.options import make_spaces

PARTS = ("achieved_goal", "desired_goal", "observation")
"""In the order in which Gymnasium and Stable-Baselines3 put the parts of a dictionary together."""


@dataclass(frozen=True)
class View:
    """What a policy sees is ``parts · scale + offset``, and its answer ``answer · action_scale + action_offset``.

    Args:
        parts: names of what is seen, in order.
        widths: how many values each of them has.
        flat: as one vector and not as a dictionary.
        scale: shape (sum of widths,).
        offset: of the same shape.
        action_low: shape (w,): bounds of the policy's own action space.
        action_high: of the same shape.
        action_scale: of the same shape.
        action_offset: of the same shape.
    """

    parts: tuple[str, ...]
    widths: tuple[int, ...]
    flat: bool
    scale: NDArray[np.float32]
    offset: NDArray[np.float32]
    action_low: NDArray[np.float32]
    action_high: NDArray[np.float32]
    action_scale: NDArray[np.float32]
    action_offset: NDArray[np.float32]

    def see(self, observed: dict[str, NDArray[np.float32]]) -> Any:
        """What the policy is to be shown."""
        together = np.concatenate([observed[name] for name in self.parts], axis=1)
        shown = together * self.scale + self.offset
        if self.flat:
            return shown
        return dict(zip(self.parts, np.split(shown, np.cumsum(self.widths)[:-1], axis=1), strict=True))

    def act(self, answer: NDArray[np.float32]) -> NDArray[np.float32]:
        """The policy's answer in the units of our action space."""
        return answer * self.action_scale + self.action_offset


def view_of(observation_space: Any, action_space: Any) -> View:
    """The view that a policy with these spaces has.

    Args:
        observation_space: a Gymnasium ``Dict`` of some of `PARTS`, or a ``Box`` of all of them, flattened.
        action_space: a ``Box`` of three components for guidance mode, four for end-to-end mode.

    Raises:
        ValueError: for spaces that cannot be those of a policy for our environments, or without bounds.
    """
    action_low, action_high = _bounds(action_space, "action")
    modes: dict[int, sim.ControlMode] = {3: "guidance", 4: "end_to_end"}
    if len(action_low) not in modes:
        raise ValueError(f"a policy's actions must have 3 or 4 components, got {action_space}")
    ours = make_spaces(sim.Settings(modes[len(action_low)]))
    known: dict[str, Any] = dict(ours.observation.spaces)  # type: ignore[attr-defined]
    flat = not hasattr(observation_space, "spaces")
    names = PARTS if flat else tuple(name for name in PARTS if name in observation_space.spaces)
    if not flat and (len(names) != len(observation_space.spaces) or not names):
        raise ValueError(f"a policy may see {', '.join(PARTS)}; this one sees {', '.join(observation_space.spaces)}")
    seen = [_bounds(space, "observation") for space in ([observation_space] if flat else _of(observation_space, names))]
    low, high = (np.concatenate(bounds) for bounds in zip(*seen, strict=True))
    our_low, our_high = (np.concatenate([getattr(known[name], end) for name in names]) for end in ("low", "high"))
    if low.shape != our_low.shape:
        raise ValueError(f"a policy that sees {', '.join(names)} must see {our_low.size} values, not {low.size}")
    scale, offset = _between((our_low, our_high), (low, high))
    back = _between((action_low, action_high), (ours.action.low, ours.action.high))  # type: ignore[attr-defined]
    widths = tuple(known[name].shape[0] for name in names)
    return View(names, widths, flat, scale, offset, action_low, action_high, *back)


def _of(space: Any, names: tuple[str, ...]) -> list[Any]:
    return [space.spaces[name] for name in names]


def _bounds(space: Any, what: str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    low, high = (np.asarray(getattr(space, end, np.nan), dtype=np.float32) for end in ("low", "high"))
    if low.ndim != 1 or not np.isfinite(low).all() or not np.isfinite(high).all():
        raise ValueError(f"a policy's {what} space must be a Box of one axis with finite bounds, got {space}")
    return low, high


def _between(
    inside: tuple[NDArray[np.float32], NDArray[np.float32]], outside: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Scale and offset that take bounds to other bounds; exactly 1 and 0 between equal ones."""
    (low, high), (new_low, new_high) = ([end.astype(np.float64) for end in bounds] for bounds in (inside, outside))
    scale = (new_high - new_low) / (high - low)
    return scale.astype(np.float32), (new_low - low * scale).astype(np.float32)
