"""What the scripts of this folder share: flights as arrays, tables in pages, figures that look alike."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from vvc_bench import sim
from vvc_bench.sim.stepping import ACCURATE_SUBSTEP
from vvc_bench.sim.units import DEGREES_PER_RADIAN

Array = NDArray[np.float64]
Commands = Array | Callable[[int, Array], Array]
"""Shape (steps, N, width), or a function of the step and the states (N, F) that gives (N, width)."""

DOCS = Path(__file__).parents[2]
INDEX = {name: k for k, name in enumerate(sim.State._fields)}
GROUND_VELOCITY = slice(INDEX["velocity_north"], INDEX["velocity_up"] + 1)
POSITION = slice(INDEX["north"], INDEX["altitude"] + 1)
STILL = sim.make_conditions()

INK, FAINT, GRID = "#2b2d33", "#6b7280", "#dfe3e8"
COLOURS = ("#1d3557", "#d9730d", "#2a9d8f", "#b5446e", "#e0a800", "#5e60ce", "#6b7280", "#c1121f", "#457b9d", "#80b918")
_DOTS_PER_INCH = 130
_COLOURS_IN_FILE = 192
_STYLE = {"size": 11, "color": INK}


def column(states: Array, name: str) -> Array:
    """One quantity of many states by its column name, in the unit that the name carries."""
    k = list(sim.columns(sim.State)).index(name)
    return states[..., k] * sim.columns(sim.State)[name].unit.scale


def inside(commands: ArrayLike, settings: sim.Settings) -> Array:
    """Commands in outside units (degrees, degrees per second) as the simulator takes them."""
    return np.asarray(commands) / [field.unit.scale for field in sim.columns(settings.command_fields).values()]


def pieces(*parts: tuple[float, ...], frequency_hz: float = 10.0) -> Array:
    """A command sequence from parts (seconds, components ...), each held for its time; shape (steps, components)."""
    held = [np.tile(values, (round(seconds * frequency_hz), 1)) for seconds, *values in parts]
    return np.concatenate(held)


def fly(settings: sim.Settings, states: Array, commands: Commands, steps: int, conditions: Array = STILL) -> Array:
    """Fly N aircraft together; shape (steps + 1, N, F), the start included."""
    flown = [states]
    for k in range(steps):
        command = commands(k, flown[-1]) if callable(commands) else commands[k]
        flown.append(sim.step_many(flown[-1], command, settings, conditions))
    return np.array(flown)


def with_substep(settings: sim.Settings, seconds: float) -> sim.Settings:
    """The same accurate dynamics in substeps of another length than `ACCURATE_SUBSTEP`; a whole part of a step."""
    changed = replace(settings)
    substeps = round(settings.time_step / seconds)
    vars(changed)["scheme"] = settings.scheme._replace(substeps=substeps)  # a cached property of a frozen class
    return changed


def truth(settings: sim.Settings) -> sim.Settings:
    """The accurate dynamics, ten times finer than anyone flies them."""
    return with_substep(replace(settings, dynamics="accurate"), ACCURATE_SUBSTEP / 10.0)


def angle_between(a: Array, b: Array) -> Array:
    """Angle between vectors in degrees, exact for small ones."""
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.arctan2(sine, np.sum(a * b, axis=-1)) * DEGREES_PER_RADIAN


def direction(path_angle: Array, azimuth: Array) -> Array:
    """Unit vector north, east, up of a flight path given by its angles in rad."""
    level = np.cos(path_angle)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(path_angle)], axis=-1)


def significant(value: float, digits: int = 3) -> str:
    """A number for a table, rounded to significant digits and without an exponent where it is short."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}" if decimals < digits + 3 else f"{value:.{digits - 1}e}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: bool = True) -> str:
    """A Markdown table; with ``numbers`` all columns but the first are set to the right."""
    lines = [header, ["---", *["---:" if numbers else "---"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def with_tables(text: str, tables: dict[str, str]) -> str:
    """A page's text with each table in its place, between ``<!-- name -->`` and ``<!-- end name -->``.

    Raises:
        ValueError: if the page has no such place.
    """
    for name, content in tables.items():
        begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        if begin not in text or end not in text:
            raise ValueError(f"the page has no {begin} ... {end}")
        before, after = text.split(begin)[0], text.split(end)[1]
        text = f"{before}{begin}\n{content}\n{end}{after}"
    return text


def report(page: str, tables: dict[str, str]) -> None:
    """Print tables and write them into a page of docs/."""
    for name, content in tables.items():
        print(f"{name}\n\n{content}\n")
    path = DOCS / page
    path.write_text(with_tables(path.read_text(encoding="utf-8"), tables), encoding="utf-8")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure in inches, wide enough for a page and not too wide for a phone."""
    return Figure(figsize=(width, height), dpi=_DOTS_PER_INCH, facecolor="white", layout="constrained")


def finish(axes: Axes, *, x: str = "", y: str = "", title: str = "") -> None:
    """Labels, grid and a bare frame."""
    axes.set_xlabel(x, **_STYLE)
    axes.set_ylabel(y, **_STYLE)
    axes.set_title(title, loc="left", size=12, weight="bold", color=INK)
    axes.tick_params(labelsize=10.5, colors=INK)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def save(figure: Figure, name: str) -> None:
    """Write a PNG of docs/figures/, in few colours so that it stays small."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture.quantize(_COLOURS_IN_FILE, dither=Image.Dither.NONE).save(DOCS / "figures" / name, optimize=True)
    print(f"docs/figures/{name}\n")
