"""Dryden turbulence, continuous form of MIL-F-8785C (3.7.2) and MIL-HDBK-1797A for medium and high altitude.

Each component's shaping filter is discretised exactly, so the statistics do not depend on the step:

- along x, H(s) ∝ 1 / (1 + s/a), one state;
- along y and z, H(s) ∝ (1 + √3 s/a) / (1 + s/a)², two states y₁ = white/(1 + s/a) and y₂ = y₁/(1 + s/a), with the
  gust √3 y₁ + (1 − √3) y₂,

with a = V/L and the scale length L = 1,750 ft that MIL-F-8785C gives above 2,000 ft. The intensity is one figure
for all components, as it is at that height. Left out: the rotary gusts, and the shorter scales near the ground.
"""

import math
from typing import NamedTuple

from vvc_bench.jit import kernel, routine
from vvc_bench.sim.dynamics import LEAST_AIRSPEED, Vector
from vvc_bench.sim.random_numbers import standard_normals

SCALE_LENGTH = 1750.0 * 0.3048  # m
_ROOT_3 = math.sqrt(3.0)


class GustState(NamedTuple):
    """Filter states in m/s, in the order of `State`'s gust fields."""

    gust_forward: float
    gust_side: float
    gust_side_lagged: float
    gust_normal: float
    gust_normal_lagged: float


@kernel
def gust_velocity(gust: GustState) -> Vector:
    """Velocity of the air in body axes, in m/s."""
    return Vector(
        gust.gust_forward,
        _ROOT_3 * gust.gust_side + (1.0 - _ROOT_3) * gust.gust_side_lagged,
        _ROOT_3 * gust.gust_normal + (1.0 - _ROOT_3) * gust.gust_normal_lagged,
    )


@routine
def next_gust(
    gust: GustState, airspeed: float, intensity: float, seed: float, step: float, time_step: float
) -> GustState:
    """Filter states one time step later; at step 0 they are drawn from their stationary distribution."""
    x = time_step * max(airspeed, LEAST_AIRSPEED) / SCALE_LENGTH
    decay = math.exp(-x) if step > 0.0 else 0.0
    counter = 3 * int(step)
    forward_noise, _ = standard_normals(int(seed), counter)
    side_noise_0, side_noise_1 = standard_normals(int(seed), counter + 1)
    normal_noise_0, normal_noise_1 = standard_normals(int(seed), counter + 2)
    side, side_lagged = _second_order(
        gust.gust_side, gust.gust_side_lagged, x, decay, intensity, side_noise_0, side_noise_1
    )
    normal, normal_lagged = _second_order(
        gust.gust_normal, gust.gust_normal_lagged, x, decay, intensity, normal_noise_0, normal_noise_1
    )
    forward = decay * gust.gust_forward + intensity * math.sqrt(1.0 - decay * decay) * forward_noise
    return GustState(forward, side, side_lagged, normal, normal_lagged)


@kernel
def _second_order(
    y1: float, y2: float, x: float, decay: float, intensity: float, noise_1: float, noise_2: float
) -> tuple[float, float]:
    """Exact step of the pair of lags: covariance P − A P Aᵀ of the noise, P = σ²/4 · [[2, 1], [1, 1]] stationary."""
    d2 = decay * decay
    scale = 0.25 * intensity * intensity
    q11 = scale * 2.0 * (1.0 - d2)
    q12 = scale * (1.0 - d2 * (1.0 + 2.0 * x))
    q22 = scale * (1.0 - d2 * (1.0 + 2.0 * x + 2.0 * x * x))
    l11 = math.sqrt(q11)
    l21 = q12 / l11 if l11 > 0.0 else 0.0
    l22 = math.sqrt(max(q22 - l21 * l21, 0.0))
    return decay * y1 + l11 * noise_1, decay * (y2 + x * y1) + l21 * noise_1 + l22 * noise_2
