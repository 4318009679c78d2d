"""Figures and tables of docs/near-optimal.md: what the laws reach, what the search finds, and what forbids the rest.

python docs/figures/near_optimal.py    # minutes, and twenty more where search-v0 is not here yet
"""

import tempfile
from pathlib import Path

import numpy as np
from figure_tools import COLOURS, FAINT, INK, Array, column, finish, fly, inside, new_figure, report, save, table
from figure_tools.grid_coverage import draw_coverage
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from vvc_bench import load_dataset
from vvc_bench.datasets.catalogue import HARD, PAPER_GRID, SEARCH, Axis, GoalGrid
from vvc_bench.datasets.searching import search_plans
from vvc_bench.experts import APPENDIX_C, PURSUIT, WEIGHT_COMPENSATED
from vvc_bench.metrics import BestLengths, best_lengths
from vvc_bench.metrics.coverage import find_goals
from vvc_bench.rollout import Episodes, Scenario, fly_law
from vvc_bench.search import Budget
from vvc_bench.sim.aircraft import GRAVITY
from vvc_bench.sim.task import ALL_EVENTS, Event
from vvc_bench.tasks import make_task

PAPER_COVERAGE, PAPER_LENGTH = 78.55, 116.6
"""Of the paper's best set, D_E^3 augmented."""
LAWS = {"PID, Appendix C": APPENDIX_C, "PID, weight compensated": WEIGHT_COMPENSATED, "pursuit": PURSUIT}
SHOWN_FLIGHTS = {
    "dive, then pull up": (300.0, 60.0, 0.0),
    "climb to slow down, then dive": (100.0, -75.0, 90.0),
    "turn round": (200.0, 0.0, 170.0),
    "fast, down and behind": (280.0, -60.0, -150.0),
}
CORNERS = {
    "fast and steep up: 260 to 300 m/s, 60° to 85°": GoalGrid(Axis(260, 300, 5), Axis(60, 85, 6), Axis(-160, 160, 9)),
    "slow and steep down: 100 to 120 m/s, −85° to −70°": GoalGrid(
        Axis(100, 120, 3), Axis(-85, -70, 4), Axis(-160, 160, 9)
    ),
}
CORNER_BUDGET = Budget(sweeps=12, generations=1, population=16)
_NOT_MOVING_AWAY = float(ALL_EVENTS & ~Event.MOVE_AWAY)


def draw_growth(candidates: Array, reached: Array, lengths: Array, best: BestLengths) -> None:
    figure = new_figure(7.4, 3.2)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.3))
    left.plot(candidates, reached, color=COLOURS[0], linewidth=2, marker="o", markersize=3.5)
    left.axhline(PAPER_COVERAGE, color=COLOURS[1], linewidth=1.5, linestyle="--")
    left.text(candidates[-1], PAPER_COVERAGE + 0.5, "the paper's", ha="right", size=9.5, color=COLOURS[1])
    for axes in (left, middle):
        axes.set(xticks=(0, 100, 200, 300))
    finish(left, x="plans tried for a goal", title="Reached, %")
    middle.plot(candidates, lengths, color=COLOURS[0], linewidth=2, marker="o", markersize=3.5)
    middle.axhline(PAPER_LENGTH, color=COLOURS[1], linewidth=1.5, linestyle="--")
    finish(middle, x="plans tried for a goal", title="Mean length")
    speeds, path_angles = PAPER_GRID.speed_mps.values, PAPER_GRID.path_angle_deg.values
    cells = np.full((speeds.size, path_angles.size), np.nan)
    for i, speed in enumerate(speeds):
        for j, path_angle in enumerate(path_angles):
            here = (best.goals[:, 0] == speed) & np.isclose(best.goals[:, 1], path_angle)
            cells[i, j] = best.steps[here].mean() if here.any() else np.nan
    image = right.pcolormesh(speeds, path_angles, cells.T, cmap="viridis_r")
    finish(right, x="speed, m/s", y="path angle, °", title="Length by goal")
    right.grid(visible=False)
    figure.colorbar(image, ax=right, label="steps")
    save(figure, "near_optimal_growth.png")


