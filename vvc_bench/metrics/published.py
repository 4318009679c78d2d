"""What is known of the paper's own sets, to stand beside ours.

The paper's text was not at hand when this was written. Of the sets of IRPO the coverages of Table 1, the mean length of
the last one's flights, 116.6 steps, and that all six have some 120 are known from the project's notes on the paper.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from vvc_bench.metrics.statistics import Spread

_NOTHING: Mapping[str, Any] = MappingProxyType({})
_UNKNOWN = float("nan")


class PublishedFigures(NamedTuple):
    """Figures of one set; what is not known is left out, of a row too."""

    table_1: Mapping[str, Mapping[str, float | Spread]]
    """Whose figures → field of `vvc_bench.metrics.Table1` → figure."""
    table_12: Mapping[str, tuple[float, float]] = _NOTHING
    """Column → s₁ and s₂, NaN where not known. Of the paper's only s₁ of θ is known here, 0.25 for `pid-v0`, and that
    looks like a slip: 0.05 is measured with the paper's binaries (model.md)."""
    reached: Mapping[str, Mapping[float, int]] = _NOTHING
    """Column of the goal → its value → goals reached there; counted with the paper's binaries (model.md)."""


PAPER, BINARIES = "paper", "binaries"
"""The paper's own text, and the same flights flown anew with the binaries it was written with (model.md)."""

PUBLISHED: Mapping[str, PublishedFigures] = MappingProxyType(
    {
        "pid-v0": PublishedFigures(
            {
                PAPER: {
                    "trajectories": 10184,
                    "coverage_percent": 20.08,
                    "length_steps": Spread(282.01, 149.98),
                    "transitions": 2872051,
                    "speed_error_mps": Spread(6.56, 3.25),
                    "path_angle_error_deg": Spread(0.36, 0.35),
                    "azimuth_error_deg": Spread(0.53, 0.45),
                },
                BINARIES: {
                    "trajectories": 10183,
                    "coverage_percent": 20.08,
                    "length_steps": Spread(282.02, 149.94),
                    "transitions": 2871843,
                    "speed_error_mps": Spread(6.57, _UNKNOWN),
                    "path_angle_error_deg": Spread(0.37, _UNKNOWN),
                    "azimuth_error_deg": Spread(0.53, _UNKNOWN),
                },
            },
            reached={"speed_mps": {100.0: 553, 140.0: 394, 260.0: 571, 300.0: 326}},
        ),
        "pid-aug-v0": PublishedFigures(
            {
                PAPER: {"trajectories": 10264, "coverage_percent": 20.24},
                BINARIES: {"trajectories": 10258},
            }
        ),
        "irpo1-v0": PublishedFigures({PAPER: {"coverage_percent": 49.15}}),
        "irpo1-aug-v0": PublishedFigures({PAPER: {"coverage_percent": 53.28}}),
        "irpo2-v0": PublishedFigures({PAPER: {"coverage_percent": 65.29}}),
        "irpo2-aug-v0": PublishedFigures({PAPER: {"coverage_percent": 68.92}}),
        "irpo3-v0": PublishedFigures({PAPER: {"coverage_percent": 76.22}}),
        "irpo3-aug-v0": PublishedFigures({PAPER: {"coverage_percent": 78.55, "length_steps": Spread(116.6, _UNKNOWN)}}),
    }
)
"""By the name of our set that stands for the paper's: Table 1, and the same flights flown with the paper's binaries."""
