"""How far the aircraft is from being its own mirror image: flights and their mirrored twins, and the tables themselves.

    python docs/figures/asymmetry.py

Writes docs/figures/asymmetry.png and the tables of docs/asymmetry.md.
"""

from contextlib import ExitStack
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from figure_tools import (
    COLOURS,
    FAINT,
    GROUND_VELOCITY,
    INDEX,
    INK,
    POSITION,
    STILL,
    Array,
    angle_between,
    column,
    finish,
    fly,
    inside,
    new_figure,
    report,
    save,
    significant,
    table,
)
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm

from vvc_bench import sim
from vvc_bench.sim import dynamics, stepping
from vvc_bench.sim.aerodynamics import ALPHA, SIDESLIP, Coefficients, coefficients
from vvc_bench.sim.fields import degrees, field_array

FLIGHTS = 2000
STEPS = 400
REPORTED_STEPS = (50, 100, 200, 400)
LARGEST_ROLL_RATE = 60.0  # deg/s
LOAD_FACTORS = (0.5, 4.0)  # g
PIECE_STEPS = 15  # each command is held for 1.5 s
LOWEST, HIGHEST = 500.0, 12000.0  # m
SLOWEST, FASTEST = 100.0, 350.0  # m/s
LARGEST_ALPHA = 25.0  # deg; the control law's protection begins there
CAUSE_FLIGHTS, CAUSE_STEPS = 50, 200
APART = 1e-12  # rad/s

FLOWN_ALPHA_DEG, FLOWN_SIDESLIP_DEG = (-5.0, 20.0), 10.0
QUANTITIES = ("cy", "cn", "cl")
_MIRROR_STATE = field_array(sim.State, "mirror")
_MIRROR_COMMAND = field_array(sim.GuidanceCommand, "mirror")


class Difference(NamedTuple):
    """Between a flight and its twin mirrored back, of shape (steps + 1, N)."""

    azimuth: Array
    path_angle: Array
    direction: Array
    speed: Array
    position: Array


class Flights(NamedTuple):
    """Flights that stay where an aircraft flies."""

    settings: sim.Settings
    commands: Array
    flown: Array


UNITS = Difference("°", "°", "°", "m/s", "m")


