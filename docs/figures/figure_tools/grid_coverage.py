"""Maps of the paper's grid: over speed and path angle, how many of the azimuths a set reaches."""

from figure_tools import INK, Array, finish, new_figure, save
from vvc_bench.datasets.catalogue import PAPER_GRID
from vvc_bench.metrics import coverage, reached_goals
from vvc_bench.rollout import Episodes


def share_by_direction(episodes: Episodes) -> Array:
    """Percent of the azimuths reached, shape (speeds, path angles)."""
    cells = coverage(*reached_goals(episodes, PAPER_GRID.goals))
    return 100.0 * cells.reached.sum(axis=2) / cells.flown.sum(axis=2)


def draw_coverage(sets: dict[str, Episodes], name: str) -> None:
    """A panel for each set, and its share of all goals."""
    figure = new_figure(7.4, 3.6)
    panels = figure.subplots(1, len(sets), sharey=True)
    for axes, (title, episodes) in zip(panels, sets.items(), strict=True):
        speeds, path_angles = PAPER_GRID.speed_mps.values, PAPER_GRID.path_angle_deg.values
        image = axes.pcolormesh(speeds, path_angles, share_by_direction(episodes).T, vmin=0, vmax=100, cmap="viridis")
        share = 100.0 * len(episodes) / len(PAPER_GRID.goals)
        finish(axes, x="speed, m/s", title=f"{title}\n{share:.1f} %")
        axes.set(xticks=(100, 200, 300), yticks=range(-60, 61, 30))
        axes.grid(visible=False)
    panels[0].set_ylabel("path angle, °", size=11, color=INK)
    bar = figure.colorbar(image, ax=panels, location="bottom", shrink=0.5, aspect=40)
    bar.set_label("azimuths reached, %", size=10.5, color=INK)
    save(figure, name)
