"""The guidance law flies `VVC/TurnClimb-v0`: the moving picture of the README.

    python docs/figures/flight_gif.py

Writes docs/figures/turn_climb.gif, three times as fast as flown.
"""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from figure_tools import DOCS, FAINT, Array, finish
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import viridis
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from vvc_bench import sim
from vvc_bench.envs import SUB_GOALS_ID
from vvc_bench.experts import WEIGHT_COMPENSATED, PidParameters, pid_commands
from vvc_bench.flight import Flight
from vvc_bench.flight import plot as drawing
from vvc_bench.sim.fields import Goal, columns
from vvc_bench.sim.task import Task

STEPS_PER_FRAME = 3
FRAME_MS, LAST_FRAME_MS = 100, 1200
SIZE, DOTS_PER_INCH = (8.4, 4.4), 100
COLOURS_IN_FILE = 255
PARTS = {"1 turn": 0.03, "2 acceleration": 0.16, "3 climb": 0.42}  # and where their names stand
VIEW = {"elev": 34.0, "azim": -78.0}
SIZE_OF_AIRCRAFT, SIZE_OF_ARROW = 0.27, 0.36  # of the path's extent
LOAD_FACTORS = Normalize(0.0, 3.0)
SCALE = [field.unit.scale for field in columns(Goal).values()]
BANDS = np.array([Task().speed_band, Task().direction_band, Task().direction_band]) * SCALE


class Episode(NamedTuple):
    """A flight of T steps, with what was wanted and reached after each and before the first."""

    flight: Flight
    goals: Array
    """In outside units, shape (T + 1, 3)."""
    reached: Array
    """How many sub-goals, shape (T + 1,)."""
    termination: str


def fly(parameters: PidParameters = WEIGHT_COMPENSATED) -> Episode:
    """The guidance law's flight."""
    environment = gymnasium.make(SUB_GOALS_ID, render_mode="rgb_array")
    observed, _ = environment.reset(seed=0)
    fleet = environment.unwrapped.fleet
    scale = [field.unit.scale for field in columns(sim.GuidanceCommand).values()]
    goals, reached, ended = [observed["desired_goal"]], [0], False
    while not ended:
        commands = pid_commands(fleet.rows, fleet.goals, parameters)[0]
        observed, _, terminated, truncated, info = environment.step(commands * scale)
        goals.append(observed["desired_goal"])
        reached.append(info["sub_goals_reached"])
        ended = terminated or truncated
    return Episode(environment.unwrapped.flight, np.array(goals), np.array(reached), info["termination"])


def draw_path(axes: Any, episode: Episode, now: int) -> None:
    """The path so far, in a box that holds all of it."""
    history = episode.flight.history
    position = np.stack([history.east, history.north, history.altitude], axis=-1) / 1000.0  # km
    extent = float(np.ptp(position, axis=0).max())
    low, high = drawing._limits(position, extent)
    drawing._set_box(axes, low, high, position)
    axes.view_init(**VIEW)
    drawing._fit(axes, low, high)
    turned = drawing._body_axes(episode.flight.states)
    span = 0.15 * SIZE_OF_AIRCRAFT * extent * turned[:, :, 1]
    left, right = (position - span)[: now + 1], (position + span)[: now + 1]
    drawing._draw_shadow(axes, left, right, position[: now + 1], np.array([now]), low[2])
    colours = viridis(LOAD_FACTORS(history.load_factor[:now]))
    ribbon = Poly3DCollection(drawing._quads(left, right), facecolors=colours, edgecolors=colours, lw=0.3, zorder=3)
    axes.add_collection3d(ribbon)
    drawing._draw_glyphs(axes, position[[now]], turned[[now]], SIZE_OF_AIRCRAFT * extent)
    goal = Goal(*(episode.goals[now] / SCALE))
    drawing._draw_goal(axes, position[now], goal, SIZE_OF_ARROW * extent)


def draw_history(axes: Axes, episode: Episode, k: int, now: int) -> None:
    """One component of the velocity vector, and of the goals given so far with their band."""
    name, unit = Goal._fields[k], list(columns(Goal).values())[k].unit
    time, values = episode.flight.time, getattr(episode.flight.history, name) * SCALE[k]
    goal, past = episode.goals[: now + 1, k], time[: now + 1]
    axes.fill_between(past, goal - BANDS[k], goal + BANDS[k], step="post", color=drawing.WANTED, alpha=0.2, lw=0)
    axes.step(past, goal, where="post", color=drawing.WANTED, linewidth=1.4)
    axes.plot(past, values[: now + 1], color=drawing.FLOWN, linewidth=2.0)
    low, high = min(values.min(), episode.goals[:, k].min()), max(values.max(), episode.goals[:, k].max())
    axes.set(xlim=(0, time[-1]), ylim=(low - 0.2 * (high - low), high + 0.2 * (high - low)))
    finish(axes, x="time, s" if k == 2 else "", title=f"{name.replace('_', ' ')}, {drawing._UNIT_TEXT[unit.outside]}")
    axes.tick_params(labelsize=9)


def draw(episode: Episode, now: int) -> Image.Image:
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, facecolor="white")
    draw_path(figure.add_axes((0.0, 0.0, 0.6, 1.0), projection="3d", computed_zorder=False), episode, now)
    for k in range(len(Goal._fields)):
        draw_history(figure.add_axes((0.7, 0.735 - 0.31 * k, 0.28, 0.19)), episode, k, now)
    for k, (part, place) in enumerate(PARTS.items()):
        reached, wanted = k < episode.reached[now], k == episode.reached[now]
        colour = drawing.REACHED if reached else drawing.WANTED if wanted else FAINT
        figure.text(place, 0.92, f"{part} ✓" if reached else part, color=colour, size=13, weight="bold")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def main() -> None:
    episode = fly()
    last = len(episode.goals) - 1
    pictures = [draw(episode, now) for now in [*range(1, last, STEPS_PER_FRAME), last]]
    some = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures[::-10]]))
    palette = some.quantize(COLOURS_IN_FILE, Image.Quantize.MAXCOVERAGE)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [FRAME_MS] * (len(frames) - 1) + [LAST_FRAME_MS]
    target = DOCS / "figures" / "turn_climb.gif"
    frames[0].save(target, save_all=True, append_images=frames[1:], duration=durations, loop=0)
    print(f"docs/figures/{target.name}: {sum(durations) / 1000:g} s, {target.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
