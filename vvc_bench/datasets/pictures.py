"""Pictures of a set: which goals it reaches, how long and how smooth its flights are, and some of them.

Takes the extra ``plot`` (matplotlib).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.drawing import (
    Array,
    Picture,
    Theme,
    add_bar,
    column_text,
    draw_cells,
    goal_text,
    label,
    name_text,
    new_figure,
    panel_title,
    set_angle_ticks,
    style_bar,
    unit_text,
)
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics import Coverage, Smoothness, action_smoothness, final_errors, observation_smoothness
from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Goal, Observation
from vvc_bench.sim.units import DEGREES_PER_RADIAN

# isort: split
# Below vvc_bench.drawing, which says what to install where matplotlib is missing.
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_MAPS = 8
_PATHS = 60
_LONGEST = 0.9  # quantile of the durations: a few long straight flights would hide the others
_SEED = 0


class Material(NamedTuple):
    """What is drawn."""

    episodes: Episodes
    coverage: Coverage
    errors: Array
    """Shape (E, 3): `vvc_bench.metrics.final_errors`."""
    smoothness: tuple[Smoothness, Smoothness]
    """Of observations, angles unwrapped, and of actions."""
    published: Mapping[str, Mapping[float, int]]
    """Column of the goal → its value → goals that the paper's expert reached there."""


def prepare(episodes: Episodes, coverage: Coverage, published: Mapping[str, Mapping[float, int]]) -> Material:
    """What all pictures of a set are drawn from.

    Raises:
        ValueError: for a set without episodes.
    """
    if not len(episodes):
        raise ValueError("a set without episodes has no pictures")
    smoothness = observation_smoothness(episodes, unwrapped=True), action_smoothness(episodes)
    return Material(episodes, coverage, final_errors(episodes), smoothness, published)


# Coverage


def _draw_map(material: Material, theme: Theme) -> Figure:
    """How many of the speeds are reached in each direction."""
    found = material.coverage
    flown, reached = found.flown.sum(axis=0), found.reached.sum(axis=0)
    figure = new_figure(theme, 2.95)
    axes = figure.subplots()
    share = np.where(reached > 0, 100.0 * reached / np.maximum(flown, 1), np.nan)
    mesh = _draw_directions(axes, found, share, flown, Normalize(0.0, 100.0), theme)
    label(axes, theme, goal_text("azimuth_deg"), goal_text("path_angle_deg"))
    add_bar(figure, mesh, [axes], "speeds reached, %", theme)
    return figure