def path_of(episodes: Episodes, e: int) -> Array:
    """States of one flight, shape (steps + 1, F)."""
    actions = episodes.actions[episodes.offsets[e] : episodes.offsets[e + 1]].astype(float)
    commands = inside(actions, HARD.settings)[:, None]
    return fly(HARD.settings, episodes.starts[e : e + 1].copy(), commands, len(actions))[:, 0]


def nearest(episodes: Episodes, goal: tuple[float, ...]) -> int:
    return int(np.abs((episodes.goals - np.array(goal)) / (10.0, 5.0, 5.0)).sum(axis=1).argmin())


def draw_flight(axes: Axes, episodes: Episodes, e: int, name: str) -> object:
    states = path_of(episodes, e)
    east, north, up = (column(states, each) / 1000.0 for each in ("east_m", "north_m", "altitude_m"))
    points = np.stack([east, north, up], axis=-1)
    lines = Line3DCollection(np.stack([points[:-1], points[1:]], axis=1), cmap="viridis", linewidth=3)
    lines.set_array(column(states, "speed_mps")[:-1])
    lines.set_clim(80, 340)
    axes.add_collection3d(lines)
    axes.plot(east, north, np.full_like(up, up.min() - 0.2), color=FAINT, linewidth=1, alpha=0.6)
    centre, reach = (points.max(axis=0) + points.min(axis=0)) / 2, np.ptp(points, axis=0).max() / 2 + 0.2
    axes.set(
        xlim=(centre[0] - reach, centre[0] + reach),
        ylim=(centre[1] - reach, centre[1] + reach),
        zlim=(centre[2] - reach, centre[2] + reach),
        box_aspect=(1, 1, 1),
    )
    axes.set_xlabel("east, km", size=9)
    axes.set_ylabel("north, km", size=9)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=4)
    speed, path_angle, azimuth = episodes.goals[e]
    seconds = episodes.lengths[e] / HARD.settings.frequency_hz
    axes.set_title(f"{name}\n{speed:g} m/s, {path_angle:g}°, {azimuth:g}° in {seconds:.1f} s", size=10, color=INK)
    return lines


def draw_flights(episodes: Episodes) -> None:
    figure = new_figure(7.4, 8.4)
    panels = figure.subplots(2, 2, subplot_kw={"projection": "3d"})
    for axes, (name, goal) in zip(panels.flat, SHOWN_FLIGHTS.items(), strict=True):
        lines = draw_flight(axes, episodes, nearest(episodes, goal), name)
    figure.colorbar(lines, ax=panels, location="bottom", shrink=0.5, aspect=40, label="speed, m/s")
    save(figure, "near_optimal_flights.png")


def sets_table(sets: dict[str, Episodes], best: BestLengths) -> str:
    rows = []
    for name, episodes in sets.items():
        mine = best.steps[find_goals(episodes.goals, best.goals)]
        rows.append(
            [
                name,
                f"{len(episodes):,}",
                f"{100.0 * len(episodes) / len(PAPER_GRID.goals):.2f} %",
                f"{episodes.lengths.mean():.1f}",
                f"{mine.mean():.1f}",
                f"{(episodes.lengths / mine).mean():.2f}",
            ]
        )
    rows.append(["the paper's best", "", f"{PAPER_COVERAGE} %", f"{PAPER_LENGTH}", "", ""])
    header = ["", "goals", "coverage", "mean length", "the best known to these goals", "time ratio"]
    return table(header, rows)