def random_commands(settings: sim.Settings) -> Array:
    """Moderate manoeuvres, shape (steps, flights, 3): the bank swings to and fro, pulls are short."""
    rng = np.random.default_rng(1)
    count = -(-STEPS // PIECE_STEPS)
    roll_rate = rng.uniform(-LARGEST_ROLL_RATE, LARGEST_ROLL_RATE, (count, FLIGHTS))
    roll_rate[1::2] = -roll_rate[::2][: count // 2]
    load_factor = rng.triangular(LOAD_FACTORS[0], 1.0, LOAD_FACTORS[1], (count, FLIGHTS))
    throttle = rng.uniform(0.0, 1.0, (count, FLIGHTS))
    held = inside(np.stack([roll_rate, load_factor, throttle], axis=-1), settings)
    return np.repeat(held, PIECE_STEPS, axis=0)[:STEPS]


def is_sensible(flown: Array) -> Array:
    """Which flights stay where an aircraft flies."""
    altitude, speed = column(flown, "altitude_m"), column(flown, "airspeed_mps")
    inside_box = (altitude > LOWEST) & (altitude < HIGHEST) & (speed > SLOWEST) & (speed < FASTEST)
    flies = column(flown, "angle_of_attack_deg") < LARGEST_ALPHA
    return (inside_box & flies).all(axis=0)


def difference(flown: Array, twins: Array) -> Difference:
    turned = column(twins, "azimuth_deg") - column(flown, "azimuth_deg")
    return Difference(
        azimuth=np.abs((turned + 180.0) % 360.0 - 180.0),
        path_angle=np.abs(column(twins, "path_angle_deg") - column(flown, "path_angle_deg")),
        direction=angle_between(twins[..., GROUND_VELOCITY], flown[..., GROUND_VELOCITY]),
        speed=np.abs(column(twins, "airspeed_mps") - column(flown, "airspeed_mps")),
        position=np.linalg.norm(twins[..., POSITION] - flown[..., POSITION], axis=-1),
    )


def sensible_flights(dynamics_name: sim.Dynamics) -> Flights:
    settings = sim.Settings(dynamics=dynamics_name)
    commands = random_commands(settings)
    flown = fly(settings, np.tile(sim.start(settings), (FLIGHTS, 1)), commands, STEPS)
    chosen = is_sensible(flown)
    return Flights(settings, commands[:, chosen], flown[:, chosen])


def mirrored_difference(flights: Flights) -> Difference:
    """How the mirrored twins of flights differ from them."""
    twins = fly(flights.settings, flights.flown[0] * _MIRROR_STATE, flights.commands * _MIRROR_COMMAND, STEPS)
    return difference(flights.flown, twins * _MIRROR_STATE)


def difference_apart(flights: Flights) -> Difference:
    """How flights that start with another roll rate, by almost nothing, differ: what chaos alone would do."""
    beside = flights.flown[0].copy()
    beside[:, INDEX["roll_rate"]] += APART
    return difference(flights.flown, fly(flights.settings, beside, flights.commands, STEPS))


def difference_table(groups: dict[str, Difference]) -> str:
    """Median, 90th percentile and largest difference after some steps."""
    header = ["", *(f"{name.replace('_', ' ')}, {unit}" for name, unit in zip(UNITS._fields, UNITS, strict=True))]
    rows = []
    for name, group in groups.items():
        for steps in REPORTED_STEPS:
            cells = [spread(values[steps]) for values in group]
            rows.append([f"{name}, {steps} steps", *cells])
    return table(header, rows)


def chaos_table(groups: dict[str, Difference]) -> str:
    rows = [[name, *(spread(group.direction[steps]) for steps in REPORTED_STEPS)] for name, group in groups.items()]
    return table(["", *(f"direction after {steps} steps, °" for steps in REPORTED_STEPS)], rows)


def spread(values: Array) -> str:
    return " / ".join(significant(value, 2) for value in np.quantile(values, (0.5, 0.9, 1.0)))


def static_asymmetry(elevator_deg: float = 0.0) -> dict[str, Array]:
    """Half the sum of a lateral coefficient at β and at −β, which is zero for a symmetric aircraft; (α, β ≥ 0)."""
    sideslips = SIDESLIP.node[SIDESLIP.node >= 0.0]
    sums = np.zeros((len(QUANTITIES), ALPHA.node.size, sideslips.size))
    for i, alpha in enumerate(ALPHA.node):
        for j, beta in enumerate(sideslips):
            right, left = (
                coefficients(degrees(alpha), degrees(side * beta), 0.0, degrees(elevator_deg), 0.0, 0.0, 0.0, 0.0)
                for side in (1.0, -1.0)
            )
            sums[:, i, j] = [0.5 * (getattr(right, name) + getattr(left, name)) for name in QUANTITIES]
    return dict(zip(QUANTITIES, sums, strict=True))


def largest(values: Array, alphas: Array, sideslips: Array) -> str:
    """The largest in magnitude, and where."""
    i, j = np.unravel_index(np.abs(values).argmax(), values.shape)
    return f"{values[i, j]:+.4f} at α {alphas[i]:g}°, β ±{sideslips[j]:g}°"


def static_table(asymmetry: dict[str, Array]) -> str:
    alphas, sideslips = ALPHA.node, SIDESLIP.node[SIDESLIP.node >= 0.0]
    flown_alphas = (alphas >= FLOWN_ALPHA_DEG[0]) & (alphas <= FLOWN_ALPHA_DEG[1])
    flown_sideslips = sideslips <= FLOWN_SIDESLIP_DEG
    rows = []
    for name, values in asymmetry.items():
        flown = values[flown_alphas][:, flown_sideslips]
        rows.append(
            [
                name.capitalize(),
                f"{np.abs(values[:, 0]).max():g}",
                largest(flown, alphas[flown_alphas], sideslips[flown_sideslips]),
                largest(values, alphas, sideslips),
            ]
        )
    low, high = FLOWN_ALPHA_DEG
    where = f"α {low:g} to {high:g}°"
    header = ["", "β 0°, any α", f"{where}, β to ±{FLOWN_SIDESLIP_DEG:g}°", "anywhere"]
    return table(header, rows)


def symmetric_coefficients(
    angle_of_attack: float,
    sideslip: float,
    aileron: float,
    elevator: float,
    rudder: float,
    roll: float,
    pitch: float,
    yaw: float,
) -> Coefficients:
    """Mean of the tables and their mirror image."""
    plain = coefficients(angle_of_attack, sideslip, aileron, elevator, rudder, roll, pitch, yaw)
    other = coefficients(angle_of_attack, -sideslip, -aileron, elevator, -rudder, -roll, pitch, -yaw)
    signs = Coefficients(cx=1, cy=-1, cz=1, cl=-1, cm=1, cn=-1)
    return Coefficients(*(0.5 * (a + sign * b) for a, b, sign in zip(plain, other, signs, strict=True)))


def fly_plain(settings: sim.Settings, states: Array, commands: Array) -> Array:
    """The last states of flights in plain Python, in which a kernel or a constant may be replaced."""
    flown = states.copy()
    for command in commands:
        stepping._step_rows.py_func(flown, np.ascontiguousarray(command), STILL, settings.row, flown, 0, len(flown))
    return flown


def cause_table(start: Array, commands: Array) -> str:
    """The difference in direction of a few flights with the causes of the asymmetry taken away."""
    settings = sim.Settings()
    still_rotor = patch.object(dynamics, "ENGINE_ANGULAR_MOMENTUM", 0.0)
    symmetric = patch.object(dynamics, "coefficients", symmetric_coefficients)
    causes = {
        "as it is": (),
        "engine without angular momentum": (still_rotor,),
        "symmetric tables": (symmetric,),
        "both": (still_rotor, symmetric),
    }
    rows = []
    for name, changes in causes.items():
        with ExitStack() as stack:
            for change in changes:
                stack.enter_context(change)
            flown = fly_plain(settings, start, commands)
            twins = fly_plain(settings, start * _MIRROR_STATE, commands * _MIRROR_COMMAND) * _MIRROR_STATE
        rows.append([name, spread(angle_between(flown[:, GROUND_VELOCITY], twins[:, GROUND_VELOCITY]))])
    return table(["", f"direction after {CAUSE_STEPS} steps, °"], rows)


def draw_spread(axes: Axes, values: Array, colour: str, label: str) -> None:
    """Median with the band from the 10th to the 90th percentile."""
    seconds = np.arange(len(values)) * 0.1
    low, middle, high = np.quantile(values, (0.1, 0.5, 0.9), axis=1)
    axes.fill_between(seconds[1:], low[1:], high[1:], color=colour, alpha=0.18, linewidth=0)
    axes.semilogy(seconds[1:], middle[1:], color=colour, linewidth=2, label=label)


def draw_static(axes: Axes, values: Array, name: str) -> object:
    norm = TwoSlopeNorm(0.0, -np.abs(values).max(), np.abs(values).max())
    sideslips = SIDESLIP.node[SIDESLIP.node >= 0.0]
    image = axes.pcolormesh(sideslips, ALPHA.node, values, norm=norm, cmap="RdBu_r", shading="gouraud", rasterized=True)
    finish(axes, x="sideslip ±β, °", title=name.capitalize())
    return image


def draw(groups: dict[str, Difference], asymmetry: dict[str, Array]) -> None:
    figure = new_figure(7.4, 9.8)
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.4, 1.0])
    panels = upper.subplots(2, 1, sharex=True)
    for (name, group), colour in zip(groups.items(), COLOURS, strict=False):
        draw_spread(panels[0], group.direction, colour, name)
        draw_spread(panels[1], group.position, colour, name)
    finish(panels[0], y="direction, °", title="Flights and their mirrored twins: median, 10th to 90th percentile")
    finish(panels[1], y="position, m", x="time, s")
    panels[0].set(ylim=(1e-14, 1e2), yticks=10.0 ** np.arange(-12, 3, 4))
    panels[1].set(ylim=(1e-13, 1e3), yticks=10.0 ** np.arange(-12, 3, 4), xlim=(0, STEPS * 0.1))
    names = panels[0].get_legend_handles_labels()
    upper.legend(*names, loc="outside lower center", ncols=2, fontsize=10.5, frameon=False)

    maps = lower.subplots(1, 3, sharey=True)
    for axes, (name, values) in zip(maps, asymmetry.items(), strict=True):
        bar = lower.colorbar(draw_static(axes, values, name), ax=axes, location="bottom", shrink=0.95)
        bar.ax.tick_params(labelsize=9.5, colors=INK)
        bar.locator.set_params(nbins=3)
    maps[0].set_ylabel("angle of attack, °", size=11, color=INK)
    lower.suptitle("½ (C(β) + C(−β)), elevator 0: zero for a symmetric aircraft", size=11, color=FAINT)
    save(figure, "asymmetry.png")


def main() -> None:
    groups, beside, counts = {}, {}, []
    for name in ("reference", "accurate"):
        flights = sensible_flights(name)
        groups[f"{name}, mirrored"] = mirrored_difference(flights)
        beside[f"{name}, {APART:g} apart"] = difference_apart(flights)
        counts.append([name, str(FLIGHTS), str(flights.flown.shape[1])])
        if name == "reference":
            causes = cause_table(flights.flown[0, :CAUSE_FLIGHTS], flights.commands[:CAUSE_STEPS, :CAUSE_FLIGHTS])
    asymmetry = static_asymmetry()
    draw(groups | beside, asymmetry)
    tables = {
        "flights": table(["", "flights tried", "sensible"], counts),
        "differences": difference_table(groups),
        "chaos": chaos_table(beside),
        "causes": causes,
        "coefficients": static_table(asymmetry),
    }
    report("asymmetry.md", tables)


if __name__ == "__main__":
    main()
