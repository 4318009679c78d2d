"""What flights ask of the aircraft: commands at their bounds, travel of the surfaces, loads (after Appendix O)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import GuidanceCommand, SurfaceCommand, columns, field_array, fields_of

_LOAD = fields_of(GuidanceCommand)["load_factor"]
_ROUNDING = 1e-6  # of the range between the bounds: what is stored is float32


class CommandWear(NamedTuple):
    """One component of the action, over all steps."""

    at_low_percent: float
    """Steps at or beyond the lower bound of the action space."""
    at_high_percent: float
    bang_bang_percent: float
    """Steps at either."""
    switches_per_s: float
    """Jumps from one bound to the other within a step, for each second flown."""


class DeflectionWear(NamedTuple):
    """One control surface, or the throttle, over all steps."""

    travel_per_s: float
    """Sum of the absolute changes for each second flown: degrees a second, or 1/s for the throttle."""
    saturated_percent: float
    """Steps at or beyond the bounds of `SurfaceCommand`, where the aerodynamic tables end."""


class LoadWear(NamedTuple):
    """Normal load factor, over all steps."""

    least_g: float
    largest_g: float
    low_limit_g: float
    high_limit_g: float
    below_percent: float
    """Steps below the low limit."""
    above_percent: float
    """Steps above the high one."""
    episodes_beyond_percent: float
    """Episodes with at least one step beyond either."""


class Wear(NamedTuple):
    """Everything together, by column name."""

    commands: dict[str, CommandWear]
    deflections: dict[str, DeflectionWear]
    load: LoadWear


class EpisodeWear(NamedTuple):
    """Each flight on its own, by column name; arrays of shape (E,)."""

    at_bounds_percent: dict[str, NDArray[np.float64]]
    """Steps with a component of the action at or beyond either bound of the action space."""
    travel_per_s: dict[str, NDArray[np.float64]]
    """As in `DeflectionWear`."""


def episode_wear(episodes: Episodes) -> EpisodeWear:
    """What each of the flights asks of the aircraft."""
    kind, lengths = episodes.scenario.settings.command_fields, episodes.lengths
    first = episodes.offsets[:-1]
    commands = {
        name: 100.0
        * np.add.reduceat(np.logical_or(*_at_bounds(kind, k, episodes.actions)), first, dtype=np.int64)
        / lengths
        for k, name in enumerate(columns(kind))
    }
    changes = np.abs(np.diff(episodes.deflections.astype(np.float64), axis=0, prepend=0.0))
    changes[first] = 0.0
    seconds = lengths[:, None] * episodes.scenario.settings.time_step
    travels = np.add.reduceat(changes, first, axis=0) / seconds
    return EpisodeWear(commands, dict(zip(columns(SurfaceCommand), travels.T, strict=True)))


def wear(episodes: Episodes, low_limit_g: float = _LOAD.low, high_limit_g: float = _LOAD.high) -> Wear:
    """What the flights ask of the aircraft.

    Args:
        episodes: E flights.
        low_limit_g: least normal load factor of the airframe; by default the control law's.
        high_limit_g: largest one.
    """
    seconds = len(episodes.rewards) * episodes.scenario.settings.time_step
    follows = np.ones(len(episodes.rewards), dtype=np.bool_)  # whether a step has one before it in its episode
    follows[episodes.offsets[:-1]] = False
    kind = episodes.scenario.settings.command_fields
    commands = {
        name: _command_wear(*_at_bounds(kind, k, episodes.actions), follows, seconds)
        for k, name in enumerate(columns(kind))
    }
    deflections = {
        name: DeflectionWear(
            _rate(float(np.abs(np.diff(episodes.deflections[:, k].astype(np.float64)))[follows[1:]].sum()), seconds),
            _percent(np.logical_or(*_at_bounds(SurfaceCommand, k, episodes.deflections))),
        )
        for k, name in enumerate(columns(SurfaceCommand))
    }
    return Wear(commands, deflections, _load_wear(episodes, low_limit_g, high_limit_g))


def _at_bounds(
    kind: type[tuple[float, ...]], k: int, values: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether component k is at or beyond its lower, and its upper bound; shape (N,) each."""
    low, high = (field_array(kind, bound)[k] * field_array(kind, "scale")[k] for bound in ("low", "high"))
    slack = _ROUNDING * (high - low)
    return values[:, k] <= low + slack, values[:, k] >= high - slack


def _command_wear(
    low: NDArray[np.bool_], high: NDArray[np.bool_], follows: NDArray[np.bool_], seconds: float
) -> CommandWear:
    jumps = ((low[1:] & high[:-1]) | (high[1:] & low[:-1])) & follows[1:]
    return CommandWear(_percent(low), _percent(high), _percent(low | high), _rate(int(jumps.sum()), seconds))


def _load_wear(episodes: Episodes, low_limit_g: float, high_limit_g: float) -> LoadWear:
    load = episodes.load_factors
    below, above = load < low_limit_g, load > high_limit_g
    first = episodes.offsets[:-1]
    beyond = np.logical_or.reduceat(below | above, first) if len(first) else np.zeros(0, dtype=np.bool_)
    return LoadWear(
        float(load.min()) if load.size else float("nan"),
        float(load.max()) if load.size else float("nan"),
        low_limit_g,
        high_limit_g,
        _percent(below),
        _percent(above),
        _percent(beyond),
    )


def _percent(which: NDArray[np.bool_]) -> float:
    return 100.0 * int(which.sum()) / which.size if which.size else float("nan")


def _rate(total: float, seconds: float) -> float:
    return total / seconds if seconds else float("nan")
