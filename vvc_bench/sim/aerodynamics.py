"""Force and moment coefficients of the F-16: wind-tunnel tables of NASA TP-1538 (Nguyen et al., 1979).

The tables are the files of ``data/``. Every table is brought onto one (sideslip, angle of attack) grid when the module
is loaded, so that two look-up indices serve all 42 of them: the flap tables end at 45°, beyond which their
last value holds, and the lateral tables' three elevator settings are nodes of the longitudinal tables' five. The
build-up of the coefficients is model.md's section "Aerodynamics".
"""

import csv
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.jit import kernel
from vvc_bench.sim.aircraft import CENTRE_OF_GRAVITY_SHIFT, MEAN_CHORD, WING_SPAN
from vvc_bench.sim.interpolation import clip, locate, make_axis
from vvc_bench.sim.units import DEGREES_PER_RADIAN

Table = NDArray[np.float64]


def _read(name: str) -> dict[str, Table]:
    """Columns of one data file, each figure rounded to float32 as the reference binaries hold it."""
    text = files("vvc_bench.sim").joinpath("data", name).read_text(encoding="utf-8")
    header, *rows = csv.reader(text.splitlines())
    values = np.array(rows, dtype=np.float32).astype(np.float64)
    return dict(zip(header, values.T, strict=True))


def _nodes(table: dict[str, Table], axis: str) -> Table:
    return np.unique(table[axis])


_longitudinal = _read("elevator_sideslip_alpha.csv")
_lateral = _read("elevator_sideslip_alpha_lateral.csv")
_static = _read("sideslip_alpha.csv")
_flap = _read("sideslip_alpha_flap.csv")
_damping = _read("alpha.csv")
_damping_flap = _read("alpha_flap.csv")

_elevator_nodes = _nodes(_longitudinal, "elevator_deg")
_sideslip_nodes = _nodes(_static, "sideslip_deg")
_alpha_nodes = _nodes(_damping, "angle_of_attack_deg")
_GRID = (_sideslip_nodes.size, _alpha_nodes.size)
_NEUTRAL_ELEVATOR = int(np.flatnonzero(_elevator_nodes == 0.0)[0])

ELEVATOR = make_axis(_elevator_nodes, bin_width=5.0)
SIDESLIP = make_axis(_sideslip_nodes, bin_width=1.0)
ALPHA = make_axis(_alpha_nodes, bin_width=5.0)


def _hold_last(table: Table) -> Table:
    """A flap table on the full angle-of-attack grid: its last value holds beyond its end."""
    missing = _alpha_nodes.size - table.shape[-1]
    return np.concatenate([table, np.repeat(table[..., -1:], missing, axis=-1)], axis=-1)


def _on_elevator_nodes(column: str) -> Table:
    """A lateral table, given at three elevator settings, at all five."""
    nodes = _nodes(_lateral, "elevator_deg")
    table = _lateral[column].reshape(nodes.size, -1)
    resampled = [np.interp(_elevator_nodes, nodes, values) for values in table.T]
    return np.array(resampled).T.reshape(_elevator_nodes.size, *_GRID)


_base = {name: _longitudinal[name].reshape(_elevator_nodes.size, *_GRID) for name in ("Cx", "Cz", "Cm")}
_base |= {name: _on_elevator_nodes(name) for name in ("Cn", "Cl")}
_neutral = {name: table[_NEUTRAL_ELEVATOR] for name, table in _base.items()}
_neutral["Cy"] = _static["Cy"].reshape(_GRID)
_flap_grid = (_sideslip_nodes.size, _nodes(_flap, "angle_of_attack_deg").size)
_with_flap = {
    name: _hold_last(_flap[name].reshape(_flap_grid))
    for name in _flap
    if name not in ("sideslip_deg", "angle_of_attack_deg")
}


def _surface_effects() -> list[Table]:
    """Changes from the neutral coefficient, in the order of the channels below."""
    flap = [_with_flap[f"{name}lf"] - _neutral[name] for name in ("Cx", "Cy", "Cz", "Cl", "Cm", "Cn")]
    aileron = {name: _static[f"{name}da20"].reshape(_GRID) - _neutral[name] for name in ("Cy", "Cn", "Cl")}
    aileron_flap = [_with_flap[f"{name}da20lf"] - _with_flap[f"{name}lf"] - aileron[name] for name in aileron]
    rudder = [_static[f"{name}dr30"].reshape(_GRID) - _neutral[name] for name in ("Cy", "Cn", "Cl")]
    return [_neutral["Cy"], *flap, *aileron.values(), *aileron_flap, *rudder]