def growth_table(candidates: Array, reached: Array, lengths: Array) -> str:
    shown = [k for k in (0, 1, 3, 7, 15, len(candidates) - 1) if k < len(candidates)]
    rows = [[f"{candidates[k]:g}", f"{reached[k]:.2f}", f"{lengths[k]:.1f}"] for k in shown]
    late = slice(len(candidates) // 2, None)
    slope, offset = np.polyfit(np.log(candidates[late]), np.log(100.0 - reached[late]), 1)
    for factor in (2, 10):
        missing = np.exp(offset + slope * np.log(candidates[-1] * factor))
        rows.append([f"{candidates[-1] * factor:g} (extrapolated)", f"{100.0 - missing:.2f}", ""])
    return table(["plans tried for a goal", "goals reached, %", "mean length, steps"], rows)


def not_found_table(found: Episodes) -> str:
    """Goals without a flight, by speed and path angle."""
    everything = PAPER_GRID.goals
    missing = everything[find_goals(everything, found.goals) < 0]
    cells, counts = np.unique(missing[:, :2].round(6), axis=0, return_counts=True)
    rows = []
    for speed in np.unique(cells[:, 0]):
        mine = cells[:, 0] == speed
        where = ", ".join(f"{mu:g}° ({n})" for mu, n in zip(cells[mine, 1], counts[mine], strict=True))
        rows.append([f"{speed:g}", str(counts[mine].sum()), where])
    return table(["speed, m/s", "not found", "path angle (azimuths of 69)"], rows, numbers=False)


def corner_table() -> str:
    """The same search in the corners of the grid: under the rules, and with one of them taken away."""
    task = HARD.task
    scenarios = {
        "the rules": HARD,
        "moving away allowed": Scenario(make_task(task, terminations=_NOT_MOVING_AWAY)),
        "80 s": Scenario(make_task(task, step_limit=2 * task.step_limit)),
        "both": Scenario(make_task(task, terminations=_NOT_MOVING_AWAY, step_limit=2 * task.step_limit)),
    }
    rows = []
    for name, grid in CORNERS.items():
        shares = []
        for scenario in scenarios.values():
            with tempfile.TemporaryDirectory() as folder:
                found = search_plans(scenario, grid, CORNER_BUDGET, Path(folder), seed=0).found
            shares.append(f"{100.0 * np.isfinite(found.lengths).mean():.1f} %")
        rows.append([name, f"{len(grid.goals)}", *shares])
    return table(["", "goals", *scenarios], rows)


def energy_table() -> str:
    """Energy height that goals need, and that the aircraft has: none is out of reach on this account."""
    start = HARD.altitude_m + HARD.speed_mps**2 / (2.0 * GRAVITY)
    fastest = PAPER_GRID.speed_mps.high - HARD.task.speed_band
    need = fastest**2 / (2.0 * GRAVITY)
    return table(
        ["energy height, m", ""],
        [
            ["at the start: 5000 m, 200 m/s", f"{start:,.0f}"],
            [f"least that a goal takes: {fastest:g} m/s at the ground", f"{need:,.0f}"],
        ],
    )


def main() -> None:
    stored = load_dataset("search-v0")
    found = stored.read()
    best = best_lengths([found])
    laws = {name: fly_law(HARD, PAPER_GRID.goals, law).episodes for name, law in LAWS.items()}
    progress = stored.manifest["metrics"]["search"]
    candidates = progress["candidates_per_sweep"] * np.arange(1.0, SEARCH.sweeps + 1.0)
    reached = 100.0 * np.array(progress["reached"]) / len(PAPER_GRID.goals)
    lengths = np.array(progress["mean_length_steps"])
    shown = {"PID": laws["PID, weight compensated"], "pursuit": laws["pursuit"], "search": found}
    draw_coverage(shown, "near_optimal_coverage.png")
    draw_growth(candidates, reached, lengths, best)
    draw_flights(found)
    report(
        "near-optimal.md",
        {
            "sets": sets_table(laws | {"search-v0": found}, best),
            "growth": growth_table(candidates, reached, lengths),
            "not found": not_found_table(found),
            "corners": corner_table(),
            "energy": energy_table(),
        },
    )


if __name__ == "__main__":
    main()
