"""The engine: thrust follows the throttle at once (model.md, "Atmosphere and engine")."""

import numpy as np

from vvc_bench.jit import kernel
from vvc_bench.sim.aircraft import GRAVITY, MASS
from vvc_bench.sim.atmosphere import Air
from vvc_bench.sim.interpolation import linear, locate, make_axis

MAXIMUM_STATIC_THRUST = 1.26 * MASS * GRAVITY  # N
# Figures in float32, as the binaries hold them: in double precision the thrust differs by 2e-8.
_MACH = make_axis((np.arange(11, dtype=np.float32) / np.float32(10)).astype(np.float64), bin_width=0.1)
_THRUST_BY_MACH = np.array(
    [1.0, 0.98, 0.969, 0.921, 0.898, 0.867, 0.858, 0.856, 0.826, 0.703, 0.56], dtype=np.float32
).astype(np.float64)
_LOSS_PER_METRE = 0.05 / 1000.0
_LEAST_ALTITUDE_FACTOR = 0.5


@kernel
def maximum_thrust(airspeed: float, altitude: float, air: Air) -> float:
    """Thrust at full throttle, in N."""
    cell, fraction = locate(_MACH, airspeed / air.sound_speed)
    altitude_factor = max(_LEAST_ALTITUDE_FACTOR, 1.0 - _LOSS_PER_METRE * altitude)
    return MAXIMUM_STATIC_THRUST * linear(_THRUST_BY_MACH, cell, fraction) * altitude_factor