# Packed tables, one row per node of the (sideslip, angle of attack) grid and one column per channel, so that a look-up
# is a short loop over neighbouring numbers. Look-up results stand in this order in one array.
_ELEVATOR_CHANNELS = ("Cx", "Cz", "Cm", "Cn", "Cl")
_CONTROL = np.stack([_base[name] for name in _ELEVATOR_CHANNELS], axis=-1).reshape(-1, len(_ELEVATOR_CHANNELS))
_SURFACE = np.ascontiguousarray(np.stack(_surface_effects(), axis=-1)).reshape(
    _sideslip_nodes.size * _alpha_nodes.size, -1
)

# dCzqlf is left out: the binaries use the static flap effect in its place (a slip they share with a public F-16 code).
_DAMPING_COLUMNS = ("Cxq", "Czq", "Cmq", "Cyr", "Cnr", "Clr", "Cyp", "Cnp", "Clp", "dCm", "dCnbeta", "dClbeta")
_DAMPING_FLAP_COLUMNS = ("dCxqlf", "dCmqlf", "dCyrlf", "dCnrlf", "dClrlf", "dCyplf", "dCnplf", "dClplf")
_DAMPING = np.ascontiguousarray(
    np.stack(
        [_damping[name] for name in _DAMPING_COLUMNS]
        + [_hold_last(_damping_flap[name]) for name in _DAMPING_FLAP_COLUMNS],
        axis=-1,
    )
)
_CONTROLS, _SURFACES, _DAMPINGS = _CONTROL.shape[1], _SURFACE.shape[1], _DAMPING.shape[1]
_CHANNELS = _CONTROLS + _SURFACES + _DAMPINGS
_CX, _CZ, _CM, _CN, _CL = range(_CONTROLS)
(
    _CY,
    _CX_FLAP,
    _CY_FLAP,
    _CZ_FLAP,
    _CL_FLAP,
    _CM_FLAP,
    _CN_FLAP,
    _CY_AILERON,
    _CN_AILERON,
    _CL_AILERON,
    _CY_AILERON_FLAP,
    _CN_AILERON_FLAP,
    _CL_AILERON_FLAP,
    _CY_RUDDER,
    _CN_RUDDER,
    _CL_RUDDER,
) = range(_CONTROLS, _CONTROLS + _SURFACES)
(
    _CX_PITCH,
    _CZ_PITCH,
    _CM_PITCH,
    _CY_YAW,
    _CN_YAW,
    _CL_YAW,
    _CY_ROLL,
    _CN_ROLL,
    _CL_ROLL,
    _CM_EXTRA,
    _CN_BETA,
    _CL_BETA,
    _CX_PITCH_FLAP,
    _CM_PITCH_FLAP,
    _CY_YAW_FLAP,
    _CN_YAW_FLAP,
    _CL_YAW_FLAP,
    _CY_ROLL_FLAP,
    _CN_ROLL_FLAP,
    _CL_ROLL_FLAP,
) = range(_CONTROLS + _SURFACES, _CHANNELS)
_ROW = _alpha_nodes.size  # nodes from one sideslip to the next
_LAYER = _ROW * _sideslip_nodes.size  # nodes from one elevator setting to the next

AXIAL_FACTOR = 1.6  # on the whole of CX, as measured; no source gives a reason
FLAP_LIMIT_DEG = 25.0
FLAP_START_DEG = 10.0
FLAP_SLOPE = 2.5
FULL_AILERON_DEG = 21.5
FULL_RUDDER_DEG = 30.0
ELEVATOR_FULL_EFFECT_DEG = 20.0  # its pitching moment fades by 1 % a degree beyond
ELEVATOR_FADE_PER_DEG = 0.01


class Coefficients(NamedTuple):
    """Body-axis force coefficients x, y, z and moment coefficients l (roll), m (pitch), n (yaw)."""

    cx: float
    cy: float
    cz: float
    cl: float
    cm: float
    cn: float


