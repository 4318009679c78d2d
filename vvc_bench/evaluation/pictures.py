"""Pictures of evaluations: where goals are reached, how soon, how near, how flights end, and who wins where.

Takes the extra ``plot`` (matplotlib).
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vvc_bench.drawing import (
    Array,
    Picture,
    Theme,
    add_bar,
    draw_cells,
    goal_text,
    label,
    name_text,
    new_figure,
    panel_title,
    set_angle_ticks,
    unit_text,
)
from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.comparison import Comparison, Pair, goal_box
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics import wilson_interval
from vvc_bench.sim.task import Event, Rules, Task
from vvc_bench.sim.units import DEGREES_PER_RADIAN

# isort: split
# Below vvc_bench.drawing, which says what to install where matplotlib is missing.
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_CELLS = (8, 10, 14)  # of boxes of goals along speed, path angle and azimuth
_SLABS = 8
_FEW_VALUES = 100  # an axis with no more distinct values has a cell for each
_PROJECTIONS = ((2, 1), (2, 0), (1, 0))  # axes of the goal, across and up
_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.4, 1.4)))
_PROFILE_POINTS = 400


class Material(NamedTuple):
    """What is drawn: the flights of several methods to the same goals."""

    goals: Array
    """Shape (N, 3), in outside units."""
    flights: Mapping[str, pd.DataFrame]
    """Label → rows as an evaluation has them, of all its runs."""
    task: Task
    time_step_s: float
    comparison: Comparison | None
    """Where there are two methods or more."""

    @property
    def has_spread(self) -> bool:
        """Whether there are goals in different places."""
        return bool((self.goals != self.goals[0]).any())

    def shares(self, name: str) -> Array:
        """Share of a method's flights to each goal that reached it, shape (N,)."""
        rows = self.flights[name]
        count = len(self.goals)
        reached = np.bincount(rows[names.GOAL], weights=rows[names.SUCCESS], minlength=count)
        return np.asarray(reached * (count / len(rows)), dtype=np.float64)


def success_map(name: str) -> Picture[Material]:
    """Where one method reaches its goals."""
    return Picture(
        f"map-{name}",
        name,
        "Success over the goal box, seen along each of its three axes: each cell has all goals behind it.",
        _draw_success(name),
    )


def win_map(pair: Pair) -> Picture[Material]:
    """Where one of two methods reaches more than the other."""
    return Picture(
        f"wins-{pair.first}-{pair.second}",
        f"{pair.first} against {pair.second}",
        f"Success of {pair.first} less that of {pair.second} over the goal box, seen along each of its three axes.",
        _draw_wins(pair),
    )


# All methods at once


