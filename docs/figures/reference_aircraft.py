"""The reference aircraft in figures: its air, its trim, its performance and its modes.

    python docs/figures/reference_aircraft.py

Writes docs/figures/reference_aircraft.png and the tables of docs/reference-aircraft.md.
"""

import math

import numpy as np
from figure_tools import FAINT, INDEX, INK, Array, column, finish, new_figure, report, save, significant, table
from figure_tools.linear import LATERAL, LONGITUDINAL, Mode, level_flight, mode_of, modes, modes_of, step_matrix
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from vvc_bench import sim
from vvc_bench.sim.aircraft import GRAVITY
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.fields import degrees
from vvc_bench.sim.trim import Trim, trim_rows

SPEEDS = np.arange(60.0, 451.0, 2.5)  # m/s
ALTITUDES = np.arange(0.0, 15001.0, 125.0)  # m
TABLE_ALTITUDES = (0.0, 2000.0, 5000.0, 8000.0, 11000.0, 15000.0)  # m
FINE_SPEEDS = np.arange(30.0, 901.0, 0.5)  # m/s

# Stevens, Lewis, Johnson, "Aircraft Control and Simulation", 3rd ed., 2015: F-16 model, straight and level at 502 ft/s
# and sea level, centre of gravity at 0.30 chords.
PUBLISHED_SPEED_MPS = 502.0 * 0.3048
PUBLISHED_LONGITUDINAL = (complex(-1.2039, 1.4922), complex(-0.0087297, 0.073966))
PUBLISHED_LATERAL = np.array(  # of sideslip, bank, roll rate and yaw rate, in rad and s
    [
        [-3.2200e-1, 6.4032e-2, 3.8904e-2, -9.9156e-1],
        [0.0, 0.0, 1.0, 3.9385e-2],
        [-3.0919e1, 0.0, -3.6730, 6.7425e-1],
        [9.4724, 0.0, -2.6358e-2, -4.9849e-1],
    ]
)
ELEVATOR_LEVELS = np.array([-16.0, -12.0, -8.0, -6.0, -4.0, -3.0, -2.0, -1.8, -1.6, -1.4, -1.2])  # deg
MODE_CONDITIONS = ((0.0, PUBLISHED_SPEED_MPS), (5000.0, 200.0), (5000.0, 300.0), (10000.0, 250.0))  # m, m/s

MODE_NAMES = ("short period", "phugoid", "Dutch roll", "roll", "spiral")
MODE_COLUMNS = (
    ("short period", "ω, rad/s"),
    ("short period", "ζ"),
    ("phugoid", "ω, rad/s"),
    ("phugoid", "ζ"),
    ("Dutch roll", "ω, rad/s"),
    ("Dutch roll", "ζ"),
    ("roll", "time constant, s"),
    ("spiral", "time constant, s"),
)


def standard_density(altitude_m: float) -> float:
    """ISO 2533 in the troposphere and the lower stratosphere, by geopotential altitude; kg/m³."""
    gas_constant, gravity, lapse, tropopause = 287.05287, 9.80665, 0.0065, 11000.0
    temperature = 288.15 - lapse * min(altitude_m, tropopause)
    pressure = 101325.0 * (temperature / 288.15) ** (gravity / (lapse * gas_constant))
    if altitude_m > tropopause:
        pressure *= math.exp(-gravity * (altitude_m - tropopause) / (gas_constant * temperature))
    return pressure / (gas_constant * temperature)


def density_table() -> str:
    rows = []
    for altitude in TABLE_ALTITUDES:
        ours, standard = air_at(altitude, 1.0).density, standard_density(altitude)
        difference = round(100.0 * (ours / standard - 1.0), 1) + 0.0  # no minus zero
        rows.append([f"{altitude / 1000.0:g}", f"{standard:.4f}", f"{ours:.4f}", f"{difference:+.1f}"])
    return table(["altitude, km", "ISO 2533, kg/m³", "here, kg/m³", "difference, %"], rows)


