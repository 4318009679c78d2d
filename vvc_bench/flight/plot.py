"""A flight as a picture: its path in space on the left, its time histories on the right.

Takes the extra ``plot`` (matplotlib). Figures are made without pyplot, so that nothing global is touched.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.flight.goal import DEFAULT_TASK, goal_errors, time_to_reach, wanted
from vvc_bench.flight.recording import Flight
from vvc_bench.sim import State, fields_of
from vvc_bench.sim.fields import Goal
from vvc_bench.sim.units import DEGREES_PER_RADIAN

try:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgba
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d import proj3d
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
except ImportError as error:
    raise ImportError("plots take matplotlib, which is missing: pip install vvc-bench[plot]") from error

Array = NDArray[np.float64]

FLOWN = "#1d3557"
WANTED = "#d9730d"
SHADOW = "#9aa3ad"
REACHED = "#2a9d5c"
_LINES = (FLOWN, "#2a9d8f", "#b5446e")
_TEXT = "#2b2d33"
_FAINT = "#6b7280"

_SIZE = (16.0, 9.0)  # inches
_DOTS_PER_INCH = 120
_LONGEST_RIBBON = 500  # segments
_GLYPHS = 9
_GLYPH_LENGTH = 0.095  # of the largest extent
_ARROW_LENGTH = 0.17  # of the largest extent
_BOX_CENTRE = np.array([0.305, 0.49])  # of the figure
_BOX_SIZE = np.array([0.53, 0.67])

# A small aircraft, nose to tail one unit long: x forward, y right, z up. Drawn many times its size.
_WING = [(0.10, 0.05), (-0.22, 0.34), (-0.32, 0.34), (-0.30, 0.05)]
_TAIL = [(-0.34, 0.04), (-0.47, 0.18), (-0.54, 0.18), (-0.50, 0.03)]
_GLYPH = [
    *([(x, side * y, 0.0) for x, y in outline] for outline in (_WING, _TAIL) for side in (1, -1)),
    *(
        [(0.5, 0.0, 0.0), (0.12, side * 0.055, 0.0), (-0.5, side * 0.04, 0.0), (-0.5, 0.0, 0.03), (0.15, 0.0, 0.075)]
        for side in (1, -1)
    ),
    [(-0.22, 0.0, 0.05), (-0.46, 0.0, 0.23), (-0.55, 0.0, 0.23), (-0.50, 0.0, 0.02)],
]
_GLYPH_SHADES = ("#5c7896", "#5c7896", "#48617c", "#48617c", "#33475f", "#33475f", "#c1443c")
_WING_HALF_SPAN = 0.34
_MOST_CORNERS = max(map(len, _GLYPH))  # matplotlib 3.11 pads shorter polygons with unset memory, which may overflow


class Panel(NamedTuple):
    """One time history: the state's fields that it shows."""

    fields: tuple[str, ...]
    height: float = 1.0


_PANELS = (
    Panel(("speed",)),
    Panel(("path_angle",)),
    Panel(("azimuth",)),
    Panel(("load_factor",)),
    Panel(("roll",)),
    Panel(("aileron", "elevator", "rudder")),
    Panel(("throttle",), 0.7),
)
_UNIT_TEXT = {"mps": "m/s", "deg": "°", "g": "g"}


def plot(flight: Flight) -> Figure:
    """Draw a flight.

    On the left its path, to scale and seen from the side, as a ribbon that banks with the aircraft and is coloured by
    load factor, with the aircraft many times its size at equal times, its shadow, and the wanted direction as an arrow.
    On the right speed, path angle, azimuth with the goal and its band (10 m/s, 3°), load factor, bank, deflections and
    throttle; dashed where they are commanded.

    Returns:
        A figure to be saved or shown, 16 × 9 inches.
    """
    figure = Figure(figsize=_SIZE, dpi=_DOTS_PER_INCH, facecolor="white")
    _write_titles(figure, flight)
    _draw_space(figure, flight)
    _draw_histories(figure, flight)
    return figure