@kernel
def coefficients(
    angle_of_attack: float,
    sideslip: float,
    aileron: float,
    elevator: float,
    rudder: float,
    roll: float,
    pitch: float,
    yaw: float,
) -> Coefficients:
    """Coefficients at one flight condition.

    Angles and deflections in rad, clamped to the tables (α −20..90°, β ±30°, elevator ±25°). ``roll``, ``pitch`` and
    ``yaw`` are the reduced rates p·B/2V, q·c̄/2V and r·B/2V.
    """
    alpha_deg = angle_of_attack * DEGREES_PER_RADIAN
    beta_deg = sideslip * DEGREES_PER_RADIAN
    elevator_deg = elevator * DEGREES_PER_RADIAN
    c = _look_up(alpha_deg, beta_deg, elevator_deg)
    k = 1.0 - clip(FLAP_SLOPE * (alpha_deg - FLAP_START_DEG), 0.0, FLAP_LIMIT_DEG) * (1.0 / FLAP_LIMIT_DEG)
    da = aileron * (DEGREES_PER_RADIAN / FULL_AILERON_DEG)
    dr = rudder * (DEGREES_PER_RADIAN / FULL_RUDDER_DEG)
    faded_deg = clip(elevator_deg, ELEVATOR_FULL_EFFECT_DEG, ELEVATOR.last) - ELEVATOR_FULL_EFFECT_DEG

    cx = AXIAL_FACTOR * (c[_CX] + c[_CX_FLAP] * k + pitch * (c[_CX_PITCH] + c[_CX_PITCH_FLAP] * k))
    cz = c[_CZ] + c[_CZ_FLAP] * k + pitch * (c[_CZ_PITCH] + c[_CZ_FLAP] * k)
    cm = (
        c[_CM] * (1.0 - ELEVATOR_FADE_PER_DEG * faded_deg)
        + CENTRE_OF_GRAVITY_SHIFT * cz
        + c[_CM_FLAP] * k
        + pitch * (c[_CM_PITCH] + c[_CM_PITCH_FLAP] * k)
        + c[_CM_EXTRA]
    )
    cy = (
        c[_CY]
        + c[_CY_FLAP] * k
        + (c[_CY_AILERON] + c[_CY_AILERON_FLAP] * k) * da
        + c[_CY_RUDDER] * dr
        + yaw * (c[_CY_YAW] + c[_CY_YAW_FLAP] * k)
        + roll * (c[_CY_ROLL] + c[_CY_ROLL_FLAP] * k)
    )
    cn = (
        c[_CN]
        + c[_CN_FLAP] * k
        - CENTRE_OF_GRAVITY_SHIFT * (MEAN_CHORD / WING_SPAN) * cy
        + (c[_CN_AILERON] + c[_CN_AILERON_FLAP] * k) * da
        + c[_CN_RUDDER] * dr
        + yaw * (c[_CN_YAW] + c[_CN_YAW_FLAP] * k)
        + roll * (c[_CN_ROLL] + c[_CN_ROLL_FLAP] * k)
        + c[_CN_BETA] * beta_deg
    )
    cl = (
        c[_CL]
        + c[_CL_FLAP] * k
        + (c[_CL_AILERON] + c[_CL_AILERON_FLAP] * k) * da
        + c[_CL_RUDDER] * dr
        + yaw * (c[_CL_YAW] + c[_CL_YAW_FLAP] * k)
        + roll * (c[_CL_ROLL] + c[_CL_ROLL_FLAP] * k)
        + c[_CL_BETA] * beta_deg
    )
    return Coefficients(cx, cy, cz, cl, cm, cn)


@kernel
def _look_up(alpha_deg: float, beta_deg: float, elevator_deg: float) -> Table:
    """Every channel at one flight condition, multi-linearly interpolated and clamped to the grid."""
    a, alpha_high = locate(ALPHA, alpha_deg)
    b, beta_high = locate(SIDESLIP, beta_deg)
    e, elevator_high = locate(ELEVATOR, elevator_deg)
    alpha_low, beta_low, elevator_low = 1.0 - alpha_high, 1.0 - beta_high, 1.0 - elevator_high
    weight_0, weight_1 = beta_low * alpha_low, beta_low * alpha_high
    weight_2, weight_3 = beta_high * alpha_low, beta_high * alpha_high
    node_0 = b * _ROW + a
    node_1, node_2, node_3 = node_0 + 1, node_0 + _ROW, node_0 + _ROW + 1
    low, high = e * _LAYER, (e + 1) * _LAYER

    channels = np.empty(_CHANNELS)
    for i in range(_CONTROLS):
        channels[i] = elevator_low * (
            (_CONTROL[low + node_0, i] * weight_0 + _CONTROL[low + node_1, i] * weight_1)
            + (_CONTROL[low + node_2, i] * weight_2 + _CONTROL[low + node_3, i] * weight_3)
        ) + elevator_high * (
            (_CONTROL[high + node_0, i] * weight_0 + _CONTROL[high + node_1, i] * weight_1)
            + (_CONTROL[high + node_2, i] * weight_2 + _CONTROL[high + node_3, i] * weight_3)
        )
    for i in range(_SURFACES):
        channels[_CONTROLS + i] = (_SURFACE[node_0, i] * weight_0 + _SURFACE[node_1, i] * weight_1) + (
            _SURFACE[node_2, i] * weight_2 + _SURFACE[node_3, i] * weight_3
        )
    for i in range(_DAMPINGS):
        channels[_CONTROLS + _SURFACES + i] = _DAMPING[a, i] * alpha_low + _DAMPING[a + 1, i] * alpha_high
    return channels
