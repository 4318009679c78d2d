"""How far the reference dynamics fly from the truth, and how fast both dynamics come closer with shorter steps.

    python docs/figures/accurate_dynamics.py

Writes docs/figures/accurate_dynamics.png and the tables of docs/accurate-dynamics.md.
"""

from typing import NamedTuple

import numpy as np
from figure_tools import (
    COLOURS,
    FAINT,
    GROUND_VELOCITY,
    INDEX,
    INK,
    POSITION,
    Array,
    angle_between,
    column,
    direction,
    finish,
    fly,
    inside,
    new_figure,
    pieces,
    report,
    save,
    significant,
    table,
    truth,
    with_substep,
)
from matplotlib.axes import Axes

from vvc_bench import sim

SECONDS = 40.0
REPORTED = (10.0, 20.0, 40.0)  # s
FREQUENCIES = (10.0, 20.0, 50.0, 100.0)  # Hz
SUBSTEPS = (0.1, 0.05, 0.025, 0.0125, 0.00625)  # s
SMOOTH_STEPS = 4  # 0.4 s, in which the sideslip below does not come back to the tables' node at zero
SMOOTH_START = {"angle_of_attack_deg": 2.5, "pitch_deg": 2.5, "sideslip_deg": 1.0, "roll_rate_degps": 2.0}

# Parts of (s, roll rate deg/s, load factor g, throttle). The first part makes up for the control law's empty
# integrator, with which the nose drops at first.
GUIDANCE = {
    "straight and level": [(1.5, 0, 1.6, 0.15), (38.5, 0, 1, 0.155)],
    "gentle turn": [(1.5, 0, 1.6, 0.16), (2, 20, 1, 0.16), (31, 0, 1.3, 0.2), (2, -20, 1, 0.2), (3.5, 0, 1, 0.16)],
    "hard turn": [(1.5, 0, 1.6, 0.2), (1.5, 50, 1, 0.8), (11, 0, 4.2, 1), (1.5, -50, 1, 0.6), (24.5, 0, 1, 0.15)],
    "climb": [(1.5, 0, 1.6, 0.5), (4, 0, 2, 0.7), (24, 0, 0.93, 0.5), (4, 0, 0, 0.2), (6.5, 0, 1, 0.15)],
    "dive and pull-up": [(1.5, 0, 1.6, 0.1), (5, 0, 0, 0), (8, 0, 0.9, 0), (5, 0, 2.5, 0.2), (20.5, 0, 0.96, 0.3)],
    "aileron roll": [(1.5, 0, 1.6, 0.15), (3, 0, 1.5, 0.3), (3, 120, 1, 0.3), (32.5, 0, 1.05, 0.16)],
    "full throttle": [(1.5, 0, 1.6, 0.15), (38.5, 0, 1, 1)],
}
# Parts of (s, aileron deg, elevator deg), on top of the trim.
END_TO_END = {
    "elevator doublet": [(1, 0, 0), (1, 0, -0.5), (1, 0, 0.5), (37, 0, 0)],
    "aileron doublet": [(1, 0, 0), (1, 2, 0), (1, -2, 0), (37, 0, 0)],
}
BOTH_DOUBLETS = [(1, 0, 0), (1, 2, -0.5), (1, -2, 0.5), (37, 0, 0)]


class Comparison(NamedTuple):
    """The reference beside the truth; each of shape (steps + 1, N)."""

    position: Array
    """Distance in m."""
    direction: Array
    """Angle between the velocity vectors in degrees."""
    speed: Array
    """Difference in m/s."""
    lag: Array
    """Angle between the flight path that the reference reports and its own velocity, in degrees."""
    airspeed: Array
    """Of the truth, in m/s."""


def guidance_commands(settings: sim.Settings) -> Array:
    sequences = [inside(pieces(*parts), settings) for parts in GUIDANCE.values()]
    return np.stack(sequences, axis=1)


def doublets(settings: sim.Settings, *sequences: list[tuple[float, float, float]]) -> Array:
    """Deflections about the trim, rudder and throttle held; shape (steps, N, 4)."""
    trim = sim.start(settings)
    names = ("aileron", "elevator", "rudder", "throttle")
    held = trim[[INDEX[name] for name in names]]
    wide = [[(*part, 0.0, 0.0) for part in parts] for parts in sequences]
    deflected = [inside(pieces(*parts), settings) for parts in wide]
    return held + np.stack(deflected, axis=1)


def starts(settings: sim.Settings, count: int) -> Array:
    return np.tile(sim.start(settings), (count, 1))