def _write_titles(figure: Figure, flight: Flight) -> None:
    settings, start = flight.settings, State(*flight.states[0][: len(State._fields)])
    title = "Flight without a goal"
    if flight.goal is not None:
        speed, path_angle, azimuth = flight.goal
        title = (
            f"Goal  {speed:g} m/s,  path angle {path_angle * DEGREES_PER_RADIAN:g}°,  "
            f"azimuth {azimuth * DEGREES_PER_RADIAN:g}°"
        ).replace("-", "−")
    figure.text(0.025, 0.945, title, size=19, weight="bold", color=_TEXT)
    how = (
        f"from {start.altitude:.0f} m and {start.airspeed:.0f} m/s   ·   {settings.dynamics} dynamics at "
        f"{settings.frequency_hz:g} Hz"
    )
    figure.text(0.025, 0.912, how, size=11.5, color=_FAINT)
    if flight.goal is not None:
        reached = time_to_reach(flight)
        if math.isfinite(reached):
            figure.text(0.025, 0.878, f"reached after {reached:.1f} s", size=12.5, weight="bold", color=REACHED)
        else:
            text = f"not reached in {flight.time[-1]:g} s"
            figure.text(0.025, 0.878, text, size=12.5, weight="bold", color=WANTED)


# Space


def _draw_space(figure: Figure, flight: Flight) -> None:
    history = flight.history
    position = np.stack([history.east, history.north, history.altitude], axis=-1) / 1000.0  # km
    extent = max(0.2, float(np.ptp(position, axis=0).max()))
    axes: Any = figure.add_axes((0.05, 0.05, 0.5, 0.5 * _SIZE[0] / _SIZE[1]), projection="3d", computed_zorder=False)
    low, high = _limits(position, extent)
    _set_box(axes, low, high, position)

    shown = np.unique(np.linspace(0, len(position) - 1, _LONGEST_RIBBON + 1).round().astype(int))
    axes_of_body = _body_axes(flight.states)
    span = _GLYPH_LENGTH * _WING_HALF_SPAN * extent
    left, right = position - span * axes_of_body[:, :, 1], position + span * axes_of_body[:, :, 1]
    glyphs = np.unique(np.linspace(0, len(position) - 1, _GLYPHS).round().astype(int))

    _draw_shadow(axes, left[shown], right[shown], position, glyphs, low[2])
    scale = _draw_ribbon(axes, left[shown], right[shown], np.asarray(history.load_factor)[shown])
    _draw_glyphs(axes, position[glyphs], axes_of_body[glyphs], _GLYPH_LENGTH * extent)
    if flight.goal is not None:
        _draw_goal(axes, position[-1], wanted(flight), _ARROW_LENGTH * extent)
    bar = figure.colorbar(scale, cax=figure.add_axes((0.05, 0.075, 0.17, 0.012)), orientation="horizontal")
    bar.set_label("load factor, g", color=_FAINT, size=9.5)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=8.5, colors=_FAINT, length=2)


def _body_axes(states: Array) -> Array:
    """Body x forward, y right and z up in the picture's east, north, up; shape (T + 1, 3, 3), one axis a column."""
    state = State(*states[:, : len(State._fields)].T)
    quaternion = np.array([state.quaternion_w, state.quaternion_x, state.quaternion_y, state.quaternion_z])
    w, x, y, z = quaternion / np.sqrt(np.square(quaternion).sum(axis=0))
    north = [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)]
    east = [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)]
    down = [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]
    turned = np.array([east, north, down])  # earth axis, body axis, time
    turned[2] *= -1.0
    turned[:, 2] *= -1.0
    return np.moveaxis(turned, -1, 0)


def _limits(position: Array, extent: float) -> tuple[Array, Array]:
    """Corners of a box around the path with room for the arrow, in km; its floor is never below the ground."""
    margin = 0.12 * extent
    low, high = position.min(axis=0) - margin, position.max(axis=0) + margin
    least = 0.45 * extent  # a level or straight flight still gets a box and not a sheet
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, least / 2.0)
    low, high = middle - half, middle + half
    low[2] = max(low[2], min(0.0, position[:, 2].min()))
    return low, high


