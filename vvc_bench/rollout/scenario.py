"""What a flight is a function of, besides its goal and its actions."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.sim.fields import STILL, Conditions, checked_inside, columns
from vvc_bench.sim.starting import DEFAULT_ALTITUDE_M, DEFAULT_SPEED_MPS
from vvc_bench.sim.task import Task

Quantities = TypeVar("Quantities", Task, Conditions)
_SEED = Conditions._fields.index("seed")


@dataclass(frozen=True)
class Scenario:
    """Rules, way of flying, start and conditions, shared by all episodes of a set.

    Args:
        task: the rules, and what is rewarded.
        settings: control mode, dynamics, frequency.
        altitude_m: where episodes begin, in trim.
        speed_mps: true airspeed at the start.
        heading_deg: heading at the start.
        conditions: wind, gusts and the like, in inside units; each episode brings its own seed.
    """

    task: Task = Task()  # noqa: RUF009  (immutable)
    settings: sim.Settings = sim.Settings()  # noqa: RUF009
    altitude_m: float = DEFAULT_ALTITUDE_M
    speed_mps: float = DEFAULT_SPEED_MPS
    heading_deg: float = 0.0
    conditions: Conditions = STILL

    @functools.cached_property
    def start(self) -> NDArray[np.float64]:
        """The state that episodes begin from, one row.

        Raises:
            ValueError: if there is no trim there.
        """
        return sim.start(
            self.settings,
            altitude_m=self.altitude_m,
            speed_mps=self.speed_mps,
            heading_deg=self.heading_deg,
            conditions=np.array([self.conditions]),
        ).reshape(-1)

    def condition_rows(self, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        """Conditions as the kernels read them: one row, or one for each seed where seeds matter."""
        row = np.array([self.conditions])
        if self.conditions.gust_intensity == 0.0 and self.conditions.sensor_noise == 0.0:
            return row
        rows = np.repeat(row, len(seeds), axis=0)
        rows[:, _SEED] = seeds
        return rows

    def to_json(self) -> dict[str, Any]:
        """The same as a document: every value under its column name, in outside units."""
        return {
            "task": _to_outside(self.task),
            "control_mode": self.settings.control_mode,
            "dynamics": self.settings.dynamics,
            "frequency_hz": self.settings.frequency_hz,
            "altitude_m": self.altitude_m,
            "speed_mps": self.speed_mps,
            "heading_deg": self.heading_deg,
            "conditions": _to_outside(self.conditions),
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> "Scenario":
        """The scenario of a document that `to_json` made.

        Raises:
            KeyError: for a missing entry.
            ValueError: for a value that is impossible.
        """
        return cls(
            _to_inside(Task, document["task"]),
            sim.Settings(document["control_mode"], document["dynamics"], document["frequency_hz"]),
            document["altitude_m"],
            document["speed_mps"],
            document["heading_deg"],
            _to_inside(Conditions, document["conditions"]),
        )


def _to_outside(values: Task | Conditions) -> dict[str, float]:
    known = columns(type(values))
    return {name: _typed(value, field.unit.scale) for (name, field), value in zip(known.items(), values, strict=True)}


def _typed(value: float, scale: float) -> float:
    """The short number that somebody would type for a value, if it means the same."""
    short = float(f"{value * scale:.12g}")
    return short if short / scale == value else value * scale


def _to_inside(kind: type[Quantities], document: Mapping[str, float]) -> Quantities:
    known = columns(kind)
    unknown = set(document) - set(known)
    if unknown:
        raise ValueError(f"unknown field {min(unknown)!r} of {kind.__name__}; known are {', '.join(known)}")
    return kind(*(float(checked_inside(name, field, document[name])) for name, field in known.items()))
