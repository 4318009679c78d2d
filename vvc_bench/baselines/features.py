"""What a network is shown of an observation: the goal's direction as the aircraft sees it.

Part of the policy, so that a policy takes the environments' observations as they are, wherever it is used.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from vvc_bench.sim.fields import Goal, Observation

_DEGREE = math.pi / 180.0
_SPEED_SCALE, _SPEED_ERROR_SCALE, _ROLL_RATE_SCALE, _ALTITUDE_SCALE = 300.0, 100.0, 180.0, 5000.0
_NEAR = 10.0
"""Directions are also shown this many times larger, clipped to ±1: near the goal small errors count."""
FEATURES = 19


class RelativeFeatures(BaseFeaturesExtractor):  # type: ignore[misc]  # whose types are not there without the extra
    """19 numbers of about ±1 for an observation dictionary with batches of ``observation`` and ``desired_goal``.

    The goal's direction stands in the frame of the velocity vector: ahead, right and up, and turned with the aircraft's
    bank: towards the lift and across it. Nothing depends on where north is, and with left and right changed over the
    features change their signs or stay.
    """

    def __init__(self, observation_space: spaces.Dict) -> None:
        super().__init__(observation_space, FEATURES)

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Features, shape (B, 19)."""
        seen, goal = observations["observation"], observations["desired_goal"]
        return torch.stack(_relative(Observation(*seen.unbind(1)), Goal(*goal.unbind(1))), dim=1)

    def add_to_graph(self, graph: Any, name: str) -> str:
        """The same in an ONNX graph, as `vvc_bench.policies.conversion` asks a layer for.

        Args:
            graph: what operators are added to.
            name: of a table with the achieved goal, the desired goal and the observation side by side.

        Returns:
            The name of the features.
        """
        goal, seen = len(Goal._fields), len(Observation._fields)
        columns: list[Any] = [_Column(graph, graph.column(name, k)) for k in range(goal + goal + seen)]
        features = _relative(Observation(*columns[2 * goal :]), Goal(*columns[goal : 2 * goal]))
        joined: str = graph.add("Concat", *(feature.name for feature in features), axis=1)
        return joined


@dataclass(frozen=True)
class _Column:
    """A value in a graph, shape (B, 1), that is reckoned with as with a tensor."""

    graph: Any
    name: str

    def _with(self, operator: str, *others: Any) -> "_Column":
        names = [other.name if isinstance(other, _Column) else self.graph.constant([other]) for other in others]
        return _Column(self.graph, self.graph.add(operator, self.name, *names))

    def __add__(self, other: Any) -> "_Column":
        return self._with("Add", other)

    def __sub__(self, other: Any) -> "_Column":
        return self._with("Sub", other)

    def __mul__(self, other: Any) -> "_Column":
        return self._with("Mul", other)

    def __truediv__(self, other: Any) -> "_Column":
        return self._with("Div", other)

    def sin(self) -> "_Column":
        return self._with("Sin")

    def cos(self) -> "_Column":
        return self._with("Cos")

    def clamp(self, low: float, high: float) -> "_Column":
        return self._with("Max", low)._with("Min", high)


def _relative(seen: Any, goal: Any) -> list[Any]:
    """The features of an `Observation` and a `Goal` in outside units, of tensors or of columns of a graph."""
    roll, pitch, yaw, path, azimuth = (
        angle * _DEGREE for angle in (seen.roll, seen.pitch, seen.yaw, seen.path_angle, seen.azimuth)
    )
    wanted_path, turn = goal.path_angle * _DEGREE, goal.azimuth * _DEGREE - azimuth
    level = wanted_path.cos() * turn.cos()
    ahead = path.sin() * wanted_path.sin() + path.cos() * level
    right = wanted_path.cos() * turn.sin()
    up = path.cos() * wanted_path.sin() - path.sin() * level
    speed_error = (goal.speed - seen.speed) / _SPEED_ERROR_SCALE
    return [
        *(ahead, right, up),
        right * roll.sin() + up * roll.cos(),
        right * roll.cos() - up * roll.sin(),
        *((direction * _NEAR).clamp(-1.0, 1.0) for direction in (right, up)),
        *(roll.sin(), roll.cos(), path.sin(), path.cos()),
        *((pitch - path).sin(), (yaw - azimuth).sin()),
        speed_error,
        (speed_error * _NEAR).clamp(-1.0, 1.0),
        *(seen.speed / _SPEED_SCALE, goal.speed / _SPEED_SCALE),
        *(seen.roll_rate / _ROLL_RATE_SCALE, seen.altitude / _ALTITUDE_SCALE),
    ]


ANTISYMMETRIC = (1, 4, 5, 7, 12, 17)
"""Features that change their signs with left and right changed over; the others stay."""
