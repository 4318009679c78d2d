"""The air as the reference binaries have it, which is not the International Standard Atmosphere.

The temperature follows ISO 2533 to 11 km and is constant above, but the density follows an exponential in h / T(h) in
place of the barometric formula (model.md, "Atmosphere and engine"): it is right at sea level and falls short by 15 % at
5 km (docs/reference-aircraft.md).
"""

import math
from typing import NamedTuple

from vvc_bench.jit import kernel

SEA_LEVEL_TEMPERATURE = 288.15  # K, ISO 2533
LAPSE_RATE = 0.0065  # K/m, ISO 2533
TROPOPAUSE = 11000.0  # m, ISO 2533
STRATOSPHERE_TEMPERATURE = 216.65  # K, ISO 2533
SEA_LEVEL_DENSITY = 1.225  # kg/m³, ISO 2533
GAS_CONSTANT = 287.05  # J/(kg K), dry air
GRAVITY_OF_DENSITY = 9.80665  # m/s², standard gravity; the equations of motion use 9.81
SOUND_SPEED_PER_ROOT_KELVIN = 20.0468  # m/s/√K, √(1.4 × 287.05)


class Air(NamedTuple):
    """The air around one aircraft."""

    density: float
    """kg/m³"""
    sound_speed: float
    """m/s"""


@kernel
def air_at(altitude: float, density_factor: float) -> Air:
    """Density and speed of sound at an altitude in m; ``density_factor`` multiplies the density (1 = nominal)."""
    temperature = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * altitude if altitude <= TROPOPAUSE else STRATOSPHERE_TEMPERATURE
    density = SEA_LEVEL_DENSITY * math.exp(-GRAVITY_OF_DENSITY * altitude / (GAS_CONSTANT * temperature))
    return Air(density * density_factor, SOUND_SPEED_PER_ROOT_KELVIN * math.sqrt(temperature))