def _styles(material: Material, theme: Theme) -> dict[str, dict[str, Any]]:
    """How the line of each method is drawn."""
    count = len(theme.series)
    return {
        name: {"color": theme.series[k % count], "linestyle": _DASHES[(k // count) % len(_DASHES)]}
        for k, name in enumerate(material.flights)
    }


def _literal(name: str) -> str:
    """A name in which matplotlib finds no formula."""
    return name.replace("$", r"\$")


def _add_legend(figure: Figure, axes: Axes, theme: Theme, count: int) -> None:
    handles, texts = axes.get_legend_handles_labels()
    columns = 1 if max(map(len, texts), default=0) > 24 else min(count, 3)
    figure.legend(handles, texts, loc="outside lower center", ncols=columns, frameon=False, fontsize=8,
                  labelcolor=theme.ink, handlelength=1.6)  # fmt: skip


def _draw_profile(material: Material, theme: Theme) -> Figure:
    """Success against time."""
    longest = material.task.step_limit * material.time_step_s
    times = np.linspace(0.0, longest, _PROFILE_POINTS + 1)
    figure = new_figure(theme, 3.0)
    axes = figure.subplots()
    for name, style in _styles(material, theme).items():
        rows = material.flights[name]
        needed = np.sort(rows.loc[rows[names.SUCCESS], names.LENGTH].to_numpy() * material.time_step_s)
        share = np.searchsorted(needed, times + 1e-9, side="right") / len(rows)
        interval = wilson_interval(share * len(material.goals), np.full(len(share), len(material.goals)))
        axes.fill_between(times, 100 * interval.low, 100 * interval.high, color=style["color"], alpha=0.2, linewidth=0)
        axes.plot(times, 100.0 * share, linewidth=1.6, label=_literal(name), **style)
    axes.set_xlim(0.0, longest)
    axes.set_ylim(0.0, None)
    label(axes, theme, "time, s", "reached, %")
    if len(material.flights) > 1:
        _add_legend(figure, axes, theme, len(material.flights))
    return figure


def _draw_endings(material: Material, theme: Theme) -> Figure:
    """Stacked shares of the events that flights end with."""
    shares = {
        name: 100.0 * rows[names.TERMINATION].value_counts(normalize=True) for name, rows in material.flights.items()
    }
    found = set().union(*(part.index for part in shares.values()))
    events = sorted(found, key=_event_place)
    figure = new_figure(theme, 1.25 + 0.26 * len(shares))
    axes = figure.subplots()
    left = np.zeros(len(shares))
    for event in events:
        widths = np.array([float(part.get(event, 0.0)) for part in shares.values()])
        name = event.replace("_", " ") or "none"
        axes.barh(np.arange(len(shares)), widths, 0.72, left, color=_event_colour(event, theme), label=name, zorder=2)
        left += widths
    axes.set_yticks(np.arange(len(shares)), list(map(_literal, shares)))
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    label(axes, theme, "flights, %")
    _add_legend(figure, axes, theme, len(events))
    return figure


_EVENTS = [str(event.name).lower() for event in Event]


def _event_place(name: str) -> int:
    return _EVENTS.index(name) if name in _EVENTS else len(_EVENTS)


def _event_colour(name: str, theme: Theme) -> str:
    """The same for the same event in every picture; green for success alone."""
    if name == str(Event.REACH_TARGET.name).lower():
        return theme.series[2]
    failures = (*theme.series[:2], *theme.series[3:])
    return failures[_event_place(name) % len(failures)]


def _bound(task: Task, column: str) -> float | None:
    """What an error must stay below, for those that count under the task's rules."""
    speed, *angles, direction = names.ERRORS
    if column == speed:
        return task.speed_band
    counts = angles if Rules(int(task.rules)) == Rules.DEMONSTRATION else [direction]
    return task.direction_band * DEGREES_PER_RADIAN if column in counts else None


def _draw_errors(material: Material, theme: Theme) -> Figure:
    """Distributions of the errors of flights that reached."""
    figure = new_figure(theme, 4.3)
    panels: Any = figure.subplots(2, 2, sharey=True)
    for axes, column in zip(panels.flat, names.ERRORS, strict=True):
        bound = _bound(material.task, column)
        reach = [bound or 0.0]
        for name, style in _styles(material, theme).items():
            rows = material.flights[name]
            errors = np.sort(rows.loc[rows[names.SUCCESS], column].to_numpy())
            if len(errors):
                reach.append(float(np.quantile(errors, 0.99)))
                axes.step(np.append(0.0, errors), np.linspace(0.0, 100.0, len(errors) + 1), where="post", linewidth=1.5,
                          label=_literal(name), **style)  # fmt: skip
        if bound is not None:
            axes.axvline(bound, color=theme.faint, linewidth=1.0, linestyle=(0, (3, 2)), zorder=1)
        axes.set_xlim(0.0, 1.04 * max(reach) or 1.0)
        axes.set_ylim(0.0, 101.0)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        panel_title(axes, f"{name_text(column)}, {unit_text(column)}", theme)
        label(axes, theme, "", "flights, %" if axes in panels[:, 0] else "")
    if len(material.flights) > 1:
        _add_legend(figure, panels.flat[0], theme, len(material.flights))
    return figure


def _draw_along(material: Material, theme: Theme) -> Figure:
    """Success along each axis of the goal box."""
    figure = new_figure(theme, 5.4)
    panels: Any = figure.subplots(len(GOAL_COLUMNS), 1, sharey=True)
    styles, top = _styles(material, theme), 0.0
    for axis, (axes, box) in enumerate(zip(panels, goal_box(material.goals), strict=True)):
        edges = np.linspace(*box, _SLABS + 1)
        flown, _ = np.histogram(material.goals[:, axis], edges)
        middles, width = (edges[:-1] + edges[1:]) / 2.0, edges[1] - edges[0]
        for k, (name, style) in enumerate(styles.items()):
            reached, _ = np.histogram(material.goals[:, axis], edges, weights=material.shares(name))
            reached = np.clip(reached, 0.0, flown)  # sums of shares round
            interval = wilson_interval(reached, flown)
            top = max(top, float(interval.high[flown > 0].max(initial=0.0)))
            at = middles + 0.1 * width * (k - (len(styles) - 1) / 2.0) / max(len(styles) / 4.0, 1.0)
            axes.vlines(at, 100.0 * interval.low, 100.0 * interval.high, color=style["color"], linewidth=1.1)
            share = np.where(flown > 0, 100.0 * reached / np.maximum(flown, 1), np.nan)
            axes.plot(at, share, marker="o", markersize=3.2, linewidth=1.1, label=_literal(name), **style)
        label(axes, theme, goal_text(GOAL_COLUMNS[axis]), "reached, %")
    panels[0].set_ylim(0.0, 103.0 * top)
    if len(styles) > 1:
        _add_legend(figure, panels[0], theme, len(styles))
    return figure


def _draw_ranks(material: Material, theme: Theme) -> Figure:
    """Success rates, intervals and ranks."""
    assert material.comparison is not None
    contenders = material.comparison.contenders
    styles = _styles(material, theme)
    figure = new_figure(theme, 0.7 + 0.3 * len(contenders))
    axes = figure.subplots()
    for place, contender in enumerate(contenders):
        colour, rate = styles[contender.label]["color"], contender.success
        axes.hlines(place, 100.0 * rate.low, 100.0 * rate.high, color=colour, linewidth=2.4)
        axes.plot(100.0 * rate.value, place, "o", color=colour, markersize=5.5, markeredgecolor=theme.background)
        ranks = rank_text(*contender.rank)
        axes.annotate(ranks, (1.02, place), xycoords=("axes fraction", "data"), size=8.5, va="center", color=theme.ink)
    axes.set_yticks(np.arange(len(contenders)), [_literal(contender.label) for contender in contenders])
    axes.set_ylim(len(contenders) - 0.5, -0.5)
    label(axes, theme, "reached, %")
    return figure


def rank_text(low: int, high: int) -> str:
    """``2``, or ``2–3`` where more ranks than one are open."""
    return f"{low}" if low == high else f"{low}–{high}"


# Over the goal box


def _edges(material: Material) -> list[Array]:
    """Bounds of cells along each axis: one for each value of a grid, equal ones for goals anywhere in a box."""
    return [
        _axis_edges(material.goals[:, axis], box, cells)
        for axis, (box, cells) in enumerate(zip(goal_box(material.goals), _CELLS, strict=True))
    ]


def _axis_edges(values: Array, box: tuple[float, float], cells: int) -> Array:
    distinct = np.unique(values)
    if not 1 < len(distinct) <= _FEW_VALUES:
        return np.linspace(*box, cells + 1)
    between = (distinct[:-1] + distinct[1:]) / 2.0
    return np.concatenate([2.0 * distinct[:1] - between[:1], between, 2.0 * distinct[-1:] - between[-1:]])


def _draw_success(name: str) -> Callable[[Material, Theme], Figure]:
    def draw(material: Material, theme: Theme) -> Figure:
        return _draw_projections(material, material.shares(name), "reached, %", Normalize(0.0, 100.0), theme)

    return draw


def _draw_wins(pair: Pair) -> Callable[[Material, Theme], Figure]:
    def draw(material: Material, theme: Theme) -> Figure:
        wins = material.shares(pair.first) - material.shares(pair.second)
        return _draw_projections(material, wins, "difference of success, %", None, theme)

    return draw


def _draw_projections(material: Material, values: Array, text: str, scale: Normalize | None, theme: Theme) -> Figure:
    """Means of values over the cells of each pair of axes, in percent; without a scale as differences."""
    figure = new_figure(theme, 5.3)
    panels: Any = figure.subplot_mosaic([["top", "top"], ["left", "right"]], height_ratios=[1.25, 1.0])
    edges = _edges(material)
    cells = [_cell_means(material.goals, values, axes, edges) for axes in _PROJECTIONS]
    if scale is None:
        largest = max(float(np.nanmax(np.abs(means))) for means, _ in cells)
        limit = max(10.0, math.ceil(largest / 10.0) * 10.0)
        shown, colours = Normalize(-limit, limit), theme.differences
    else:
        shown, colours = scale, theme.colours
    for panel, (across, up), (means, flown) in zip(("top", "left", "right"), _PROJECTIONS, cells, strict=True):
        axes = panels[panel]
        mesh = draw_cells(axes, edges[across], edges[up], means, flown, shown, theme, colours)
        label(axes, theme, goal_text(GOAL_COLUMNS[across]), goal_text(GOAL_COLUMNS[up]))
        axes.grid(visible=False)
        for axis, k in ((axes.xaxis, across), (axes.yaxis, up)):
            if unit_text(GOAL_COLUMNS[k]) == "°":
                set_angle_ticks(axis, edges[k])
    add_bar(figure, mesh, list(panels.values()), text, theme)
    return figure


def _cell_means(
    goals: Array, values: Array, axes: tuple[int, int], edges: list[Array]
) -> tuple[Array, NDArray[np.int64]]:
    """Mean value in percent and number of goals of each cell, shape (up, across); NaN without goals."""
    across, up = axes
    bins = [edges[up], edges[across]]
    flown, _, _ = np.histogram2d(goals[:, up], goals[:, across], bins)
    total, _, _ = np.histogram2d(goals[:, up], goals[:, across], bins, weights=values)
    means = np.where(flown > 0, 100.0 * total / np.maximum(flown, 1), np.nan)
    return means, flown.astype(np.int64)


FLIGHTS: tuple[Picture[Material], ...] = (
    Picture(
        "profile",
        "How soon goals are reached",
        "Share of all flights that have reached their goal by then. Bands: 95 % Wilson intervals at each time, of one "
        "trial for each goal.",
        _draw_profile,
    ),
    Picture("endings", "How flights end", "Of all flights, by the event that decides.", _draw_endings),
    Picture(
        "errors",
        "How near they end",
        "Share of the flights that reached with a smaller error. Direction: at the end; the others: means over the "
        "last second. Dashed: the bound of what counts as reached.",
        _draw_errors,
    ),
)
"""What shows the flights of all methods."""

ALONG = Picture[Material](
    "along",
    "Along each component of the goal",
    "Success in equal slabs of the goal box, with 95 % Wilson intervals.",
    _draw_along,
)

RANKS = Picture[Material](
    "ranks",
    "Success and ranks",
    "Success rates with 95 % Wilson intervals of one trial for each goal; at the right the ranks that pairwise tests "
    "leave open.",
    _draw_ranks,
)