def compare(settings: sim.Settings, commands: Array) -> Comparison:
    states = starts(settings, commands.shape[1])
    flown = fly(settings, states, commands, len(commands))
    true = fly(truth(settings), states, commands, len(commands))
    reported = direction(flown[..., INDEX["path_angle"]], flown[..., INDEX["azimuth"]])
    return Comparison(
        position=distance(flown, true),
        direction=angle_between(flown[..., GROUND_VELOCITY], true[..., GROUND_VELOCITY]),
        speed=column(flown, "airspeed_mps") - column(true, "airspeed_mps"),
        lag=angle_between(reported, flown[..., GROUND_VELOCITY]),
        airspeed=column(true, "airspeed_mps"),
    )


def distance(a: Array, b: Array) -> Array:
    return np.linalg.norm(a[..., POSITION] - b[..., POSITION], axis=-1)


def error_table(comparisons: dict[str, Comparison], left: dict[str, Array]) -> str:
    """Errors at a few times, the largest lag, and the error that the accurate dynamics leave."""
    times = " / ".join(f"{seconds:g}" for seconds in REPORTED)
    header = [
        "",
        "speed, m/s",
        f"position, m, at {times} s",
        f"direction, ° at {times} s",
        f"speed, m/s, at {times} s",
        "lag of the report, °, mean / largest",
        "position left by `accurate`, m",
    ]
    rows = []
    for name, run in comparisons.items():
        chosen = [round(seconds * 10.0) for seconds in REPORTED]
        errors = [
            " / ".join(significant(values[k], 2) for k in chosen) for values in (run.position, run.direction, run.speed)
        ]
        speeds = f"{run.airspeed.min():.0f} to {run.airspeed.max():.0f}"
        lag = f"{run.lag.mean():.2f} / {run.lag.max():.2f}"
        rows.append([name, speeds, *errors, lag, significant(left[name][-1], 2)])
    return table(header, rows)


def each(names: dict[str, object], comparison: Comparison) -> dict[str, Comparison]:
    """One comparison of many aircraft as one for each."""
    return {name: Comparison(*(values[:, i] for values in comparison)) for i, name in enumerate(names)}


def left_by_accurate(settings: sim.Settings, commands: Array) -> Array:
    """Distance in m between the accurate dynamics as shipped and ten times finer ones; shape (steps + 1, N)."""
    states = starts(settings, commands.shape[1])
    shipped = sim.Settings(settings.control_mode, "accurate")
    return distance(*(fly(chosen, states, commands, len(commands)) for chosen in (shipped, truth(settings))))


def frequency_errors() -> dict[float, Array]:
    """Position error of the reference at other frequencies under the same held inputs, at each 0.1 s."""
    slow = sim.Settings(control_mode="end_to_end")
    commands = doublets(slow, BOTH_DOUBLETS)
    states = starts(slow, 1)
    true = fly(truth(slow), states, commands, len(commands))
    errors = {}
    for frequency in FREQUENCIES:
        settings = sim.Settings(control_mode="end_to_end", frequency_hz=frequency)
        every = round(frequency / slow.frequency_hz)
        faster = np.repeat(commands, every, axis=0)
        errors[frequency] = distance(fly(settings, states, faster, len(faster))[::every], true)[:, 0]
    return errors


def frequency_table(errors: dict[float, Array]) -> str:
    rows = [
        [f"{frequency:g} Hz", *(significant(error[round(seconds * 10.0)]) for seconds in REPORTED)]
        for frequency, error in errors.items()
    ]
    return table(["", *(f"position error at {seconds:g} s, m" for seconds in REPORTED)], rows)


def substep_errors(states: Array, commands: Array) -> list[float]:
    """Error in the angles and rates, in rad and rad/s, at the end of a flight by accurate dynamics of long substeps."""
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate")
    compared = slice(INDEX["angle_of_attack"], INDEX["yaw_rate"] + 1)
    true = fly(with_substep(settings, SUBSTEPS[-1] / 16.0), states, commands, len(commands))[-1]
    ends = [fly(with_substep(settings, h), states, commands, len(commands))[-1] for h in SUBSTEPS]
    return [float(np.linalg.norm((end - true)[0, compared])) for end in ends]


def orders() -> dict[str, list[float]]:
    """The accurate dynamics within one cell of the tables, and across their nodes."""
    settings = sim.Settings(control_mode="end_to_end")
    commands = doublets(settings, BOTH_DOUBLETS)
    level = sim.start(settings)
    trim = {name: column(level, name) for name in ("airspeed_mps", "altitude_m", "elevator_deg", "throttle")}
    smooth = sim.start_from(settings, **trim, **SMOOTH_START)[None]
    return {
        "within a cell, 0.4 s": substep_errors(smooth, commands[:SMOOTH_STEPS]),
        "across nodes, 10 s": substep_errors(level[None], commands[:100]),
    }