def _draw_maps(material: Material, theme: Theme) -> Figure:
    """Duration of the flight to each goal, at speeds spread over the grid."""
    found, episodes = material.coverage, material.episodes
    seconds = _mean_durations(material)
    chosen = np.unique(np.linspace(0, len(found.values[0]) - 1, _MAPS).round().astype(int))
    rows = -(-len(chosen) // 2)
    figure = new_figure(theme, 0.75 + 1.1 * rows)
    grid: Any = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    duration = episodes.lengths * episodes.scenario.settings.time_step
    scale = Normalize(0.0, float(np.quantile(duration, 0.98)))
    for i, (axes, k) in enumerate(zip(grid.flat, chosen, strict=False)):
        mesh = _draw_directions(axes, found, seconds[k], found.flown[k], scale, theme)
        label(axes, theme, "azimuth, °" if i >= len(chosen) - 2 else "", "path angle, °" if i % 2 == 0 else "")
        panel_title(axes, f"{found.values[0][k]:g} m/s", theme)
    for axes in grid.flat[len(chosen) :]:
        axes.set_visible(False)
    add_bar(figure, mesh, list(grid.flat), "time to reach, s", theme, extend="max")
    return figure


def _mean_durations(material: Material) -> Array:
    """Mean duration of the flights to the goals of each cell, s; NaN where none reached."""
    episodes, edges = material.episodes, material.coverage.edges
    goals = episodes.goals[episodes.reached]
    count, _ = np.histogramdd(goals, edges)
    steps, _ = np.histogramdd(goals, edges, weights=episodes.lengths[episodes.reached])
    mean: Array = np.where(count > 0, steps / np.maximum(count, 1), np.nan) * episodes.scenario.settings.time_step
    return mean


def _draw_directions(
    axes: Axes, found: Coverage, values: Array, flown: NDArray[np.int64], scale: Normalize, theme: Theme
) -> ScalarMappable:
    """Cells over azimuth and path angle."""
    _, path_angle, azimuth = found.edges
    set_angle_ticks(axes.xaxis, azimuth)
    set_angle_ticks(axes.yaxis, path_angle)
    return draw_cells(axes, azimuth, path_angle, values, flown, scale, theme)


def _draw_along(axis: int) -> Callable[[Material, Theme], Figure]:
    """The marginal distribution along one component of the goal."""

    def draw(material: Material, theme: Theme) -> Figure:
        column = GOAL_COLUMNS[axis]
        slab = material.coverage.along(axis)
        interval, flown = slab.interval, np.maximum(slab.flown, 1)
        figure = new_figure(theme, 2.35)
        axes = figure.subplots()
        edges = material.coverage.edges[axis]
        axes.bar(
            slab.values, 100.0 * slab.reached / flown, 0.86 * np.diff(edges), color=theme.ours, alpha=0.85, zorder=2
        )
        axes.vlines(slab.values, 100.0 * interval.low, 100.0 * interval.high, color=theme.ink, linewidth=0.8, zorder=3)
        known = material.published.get(column, {})
        at = [value for value in known if (slab.values == value).any()]
        if at:
            shares = [100.0 * known[value] / int(slab.flown[slab.values == value][0]) for value in at]
            _draw_theirs(axes, np.array(at), np.array(shares), theme)
        label(axes, theme, goal_text(column), "reached, %")
        axes.set_ylim(0.0, None)
        return figure

    return draw


def _draw_theirs(axes: Axes, at: Array, shares: Array, theme: Theme) -> None:
    axes.scatter(
        at,
        shares,
        s=34,
        color=theme.theirs,
        marker="D",
        edgecolors=theme.background,
        linewidths=0.8,
        zorder=4,
        label="the paper's expert",
    )
    axes.margins(y=0.22)
    axes.legend(
        loc="upper center", frameon=False, fontsize=8, labelcolor=theme.ink, handletextpad=0.1, borderaxespad=0.1
    )


# Distributions


def _draw_durations(material: Material, theme: Theme) -> Figure:
    episodes = material.episodes
    seconds = episodes.lengths * episodes.scenario.settings.time_step
    figure = new_figure(theme, 2.35)
    axes = figure.subplots()
    axes.hist(seconds, bins=60, color=theme.ours, alpha=0.85, zorder=2)
    middle = float(np.median(seconds))
    axes.axvline(middle, color=theme.ink, linewidth=1.2, linestyle=(0, (3, 2)), zorder=3)
    title = f"median {middle:.1f} s, mean {seconds.mean():.1f} s, longest {seconds.max():.1f} s"
    panel_title(axes, title, theme)
    label(axes, theme, "duration of the flight, s", "flights")
    return figure


def _draw_accuracy(material: Material, theme: Theme) -> Figure:
    task = material.episodes.scenario.task
    bounds = [task.speed_band, *[task.direction_band * DEGREES_PER_RADIAN] * 2]
    figure = new_figure(theme, 3.7)
    panels: Any = figure.subplots(3, 1)
    for k, (axes, name) in enumerate(zip(panels, GOAL_COLUMNS, strict=True)):
        errors = material.errors[:, k]
        axes.hist(errors, bins=np.linspace(0.0, max(bounds[k], float(errors.max())), 61), color=theme.ours, alpha=0.85)
        axes.axvline(bounds[k], color=theme.theirs, linewidth=1.6, zorder=3)
        title = f"{name_text(name)}: {errors.mean():.2f} ± {errors.std():.2f} {unit_text(name)}"
        panel_title(axes, title, theme)
        label(axes, theme, f"mean error over the last second, {unit_text(name)}" if k == 2 else "", "flights")
        axes.yaxis.set_major_locator(MaxNLocator(3))
    return figure


def _draw_smoothness(material: Material, theme: Theme) -> Figure:
    """Quantiles of s₁ and s₂ of every variable, on logarithmic axes."""
    names = [
        prefix + column_text(column)
        for prefix, part in zip(("", "action: "), material.smoothness, strict=True)
        for column in part.columns
    ]
    figure = new_figure(theme, 0.75 + 0.235 * len(names))
    panels: Any = figure.subplots(1, 2, sharey=True)
    for axes, title, attribute in zip(panels, ("s₁", "s₂, each step"), ("s1", "s2"), strict=True):
        values = np.concatenate([getattr(part, attribute) for part in material.smoothness], axis=1)
        places = np.arange(len(names))
        low, lower, middle, upper, high = np.quantile(np.maximum(values, 1e-6), [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
        axes.hlines(places, low, high, color=theme.ours, linewidth=1.3, alpha=0.7)
        axes.hlines(places, lower, upper, color=theme.ours, linewidth=5.0)
        axes.scatter(middle, places, s=15, color=theme.background, edgecolors=theme.ink, linewidths=0.9, zorder=3)
        axes.set_xscale("log")
        axes.set_xlim(0.2 * float(middle.min()), 2.0 * float(high.max()))
        panel_title(axes, title, theme)
        label(axes, theme)
        axes.tick_params(axis="y", length=0)
    panels[0].set_yticks(places, names)
    panels[0].invert_yaxis()
    return figure


# Flights


def _sample(episodes: Episodes) -> NDArray[np.int64]:
    """Some flights, the longest ones left out."""
    short = np.flatnonzero(episodes.lengths <= np.quantile(episodes.lengths, _LONGEST))
    return np.sort(np.random.default_rng(_SEED).permutation(short)[:_PATHS])


def _reports(episodes: Episodes, e: int) -> Array:
    """What was seen in one episode from start to end, shape (T + 1, 8), in outside units."""
    steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
    return np.concatenate([episodes.observations[steps], episodes.final_observations[e : e + 1]]).astype(np.float64)


_SEEN = {name: k for k, name in enumerate(Observation._fields)}


def flight_path(episodes: Episodes, e: int) -> Array:
    """Where one flight went: east, north and altitude in m from its start, shape (T + 1, 3).

    Sets do not hold north and east. They are summed up from the speed, path angle and azimuth reported after each step
    (in reference dynamics that is the velocity that the step moved the aircraft with); the altitude is as recorded.
    """
    seen = _reports(episodes, e)
    path_angle, azimuth = (seen[1:, _SEEN[name]] / DEGREES_PER_RADIAN for name in ("path_angle", "azimuth"))
    level = seen[1:, _SEEN["speed"]] * np.cos(path_angle) * episodes.scenario.settings.time_step
    moved = np.stack([level * np.sin(azimuth), level * np.cos(azimuth)], axis=-1)
    ground = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([ground, seen[:, _SEEN["altitude"]]])


def draw_paths(episodes: Episodes, theme: Theme) -> Figure:
    """Sampled flights in space."""
    chosen = _sample(episodes)
    paths = [flight_path(episodes, int(e)) / 1000.0 for e in chosen]
    scale = _speed_scale(episodes.goals[:, 0], theme)
    figure = new_figure(theme, 4.3)
    figure.set_layout_engine("none")
    axes: Any = figure.add_axes((-0.03, 0.14, 0.94, 0.9), projection="3d", facecolor=theme.background)
    low, high = _space(paths)
    for path, speed in zip(paths, episodes.goals[chosen, 0], strict=True):
        axes.plot(path[:, 0], path[:, 1], low[2], color=theme.faint, linewidth=0.6, alpha=0.35, zorder=1)
        axes.plot(*path.T, color=scale.to_rgba(speed), linewidth=1.3, zorder=3)
        axes.scatter(*path[-1], s=7, color=[scale.to_rgba(speed)], depthshade=False, zorder=4)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect((*(high - low)[:2], 0.5 * float((high - low)[:2].max())), zoom=1.04)
    axes.view_init(elev=26.0, azim=-64.0)
    axes.zaxis.labelpad = -3
    for axis, text in ((axes.xaxis, "east, km"), (axes.yaxis, "north, km"), (axes.zaxis, "altitude, km")):
        axis.set_label_text(text, color=theme.faint, size=8.5)
        axis.set_tick_params(labelsize=8, colors=theme.faint, pad=0)
        axis.set_pane_color(theme.background)
        axis.line.set_color(theme.grid)
        axis._axinfo["grid"].update(color=theme.grid, linewidth=0.6)
        axis.set_major_locator(MaxNLocator(4))
    place = figure.add_axes((0.18, 0.1, 0.64, 0.018))
    style_bar(figure.colorbar(scale, cax=place, orientation="horizontal"), "wanted speed, m/s", theme)
    return figure


def _space(paths: Sequence[Array]) -> tuple[Array, Array]:
    every = np.concatenate(paths)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.03 * float((high - low).max()) + 0.05
    low, high = low - margin, high + margin
    low[2] = max(low[2], min(0.0, float(every[:, 2].min())))
    return low, high


def draw_approaches(episodes: Episodes, theme: Theme) -> Figure:
    """Errors of sampled flights over time."""
    task = episodes.scenario.task
    chosen, scale = _sample(episodes), _speed_scale(episodes.goals[:, 0], theme)
    figure = new_figure(theme, 4.5)
    panels: Any = figure.subplots(3, 1, sharex=True)
    step = episodes.scenario.settings.time_step
    for k, (axes, name) in enumerate(zip(panels, GOAL_COLUMNS, strict=True)):
        band = (task.speed_band, *[task.direction_band * DEGREES_PER_RADIAN] * 2)[k]
        lines = []
        for e in chosen:
            errors = _errors(episodes, int(e), Goal._fields[k])
            lines.append(np.column_stack([np.arange(len(errors)) * step, errors]))
        colours = scale.to_rgba(episodes.goals[chosen, 0])
        axes.add_collection(LineCollection(lines, colors=colours, linewidths=1.0, alpha=0.9, zorder=2))
        axes.axhspan(-band, band, color=theme.theirs, alpha=0.22, linewidth=0, zorder=1)
        panel_title(axes, f"{name_text(name)} less the goal's, {unit_text(name)}", theme)
        label(axes, theme, "time, s" if k == 2 else "")
        axes.autoscale_view()
        axes.yaxis.set_major_locator(MaxNLocator(4))
    panels[-1].set_xlim(0.0, None)
    add_bar(figure, scale, list(panels), "wanted speed, m/s", theme)
    return figure


def _errors(episodes: Episodes, e: int, name: str) -> Array:
    """One component of what was seen less the goal's; an azimuth is followed round and ends by the shorter way."""
    errors: Array = _reports(episodes, e)[:, _SEEN[name]] - episodes.goals[e, Goal._fields.index(name)]
    if name != "azimuth":
        return errors
    errors = np.unwrap(errors, period=360.0)
    return np.asarray(errors - 360.0 * round(float(errors[-1]) / 360.0))


def _speed_scale(speeds: Array, theme: Theme) -> ScalarMappable:
    low, high = float(speeds.min()), float(speeds.max())
    return ScalarMappable(Normalize(low, max(high, low + 1.0)), theme.colours)


PICTURES: tuple[Picture[Material], ...] = (
    Picture(
        "coverage",
        "Directions reached",
        "Of all speeds flown in each direction, the share that was reached. Grey: none.",
        _draw_map,
    ),
    Picture(
        "coverage-by-speed",
        "Goals reached, speed by speed",
        "One cell for each goal, coloured by how long the flight takes. Grey: flown, not reached.",
        _draw_maps,
    ),
    *(
        Picture(
            f"reached-by-{name.replace('_', '-')}",
            f"By {name.replace('_', ' ')}",
            "Share of the goals reached; lines: 95 % Wilson intervals, as if the goals were drawn at random.",
            _draw_along(axis),
        )
        for axis, name in enumerate(Goal._fields)
    ),
    Picture("durations", "How long flights are", "From the start to the step that ends the episode.", _draw_durations),
    Picture(
        "accuracy",
        "How near they end",
        "Mean absolute errors over the last second, as in Table 1. Orange: the bound of what counts as reached.",
        _draw_accuracy,
    ),
    Picture(
        "smoothness",
        "How smooth they are",
        "s₁ and s₂ of every variable, angles followed past ±180°. Dot: median; thick: the middle half of the flights; "
        "thin: 90 % of them. Smaller is smoother.",
        _draw_smoothness,
    ),
    Picture(
        "paths",
        "Flights in space",
        f"{_PATHS} flights drawn at random (seed {_SEED}) from the shorter {_LONGEST:.0%}; altitude is drawn enlarged. "
        "East and north are not stored: they are summed up from the speed, path angle and azimuth reported after each "
        "step.",
        lambda material, theme: draw_paths(material.episodes, theme),
    ),
    Picture(
        "approaches",
        "How they come to their goals",
        "The same flights: what is still missing, over time. Band: what counts as reached.",
        lambda material, theme: draw_approaches(material.episodes, theme),
    ),
)
"""Every picture of a card, in order."""
