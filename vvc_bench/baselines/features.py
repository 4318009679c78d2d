"""What a network is shown of an observation: the goal's direction as the aircraft sees it.

Part of the policy, so that a policy takes the environments' observations as they are, wherever it is used.
"""

import math

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from vvc_bench.sim.fields import Observation, columns

_PLACE = {name: k for k, name in enumerate(Observation._fields)}
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
        roll, pitch, yaw, speed, path, azimuth, roll_rate, altitude = (seen[:, k] for k in _PLACE.values())
        roll, pitch, yaw, path, azimuth = (angle * _DEGREE for angle in (roll, pitch, yaw, path, azimuth))
        wanted_speed, wanted_path, turn = goal[:, 0], goal[:, 1] * _DEGREE, goal[:, 2] * _DEGREE - azimuth
        level = torch.cos(wanted_path) * torch.cos(turn)
        ahead = torch.sin(path) * torch.sin(wanted_path) + torch.cos(path) * level
        right = torch.cos(wanted_path) * torch.sin(turn)
        up = torch.cos(path) * torch.sin(wanted_path) - torch.sin(path) * level
        towards_lift = right * torch.sin(roll) + up * torch.cos(roll)
        across_lift = right * torch.cos(roll) - up * torch.sin(roll)
        speed_error = (wanted_speed - speed) / _SPEED_ERROR_SCALE
        return torch.stack(
            [
                ahead,
                right,
                up,
                towards_lift,
                across_lift,
                (_NEAR * right).clamp(-1.0, 1.0),
                (_NEAR * up).clamp(-1.0, 1.0),
                torch.sin(roll),
                torch.cos(roll),
                torch.sin(path),
                torch.cos(path),
                torch.sin(pitch - path),
                torch.sin(yaw - azimuth),
                speed_error,
                (_NEAR * speed_error).clamp(-1.0, 1.0),
                speed / _SPEED_SCALE,
                wanted_speed / _SPEED_SCALE,
                roll_rate / _ROLL_RATE_SCALE,
                altitude / _ALTITUDE_SCALE,
            ],
            dim=1,
        )


assert list(columns(Observation))[3:6] == ["speed_mps", "path_angle_deg", "azimuth_deg"]