def trim_at(altitude_m: Array, speed_mps: Array) -> Trim:
    """Trim at many places; its throttle is NaN or beyond 1 where there is none."""
    altitude, speed = (np.ascontiguousarray(values.ravel(), dtype=float) for values in (altitude_m, speed_mps))
    solved = np.empty((altitude.size, len(Trim._fields)))
    trim_rows(altitude, speed, np.ones(altitude.size), np.ones(altitude.size), solved)
    return Trim(*(values.reshape(altitude_m.shape) for values in solved.T))


def is_trimmed(trim: Trim) -> Array:
    return (trim.throttle >= 0.0) & (trim.throttle <= 1.0)


def excess_power(altitude_m: Array, speed_mps: Array) -> Array:
    """Specific excess power at full throttle and 1 g in m/s, from one small step of the accurate dynamics."""
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate", frequency_hz=100.0)
    before = sim.start(settings, altitude_m=altitude_m, speed_mps=speed_mps)
    command = before[:, [INDEX[name] for name in sim.SurfaceCommand._fields]]
    command[:, sim.SurfaceCommand._fields.index("throttle")] = 1.0
    after = sim.step_many(before, command, settings)
    return (energy_height(after) - energy_height(before)) / settings.time_step


def energy_height(states: Array) -> Array:
    """Specific energy in m."""
    return column(states, "altitude_m") + column(states, "airspeed_mps") ** 2 / (2.0 * GRAVITY)


def performance_table() -> str:
    """Slowest and fastest level flight, and the best climb, by altitude."""
    rows = []
    for altitude in TABLE_ALTITUDES:
        altitudes = np.full(FINE_SPEEDS.size, altitude)
        trim = trim_at(altitudes, FINE_SPEEDS)
        level = np.flatnonzero(is_trimmed(trim))
        first, last = level[0], level[-1]
        sound_speed = air_at(altitude, 1.0).sound_speed
        subsonic = level[FINE_SPEEDS[level] <= sound_speed]
        power = excess_power(altitudes[subsonic], FINE_SPEEDS[subsonic])
        best = power.argmax()
        rows.append(
            [
                f"{altitude / 1000.0:g}",
                f"{FINE_SPEEDS[first]:.0f}",
                f"{trim.angle_of_attack[first] / degrees(1.0):.0f}",
                f"{FINE_SPEEDS[last]:.0f}",
                f"{FINE_SPEEDS[last] / sound_speed:.2f}",
                f"{power[best]:.0f}",
                f"{FINE_SPEEDS[subsonic][best]:.0f}",
            ]
        )
    header = [
        "altitude, km",
        "slowest, m/s",
        "its angle of attack, °",
        "fastest, m/s",
        "its Mach number",
        "largest excess power at 1 g below Mach 1, m/s",
        "at, m/s",
    ]
    return table(header, rows)


def modes_at(altitude_m: float, speed_mps: float) -> dict[str, Mode]:
    """The five classical modes of level flight with held controls."""
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate")
    states = level_flight(settings, np.array([altitude_m]), np.array([speed_mps]))
    longitudinal, lateral = (
        modes(step_matrix(settings, states, fields)[0], settings.time_step) for fields in (LONGITUDINAL, LATERAL)
    )
    return named_modes(longitudinal, lateral)


def published_modes() -> dict[str, Mode]:
    longitudinal = [mode_of(root) for root in PUBLISHED_LONGITUDINAL]
    return named_modes(longitudinal, modes_of(np.linalg.eigvals(PUBLISHED_LATERAL)))


def named_modes(longitudinal: list[Mode], lateral: list[Mode]) -> dict[str, Mode]:
    """Modes by name, from lists with the fastest first."""
    roll, spiral = (mode for mode in lateral if abs(mode.damping) >= 1.0)
    dutch_roll = next(mode for mode in lateral if abs(mode.damping) < 1.0)
    short_period, phugoid = longitudinal
    return dict(zip(MODE_NAMES, (short_period, phugoid, dutch_roll, roll, spiral), strict=True))


