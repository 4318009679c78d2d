"""Units: SI and radians inside, the field's customary units outside."""

from typing import NamedTuple


class Unit(NamedTuple):
    """A quantity's unit inside the simulator, and the one that people type, read and store."""

    inside: str
    outside: str
    """Also the suffix of a column's name."""
    scale: float
    """Outside value = inside value × scale."""


DEGREES_PER_RADIAN = 57.29577951
"""As the reference binaries round it (model.md, "State and integration"); one constant serves both directions."""

ONE = Unit("1", "", 1.0)
METRE = Unit("m", "m", 1.0)
METRE_PER_SECOND = Unit("m/s", "mps", 1.0)
ANGLE = Unit("rad", "deg", DEGREES_PER_RADIAN)
ANGULAR_RATE = Unit("rad/s", "degps", DEGREES_PER_RADIAN)
STANDARD_GRAVITY = Unit("g", "g", 1.0)
NEWTON = Unit("N", "n", 1.0)
SECOND = Unit("s", "s", 1.0)
COUNT = Unit("count", "", 1.0)
