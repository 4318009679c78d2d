"""Where the step of 0.1 s is too long: of the equations with held controls, of the control law, and where chaos begins.

    python docs/figures/stability_map.py      # some minutes

Writes docs/figures/stability_map.png and the tables of docs/accurate-dynamics.md.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from figure_tools import (
    FAINT,
    INDEX,
    INK,
    Array,
    column,
    finish,
    inside,
    new_figure,
    report,
    save,
    significant,
    table,
)
from figure_tools.linear import (
    LATERAL,
    LONGITUDINAL,
    PITCH_LOOP,
    ROLL_LOOP,
    Mode,
    growth_rate,
    level_flight,
    modes,
    step_matrix,
)
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patheffects import withStroke

from vvc_bench import sim
from vvc_bench.sim.atmosphere import SEA_LEVEL_DENSITY, air_at
from vvc_bench.sim.dynamics import Body

SPEEDS = np.arange(100.0, 351.0, 5.0)  # m/s
ALTITUDES = np.arange(0.0, 12001.0, 250.0)  # m
FREQUENCIES = (10.0, 20.0, 50.0)  # Hz
TABLE_ALTITUDES = (0.0, 3000.0, 5000.0, 8000.0)  # m
EXAMPLES = ((5000.0, 200.0), (3000.0, 200.0), (0.0, 200.0), (0.0, 275.0))  # m, m/s

EXCITATION = 2.0  # deg/s of roll rate, one second to the right and one to the left
SETTLING_STEPS = 100
MEASURED_STEPS = 200
APART = 1e-12  # rad/s of roll and pitch rate, and the length that the separation is brought back to after each step
SPEED_SCALE = 0.01  # s/m: 100 m/s count as much as 1 rad, 1 rad/s and 1 of the quaternion

HELD_CONTROLS = {"Dutch roll": LATERAL, "short period": LONGITUDINAL}
LOOPS = {"roll loop": ROLL_LOOP, "pitch loop": PITCH_LOOP}
LEVELS = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # 1/s
EQUIVALENT = (100.0, 150.0, 200.0, 250.0)  # m/s
SLOW_ALPHA_DEG = 8.0  # level flight at higher angles of attack is far from the boundary at high dynamic pressure
STABLE = 0.02  # 1/s: below, a slow drift that any pilot corrects

_SEPARATION = [*range(Body._fields.index("north")), INDEX["load_factor_integral"], INDEX["roll_rate_integral"]]
_WEIGHTS = np.array([SPEED_SCALE, *[1.0] * (len(_SEPARATION) - 1)])


class Grid(NamedTuple):
    """Where level flight exists."""

    altitude_m: Array
    speed_mps: Array

    def on_map(self, values: Array) -> Array:
        """Values as an altitude by speed table, NaN where there is no level flight."""
        full = np.full((ALTITUDES.size, SPEEDS.size), np.nan)
        full[np.searchsorted(ALTITUDES, self.altitude_m), np.searchsorted(SPEEDS, self.speed_mps)] = values
        return full


def has_trim(altitude_m: float, speed_mps: float) -> bool:
    try:
        sim.start(sim.Settings(), altitude_m=altitude_m, speed_mps=speed_mps)
    except ValueError:
        return False
    return True


def level_flight_grid() -> Grid:
    places = [place for place in product(ALTITUDES, SPEEDS) if has_trim(*place)]
    return Grid(*np.array(places).T)


def loop_growth(settings: sim.Settings, grid: Grid, *loops: tuple[str, ...]) -> Array:
    """Growth rate of the fastest of some loops by their linearised step, in 1/s."""
    states = level_flight(settings, *grid)
    rates = [growth_rate(step_matrix(settings, states, loop), settings.time_step) for loop in loops]
    return np.max(rates, axis=0)


def hold_level(k: int, states: Array, start: Array) -> Array:
    """Straight on at the start's altitude and speed, with a little rolling; commands for guidance mode."""
    side = 1.0 if (k // 10) % 2 == 0 else -1.0
    climb = (states[:, INDEX["altitude"]] - start[:, INDEX["altitude"]]) / 10.0 + states[:, INDEX["velocity_up"]]
    slower = start[:, INDEX["airspeed"]] - states[:, INDEX["airspeed"]]
    roll_rate = side * EXCITATION - column(states, "roll_deg")
    load_factor = start[:, INDEX["load_factor"]] - 0.05 * climb
    throttle = start[:, INDEX["throttle"]] + 0.05 * slower
    return inside(np.stack([roll_rate, load_factor, throttle], axis=-1), sim.Settings())


def separation_growth(settings: sim.Settings, grid: Grid) -> tuple[Array, Array]:
    """Mean growth rate of a small separation in 1/s, and the flights (steps, N, F) that it was measured along."""
    start = level_flight(settings, *grid)
    states = start
    for k in range(SETTLING_STEPS):
        states = sim.step_many(states, hold_level(k, states, start), settings)
    twins = states.copy()
    twins[:, [INDEX["roll_rate"], INDEX["pitch_rate"]]] += APART
    logarithm, flown = np.zeros(len(states)), []
    for k in range(SETTLING_STEPS, SETTLING_STEPS + MEASURED_STEPS):
        states = sim.step_many(states, hold_level(k, states, start), settings)
        twins = sim.step_many(twins, hold_level(k, twins, start), settings)
        difference = twins - states
        length = np.linalg.norm(difference[:, _SEPARATION] * _WEIGHTS, axis=1)
        logarithm += np.log(length / APART)
        twins = states + difference * (APART / length)[:, None]
        flown.append(states)
    return logarithm / (MEASURED_STEPS * settings.time_step), np.array(flown)


def first_unstable(grid: Grid, growth: Array, altitude_m: float) -> float:
    """Lowest speed in m/s from which on level flight at an altitude is unstable up to the highest; NaN if none."""
    here = grid.altitude_m == altitude_m
    speeds, unstable = grid.speed_mps[here], growth[here] > STABLE
    stable = np.flatnonzero(~unstable)
    first = stable[-1] + 1 if stable.size else 0
    return speeds[first] if first < speeds.size else np.nan


def boundary(grid: Grid, growth: Array, altitude_m: float) -> str:
    speed = first_unstable(grid, growth, altitude_m)
    if np.isnan(speed):
        return "stable"
    pressure = 0.5 * air_at(altitude_m, 1.0).density * speed * speed
    return f"{speed:.0f} ({pressure / 1000.0:.1f})"


def boundary_table(grid: Grid) -> str:
    """Where the loops become unstable, by dynamics and frequency."""
    rows = []
    for dynamics, frequency in product(("reference", "accurate"), FREQUENCIES):
        settings = sim.Settings(dynamics=dynamics, frequency_hz=frequency)
        for name, loop in LOOPS.items():
            growth = loop_growth(settings, grid, loop)
            cells = [boundary(grid, growth, altitude) for altitude in TABLE_ALTITUDES]
            rows.append([f"{dynamics}, {frequency:g} Hz, {name}", *cells])
    return table(["", *(f"{altitude / 1000.0:g} km" for altitude in TABLE_ALTITUDES)], rows)


def high_alpha_table(grid: Grid) -> str:
    """Angles of attack beyond which or between which slow flight is unstable."""
    rows = []
    for mode, loops in (("end_to_end", HELD_CONTROLS), ("guidance", LOOPS)):
        settings = sim.Settings(control_mode=mode, dynamics="accurate")
        alpha = column(level_flight(settings, *grid), "angle_of_attack_deg")
        for name, loop in loops.items():
            unstable = alpha[(loop_growth(settings, grid, loop) > STABLE) & (alpha > SLOW_ALPHA_DEG)]
            rows.append([name, f"{unstable.min():.1f}", f"{unstable.max():.1f}"])
    return table(["accurate, level flight", "unstable from, °", "to, °"], rows)


def held_controls_table() -> str:
    """The fast oscillations, Dutch roll and short period, exactly and as the Euler step has them."""
    rows = []
    for (altitude, speed), (name, fields) in product(EXAMPLES, HELD_CONTROLS.items()):
        exact = oscillation("accurate", altitude, speed, fields)
        euler = oscillation("reference", altitude, speed, fields)
        cells = (exact.frequency, exact.damping, exact.growth, euler.growth)
        rows.append([f"{altitude:g} m, {speed:g} m/s, {name}", *(significant(cell) for cell in cells)])
    return table(["", "frequency, rad/s", "damping ratio", "growth, 1/s", "growth with Euler at 10 Hz, 1/s"], rows)


def oscillation(dynamics: sim.Dynamics, altitude_m: float, speed_mps: float, fields: tuple[str, ...]) -> Mode:
    """The fastest oscillation of one kind of motion with held controls."""
    settings = sim.Settings(control_mode="end_to_end", dynamics=dynamics)
    matrix = step_matrix(settings, level_flight(settings, np.array([altitude_m]), np.array([speed_mps])), fields)[0]
    return next(mode for mode in modes(matrix, settings.time_step) if mode.damping < 1.0)


def leftmost_eigenvalue(matrices: Array) -> Array:
    """That of the fast rolling motion: the real eigenvalue furthest below 1."""
    return np.linalg.eigvals(matrices).real.min(axis=-1)


def roll_loop_table() -> str:
    """What one step makes of the rolling motion, and what the limit cycle is like."""
    grid = Grid(*np.array(EXAMPLES).T)
    rows = []
    for dynamics in ("reference", "accurate"):
        held, law = (sim.Settings(control_mode=mode, dynamics=dynamics) for mode in ("end_to_end", "guidance"))
        alone = leftmost_eigenvalue(step_matrix(held, level_flight(held, *grid), LATERAL))
        closed = leftmost_eigenvalue(step_matrix(law, level_flight(law, *grid), ROLL_LOOP))
        growth, flown = separation_growth(law, grid)
        swing = column(flown, "roll_rate_degps").std(axis=0)
        load_factor = np.ptp(flown[:, :, INDEX["load_factor"]], axis=0)
        for i, (altitude, speed) in enumerate(EXAMPLES):
            cells = (alone[i], closed[i], swing[i], load_factor[i], growth[i])
            rows.append([f"{dynamics}, {altitude:g} m, {speed:g} m/s", *(f"{cell:.2f}" for cell in cells)])
    header = [
        "",
        "eigenvalue, controls held",
        "eigenvalue, law",
        "roll rate, rms, deg/s",
        "load factor, range, g",
        "separation, 1/s",
    ]
    return table(header, rows)


def draw_map(axes: Axes, grid: Grid, values: Array, norm: BoundaryNorm, colours: ListedColormap) -> object:
    image = axes.pcolormesh(SPEEDS, ALTITUDES / 1000.0, grid.on_map(values), norm=norm, cmap=colours, rasterized=True)
    axes.set_facecolor("#c9ced6")
    equivalent = SPEEDS[:, None] * np.sqrt([air_at(h, 1.0).density / SEA_LEVEL_DENSITY for h in ALTITUDES])
    lines = axes.contour(SPEEDS, ALTITUDES / 1000.0, equivalent.T, levels=EQUIVALENT, colors=INK, linewidths=0.8)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    for label in axes.clabel(lines, fmt="%g", fontsize=9.5, colors=INK):
        label.set_path_effects(halo)
    axes.plot(200, 5, "o", color="white", markeredgecolor=INK, markersize=7)
    return image


def draw(grid: Grid, maps: list[tuple[str, Array]]) -> None:
    colours = ListedColormap(["#e8f3ee", "#fff1c9", "#ffd27a", "#f7a14b", "#e2663c", "#b52f45", "#6a1b4d", "#2d0b3a"])
    norm = BoundaryNorm(LEVELS, colours.N, extend="both")
    figure = new_figure(8.0, 10.6)
    panels = figure.subplots(3, 2, sharex=True, sharey=True)
    for axes, (title, values) in zip(panels.flat, maps, strict=True):
        image = draw_map(axes, grid, values, norm, colours)
        finish(axes, title=title)
    for axes in panels[-1]:
        axes.set_xlabel("true airspeed, m/s", size=11, color=INK)
    for axes in panels[:, 0]:
        axes.set_ylabel("altitude, km", size=11, color=INK)
    bar = figure.colorbar(
        image, ax=panels, location="bottom", aspect=40, shrink=0.9, extend="both", ticks=LEVELS, pad=0.02
    )
    bar.set_label("growth rate of a small deviation, 1/s", size=11, color=INK)
    bar.ax.tick_params(labelsize=10.5, colors=INK)
    note = "lines: equivalent airspeed, m/s     ○ the default start     grey: no level flight"
    figure.supxlabel(note, size=10.5, color=FAINT)
    save(figure, "stability_map.png")


def main() -> None:
    grid = level_flight_grid()
    settings = {
        (mode, dynamics): sim.Settings(control_mode=mode, dynamics=dynamics)
        for mode, dynamics in product(("end_to_end", "guidance"), ("reference", "accurate"))
    }
    maps = []
    for (mode, dynamics), chosen in settings.items():
        loops = (HELD_CONTROLS if mode == "end_to_end" else LOOPS).values()
        name = "controls held" if mode == "end_to_end" else "control law, linear"
        maps.append((f"{dynamics}, {name}", loop_growth(chosen, grid, *loops)))
    for dynamics in ("reference", "accurate"):
        growth, _ = separation_growth(settings["guidance", dynamics], grid)
        maps.append((f"{dynamics}, two flights", growth))
    draw(grid, maps)
    tables = {
        "held controls": held_controls_table(),
        "high angles of attack": high_alpha_table(grid),
        "loops": boundary_table(grid),
        "limit cycle": roll_loop_table(),
    }
    report("accurate-dynamics.md", tables)


if __name__ == "__main__":
    main()
