"""Pictures of the page, as SVG in the page's own colours."""

import html
from collections.abc import Iterable, Sequence

from vvc_bench.evaluation.columns import GOAL_OF_EPISODE
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.leaderboard.standings import Place
from vvc_bench.sim import columns
from vvc_bench.sim.fields import Goal

SERIES = 6
"""So many entries are told apart by colour: the best ones."""

_WIDTH, _LEFT, _RIGHT = 420, 132, 14
_ROW, _TOP, _BOTTOM = 24, 8, 34
_PLOT_LEFT, _PLOT_HEIGHT = 34, 150
_UNIT = {"mps": "m/s", "deg": "°"}


def success_drawing(places: Sequence[Place]) -> str:
    """Success rates with their intervals, one line for each entry; nothing for no entries."""
    if not places:
        return ""
    height = _TOP + _ROW * len(places) + _BOTTOM
    below = height - _BOTTOM

    def across(share: float) -> float:
        return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)

    parts = [
        f'<path class=grid d="M{across(tick):.1f} {_TOP}V{below}"/>'
        f'<text class=faint x="{across(tick):.1f}" y="{below + 15}" text-anchor=middle>{100 * tick:g}</text>'
        for tick in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    for k, place in enumerate(places):
        success, middle = place.summary["success"], _TOP + _ROW * (k + 0.5)
        parts.append(
            f'<text x="{_LEFT - 8}" y="{middle + 4:.1f}" text-anchor=end>{_short(place.submission.entry)}</text>'
            f'<g class="{_series(k)}"><path stroke-width=2 d="M{across(success["low"]):.1f} {middle:.1f}'
            f'H{across(success["high"]):.1f}"/><circle r=3.5 fill="var(--series)" cx="{across(success["rate"]):.1f}" '
            f'cy="{middle:.1f}"/></g>'
        )
    parts.append(f'<text class=faint x="{across(0.5):.1f}" y="{height - 3}" text-anchor=middle>goals reached, %</text>')
    return _figure("Goals reached", "Dot: rate; line: 95 % Wilson interval.", height, parts)


def regions_drawing(places: Sequence[Place]) -> list[str]:
    """Success along each axis of the goal space, for the best entries."""
    shown = places[:SERIES]
    regions = [place.summary["regions"] for place in shown]
    drawings = []
    for column, name in zip(GOAL_OF_EPISODE, GOAL_COLUMNS, strict=True):
        if regions and len(regions[0][column]["episodes"]) > 1:
            lines = [_shares(each[column]) for each in regions]
            field = columns(Goal)[name]
            title = f"By {Goal._fields[GOAL_COLUMNS.index(name)].replace('_', ' ')}"
            drawings.append(_lines_drawing(title, f"wanted, {_UNIT[field.unit.outside]}", lines, shown))
    return drawings


Line = list[tuple[float, float]]


def _shares(slabs: dict[str, list[float]]) -> Line:
    """Middle of each slab, and the share of its goals that was reached."""
    edges = slabs["edges"]
    return [
        ((low + high) / 2.0, count / flown)
        for low, high, count, flown in zip(edges, edges[1:], slabs["count"], slabs["episodes"], strict=False)
        if flown
    ]


def _lines_drawing(title: str, label: str, lines: Sequence[Line], places: Sequence[Place]) -> str:
    height = _TOP + _PLOT_HEIGHT + _BOTTOM
    least, most = min(x for line in lines for x, _ in line), max(x for line in lines for x, _ in line)

    def across(x: float) -> float:
        return _PLOT_LEFT + (x - least) / (most - least) * (_WIDTH - _PLOT_LEFT - _RIGHT)

    def down(share: float) -> float:
        return _TOP + (1.0 - share) * _PLOT_HEIGHT

    parts = [
        f'<path class=grid d="M{_PLOT_LEFT} {down(tick):.1f}H{_WIDTH - _RIGHT}"/>'
        f'<text class=faint x="{_PLOT_LEFT - 6}" y="{down(tick) + 4:.1f}" text-anchor=end>{100 * tick:g}</text>'
        for tick in (0.0, 0.5, 1.0)
    ]
    for x, anchor in ((least, "start"), ((least + most) / 2.0, "middle"), (most, "end")):
        parts.append(
            f'<text class=faint x="{across(x):.1f}" y="{_TOP + _PLOT_HEIGHT + 15}" text-anchor={anchor}>{x:g}</text>'
        )
    for k, line in enumerate(lines):
        points = " ".join(f"{across(x):.1f},{down(share):.1f}" for x, share in line)
        parts.append(f'<polyline class="{_series(k)}" fill=none stroke-width=2 points="{points}"/>')
    middle = (_PLOT_LEFT + _WIDTH - _RIGHT) / 2.0
    parts.append(f'<text class=faint x="{middle:.1f}" y="{height - 3}" text-anchor=middle>{html.escape(label)}</text>')
    key = "".join(f'<li><i class="{_series(k)}"></i>{place.submission.entry}</li>' for k, place in enumerate(places))
    return _figure(title, "Share of the goals reached, %.", height, parts, f"<ul class=key>{key}</ul>")


def _series(k: int) -> str:
    return f"s{min(k, SERIES - 1)}"


def _short(name: str, most: int = 18) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"


def _figure(title: str, caption: str, height: float, parts: Iterable[str], key: str = "") -> str:
    return (
        f"<figure><h3>{html.escape(title)}</h3>"
        f'<svg viewBox="0 0 {_WIDTH} {height:g}" role=img aria-label="{html.escape(title)}">{"".join(parts)}</svg>{key}'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>\n"
    )