def _set_box(axes: Any, low: Array, high: Array, position: Array) -> None:
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    along = position[-1] - position[0]
    axes.view_init(elev=22.0, azim=math.degrees(math.atan2(along[1], along[0])) - 90.0 - 22.0)
    _fit(axes, low, high)
    for axis, label in ((axes.xaxis, "east, km"), (axes.yaxis, "north, km"), (axes.zaxis, "altitude, km")):
        axis.set_label_text(label, color=_FAINT, size=10)
        axis.set_tick_params(labelsize=8.5, colors=_FAINT)
        axis.set_pane_color((0.965, 0.97, 0.98, 1.0))
        axis.line.set_color("#c3c9d1")
        axis._axinfo["grid"].update(color="#dfe3e8", linewidth=0.7)
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _fit(axes: Any, low: Array, high: Array) -> None:
    """Size and place the axes so that the box fills its part of the figure, however long, wide or high it is."""
    to_figure = axes.figure.transFigure.inverted()
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    zoom = 1.0
    for _ in range(4):  # perspective: the size is not quite proportional to the zoom
        axes.set_box_aspect(high - low, zoom=zoom)
        axes.apply_aspect()
        x, y, _depth = proj3d.proj_transform(*corners.T, axes.get_proj())
        shown = to_figure.transform(axes.transData.transform(np.column_stack([x, y])))
        zoom *= float(np.min(_BOX_SIZE / np.ptp(shown, axis=0)))
    shift = _BOX_CENTRE - (shown.min(axis=0) + shown.max(axis=0)) / 2.0
    place = axes.get_position()
    axes.set_position((place.x0 + shift[0], place.y0 + shift[1], place.width, place.height))


def _quads(left: Array, right: Array) -> Array:
    """The ribbon between two edges, as one quadrilateral from each point to the next; shape (n − 1, 4, 3)."""
    return np.stack([left[:-1], right[:-1], right[1:], left[1:]], axis=1)


def _draw_shadow(
    axes: Any, left: Array, right: Array, position: Array, glyphs: NDArray[np.int64], floor: float
) -> None:
    on_floor = np.array([1.0, 1.0, 0.0])
    down = np.array([0.0, 0.0, floor])
    axes.add_collection3d(
        Poly3DCollection(
            _quads(left * on_floor + down, right * on_floor + down), facecolors=SHADOW, alpha=0.35, zorder=1
        )
    )
    ground = position * on_floor + down
    axes.plot(*ground.T, color=SHADOW, linewidth=1.0, zorder=2)
    drops = np.stack([position[glyphs], ground[glyphs]], axis=1)
    axes.add_collection3d(Line3DCollection(drops, colors=SHADOW, linewidths=0.7, linestyles=(0, (2, 2)), zorder=2))


def _draw_ribbon(axes: Any, left: Array, right: Array, load_factor: Array) -> ScalarMappable:
    scale = ScalarMappable(Normalize(min(0.0, float(load_factor.min())), max(2.0, float(load_factor.max()))), "viridis")
    colours = scale.to_rgba((load_factor[:-1] + load_factor[1:]) / 2.0)
    axes.add_collection3d(
        Poly3DCollection(_quads(left, right), facecolors=colours, edgecolors=colours, lw=0.3, zorder=3)
    )
    return scale


def _draw_glyphs(axes: Any, places: Array, turned: Array, length: float) -> None:
    polygons, colours = [], []
    for place, body_axes in zip(places, turned, strict=True):
        for outline, shade in zip(_GLYPH, _GLYPH_SHADES, strict=True):
            closed = np.array([*outline, *outline[-1:] * (_MOST_CORNERS - len(outline))])
            polygons.append(place + length * closed @ body_axes.T)
            colours.append(to_rgba(shade))
    axes.add_collection3d(Poly3DCollection(polygons, facecolors=colours, edgecolors="white", lw=0.25, zorder=4))


def _draw_goal(axes: Any, place: Array, goal: Goal, length: float) -> None:
    """An arrow with a head of four fins, to be seen from every side."""
    level = math.cos(goal.path_angle)
    along = np.array([level * math.sin(goal.azimuth), level * math.cos(goal.azimuth), math.sin(goal.path_angle)])
    aside = np.array([math.cos(goal.azimuth), -math.sin(goal.azimuth), 0.0])
    tip, neck = place + length * along, place + 0.76 * length * along
    fins = [
        [tip, neck + 0.08 * length * side * across, neck + 0.03 * length * along]
        for across in (aside, np.cross(aside, along))
        for side in (1.0, -1.0)
    ]
    axes.plot(*np.stack([place, neck + 0.1 * length * along]).T, color=WANTED, linewidth=2.4, zorder=5)
    axes.add_collection3d(Poly3DCollection(fins, facecolors=WANTED, edgecolors=WANTED, lw=0.5, zorder=5))
    axes.text(*(tip + 0.26 * length * along), "goal", color=WANTED, size=11.5, weight="bold", ha="center", zorder=6)