def mode_table() -> str:
    """Frequency and damping of the oscillations, time constants of the others."""
    conditions = {f"{altitude:g} m, {speed:.0f} m/s": modes_at(altitude, speed) for altitude, speed in MODE_CONDITIONS}
    conditions = {"published, 0 m, 153 m/s": published_modes()} | conditions
    header = ["", *(f"{name}: {what}" for name, what in MODE_COLUMNS)]
    rows = [
        [name, *(mode_cell(found[mode], what) for mode, what in MODE_COLUMNS)] for name, found in conditions.items()
    ]
    return table(header, rows)


def mode_cell(mode: Mode, what: str) -> str:
    if what == "ζ":
        return significant(mode.damping)
    return significant(mode.frequency if what.startswith("ω") else -1.0 / mode.growth)


def draw_map(figure: Figure, axes: Axes, values: Array, levels: Array, colours: str, title: str) -> None:
    norm = BoundaryNorm(levels, 256, extend="both")
    image = axes.contourf(SPEEDS, ALTITUDES / 1000.0, values, levels=levels, cmap=colours, norm=norm, extend="both")
    lines = axes.contour(SPEEDS, ALTITUDES / 1000.0, values, levels=levels[::2], colors="white", linewidths=0.7)
    axes.clabel(lines, fmt="%g", fontsize=9)
    axes.set_facecolor("#c9ced6")
    finish(axes, title=title)
    bar = figure.colorbar(
        image, ax=axes, location="bottom", aspect=30, ticks=levels[::2], spacing="uniform", format="%g"
    )
    bar.ax.tick_params(labelsize=9.5, colors=INK)


def draw() -> None:
    speeds, altitudes = np.meshgrid(SPEEDS, ALTITUDES)
    trim = trim_at(altitudes, speeds)
    trimmed = is_trimmed(trim)
    power = np.full(speeds.shape, np.nan)
    power[trimmed] = excess_power(altitudes[trimmed], speeds[trimmed])
    maps = (
        (trim.angle_of_attack / degrees(1.0), np.arange(-2.0, 31.0, 2.0), "viridis", "angle of attack, °"),
        (trim.elevator / degrees(1.0), ELEVATOR_LEVELS, "cividis", "elevator, °"),
        (trim.throttle, np.arange(0.0, 1.05, 0.1), "magma", "throttle"),
        (power, np.arange(0.0, 201.0, 20.0), "YlGnBu_r", "excess power at full throttle, m/s"),
    )
    figure = new_figure(8.0, 9.4)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (values, levels, colours, title) in zip(panels.flat, maps, strict=True):
        draw_map(figure, axes, np.where(trimmed, values, np.nan), levels, colours, title)
        mach = speeds / np.vectorize(lambda altitude: air_at(altitude, 1.0).sound_speed)(altitudes)
        axes.contour(SPEEDS, ALTITUDES / 1000.0, mach, levels=[1.0], colors=INK, linestyles="--", linewidths=1.0)
        axes.text(64, 13.6, "too slow", size=10, color=INK)
        axes.text(376, 0.6, "too fast", size=10, color=INK)
    for axes in panels[-1]:
        axes.set_xlabel("true airspeed, m/s", size=11, color=INK)
    for axes in panels[:, 0]:
        axes.set_ylabel("altitude, km", size=11, color=INK)
    figure.supxlabel("level flight   ·   dashed: Mach 1   ·   grey: no trim", size=10.5, color=FAINT)
    save(figure, "reference_aircraft.png")


def main() -> None:
    draw()
    report(
        "reference-aircraft.md",
        {"density": density_table(), "performance": performance_table(), "modes": mode_table()},
    )


if __name__ == "__main__":
    main()