def order_table(errors: dict[str, list[float]]) -> str:
    rows = []
    for name, values in errors.items():
        observed = np.log2(np.array(values[:-1]) / values[1:])
        rows.append([f"{name}: error", *(f"{value:.1e}" for value in values)])
        rows.append([f"{name}: order", "", *(f"{order:.1f}" for order in observed)])
    return table(["substep, s", *(f"{h:g}" for h in SUBSTEPS)], rows)


def draw_errors(axes: list[Axes], comparisons: dict[str, Comparison]) -> None:
    panels = ("position", "direction", "speed")
    labels = ("position error, m", "direction error, °", "speed error, m/s")
    titles = ("How far the reference is from the truth", "", "")
    for panel, name, label, title in zip(axes, panels, labels, titles, strict=True):
        for (manoeuvre, run), colour in zip(comparisons.items(), COLOURS, strict=False):
            values = np.abs(getattr(run, name))
            seconds = np.arange(values.size) * 0.1
            style = "--" if manoeuvre in END_TO_END else "-"
            panel.semilogy(seconds[1:], values[1:], style, color=colour, linewidth=1.7, label=manoeuvre)
        finish(panel, y=label, title=title)
        panel.set_xlim(0, SECONDS)
    axes[0].set_ylim(1e-2, 3e3)
    axes[1].set_ylim(1e-3, 3e1)
    axes[2].set_ylim(1e-3, 3e1)
    axes[2].set_xlabel("time, s", size=11, color=INK)


def draw_slope(axes: Axes, x: Array, end: float, order: int) -> None:
    """A thin line of a given order through the last point."""
    y = end * (x / x[-1]) ** order
    axes.loglog(x, y, ":", color=FAINT, linewidth=1.5)
    axes.text(x[1], 0.8 * y[1], f" order {order}", color=FAINT, size=10.5, va="top")


def draw(comparisons: dict[str, Comparison], frequencies: dict[float, Array], substeps: dict[str, list[float]]) -> None:
    figure = new_figure(7.4, 12.6)
    errors, convergence = figure.subfigures(2, 1, height_ratios=[3.1, 1.0])
    panels = list(errors.subplots(3, 1, sharex=True))
    draw_errors(panels, comparisons)
    names = panels[0].get_legend_handles_labels()
    errors.legend(*names, loc="outside upper center", ncols=3, fontsize=10.5, frameon=False)

    left, right = convergence.subplots(1, 2)
    steps = 1.0 / np.array(list(frequencies))
    for seconds, colour in zip(REPORTED[:2], COLOURS, strict=False):
        values = np.array([error[round(seconds * 10.0)] for error in frequencies.values()])
        left.loglog(steps, values, "o-", color=colour, label=f"after {seconds:g} s")
    draw_slope(left, steps, values[-1], 1)
    finish(left, x="step, s", y="position error, m", title="reference: order 1")
    left.legend(fontsize=10, frameon=False)
    for (name, values), colour in zip(substeps.items(), COLOURS, strict=False):
        right.loglog(SUBSTEPS, values, "o-", color=colour, label=name)
    draw_slope(right, np.array(SUBSTEPS), substeps["within a cell, 0.4 s"][-1], 4)
    finish(right, x="substep, s", y="error, rad and rad/s", title="accurate: order 4")
    right.legend(fontsize=10, frameon=False)
    save(figure, "accurate_dynamics.png")


def main() -> None:
    guided, held = sim.Settings(), sim.Settings(control_mode="end_to_end")
    comparisons: dict[str, Comparison] = {}
    left: dict[str, Array] = {}
    for settings, names, commands in (
        (guided, GUIDANCE, guidance_commands(guided)),
        (held, END_TO_END, doublets(held, *END_TO_END.values())),
    ):
        comparisons |= each(names, compare(settings, commands))
        left |= dict(zip(names, left_by_accurate(settings, commands).T, strict=True))
    frequencies, substeps = frequency_errors(), orders()
    draw(comparisons, frequencies, substeps)
    tables = {
        "errors": error_table(comparisons, left),
        "frequency": frequency_table(frequencies),
        "order": order_table(substeps),
    }
    report("accurate-dynamics.md", tables)


if __name__ == "__main__":
    main()