# Time histories


def _draw_histories(figure: Figure, flight: Flight) -> None:
    grid = figure.add_gridspec(
        len(_PANELS),
        1,
        left=0.655,
        right=0.975,
        top=0.955,
        bottom=0.06,
        hspace=0.36,
        height_ratios=[panel.height for panel in _PANELS],
    )
    first: Axes | None = None
    reached = math.inf if flight.goal is None else time_to_reach(flight)
    for row, panel in enumerate(_PANELS):
        axes = figure.add_subplot(grid[row], sharex=first)
        first = first or axes
        _draw_panel(axes, flight, panel)
        if math.isfinite(reached):
            axes.axvline(reached, color=REACHED, linewidth=1.2, linestyle=(0, (1, 1.5)), zorder=2)
        axes.tick_params(labelbottom=row == len(_PANELS) - 1)
    axes.set_xlabel("time, s", color=_FAINT, size=10)
    axes.set_xlim(0.0, max(flight.time[-1], flight.settings.time_step))


def _draw_panel(axes: Axes, flight: Flight, panel: Panel) -> None:
    known = fields_of(State)
    commanded = flight.settings.command_fields._fields
    for name, colour in zip(panel.fields, _LINES, strict=False):
        axes.plot(flight.time, _outside(flight, name), color=colour, linewidth=1.7, label=name, zorder=3)
        if name in commanded:
            command = flight.commands[:, commanded.index(name)] * known[name].unit.scale
            axes.plot(
                flight.time[:-1],
                command,
                color=colour,
                alpha=0.5,
                linewidth=1.2,
                linestyle=(0, (3, 1.5)),
                drawstyle="steps-post",
                zorder=2,
            )
    if flight.goal is not None and panel.fields[0] in Goal._fields:
        _draw_band(axes, flight, panel.fields[0])
    title = panel.fields[0].replace("_", " ") if len(panel.fields) == 1 else "deflections"
    title = ", ".join(filter(None, (title, _UNIT_TEXT.get(known[panel.fields[0]].unit.outside))))
    _style(axes, panel, f"{title}   (dashed: command)" if set(panel.fields) & set(commanded) else title)


def _outside(flight: Flight, name: str) -> Array:
    """One field over time in outside units, shape (T + 1,); NaN is put where an angle jumps from 180° to −180°.

    The azimuth is counted from the goal's, so that a flight to the south does not jump about.
    """
    field = fields_of(State)[name]
    values = np.asarray(getattr(flight.history, name), dtype=np.float64)
    if name == "azimuth" and flight.goal is not None:
        values = wanted(flight).azimuth + np.asarray(goal_errors(flight).azimuth)
    if field.high - field.low == 2.0 * math.pi:
        values = np.where(np.abs(np.diff(values, prepend=values[0])) > math.pi, np.nan, values)
    return values * field.unit.scale


def _draw_band(axes: Axes, flight: Flight, name: str) -> None:
    scale = fields_of(Goal)[name].unit.scale
    value = getattr(wanted(flight), name) * scale
    half = (DEFAULT_TASK.speed_band if name == "speed" else DEFAULT_TASK.direction_band) * scale
    axes.axhspan(value - half, value + half, color=WANTED, alpha=0.16, linewidth=0, zorder=1)
    axes.axhline(value, color=WANTED, linewidth=1.2, zorder=2)
    axes.set_title(f"goal {value:g} ± {half:g}".replace("-", "−"), loc="right", size=9.5, color=WANTED, pad=3)


def _style(axes: Axes, panel: Panel, title: str) -> None:
    axes.set_title(title, loc="left", size=10, color=_TEXT, pad=3)
    if len(panel.fields) > 1:
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.01, 0.96),
            ncols=len(panel.fields),
            frameon=False,
            fontsize=9,
            labelcolor="linecolor",
            handlelength=1.2,
            columnspacing=1.2,
            borderaxespad=0.1,
        )
    axes.grid(color="#e6e9ee", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8.5, colors=_FAINT, length=2)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#c3c9d1")
    axes.margins(y=0.12)
