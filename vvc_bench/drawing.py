"""How pictures on pages look: figures that a phone shows at their own size, in two themes.

Each picture is drawn twice, for light and for dark pages, in colours that the colour-blind can tell apart (Okabe and
Ito; viridis). Takes the extra ``plot`` (matplotlib). Figures are made without pyplot, so that nothing global is
touched.
"""

import io
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vvc_bench.page import Shown

try:
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator
    from PIL import Image
except ImportError as error:
    raise ImportError("pictures take matplotlib, which is missing: pip install vvc-bench[plot]") from error

Array = NDArray[np.float64]
Drawn = TypeVar("Drawn")

_WIDTH = 4.6  # inches: a phone shows it nearly at its own size
_DOTS_PER_INCH = 220
_COLOURS_IN_FILE = 256
_UNIT_TEXT = {"mps": "m/s", "deg": "°", "degps": "°/s", "m": "m", "g": "g", "": ""}


class Theme(NamedTuple):
    """Colours of a page."""

    name: str
    background: str
    ink: str
    faint: str
    grid: str
    empty: str
    """Goals that were not reached."""
    ours: str
    theirs: str
    """The paper's figures; also the bounds of what counts as reached."""
    scale: tuple[float, float]
    """The part of viridis that stands out from the background."""
    series: tuple[str, ...]
    """Of things that are drawn beside each other."""

    @property
    def colours(self) -> Colormap:
        """A scale from low to high values."""
        return ListedColormap(colormaps["viridis"](np.linspace(*self.scale, 256)))

    @property
    def differences(self) -> Colormap:
        """A scale from negative to positive values, faint in the middle."""
        return LinearSegmentedColormap.from_list("differences", [self.theirs, self.empty, self.ours])


LIGHT = Theme(
    name="light",
    background="#ffffff",
    ink="#1c2230",
    faint="#5d6675",
    grid="#e3e7ec",
    empty="#e4e7eb",
    ours="#0072b2",
    theirs="#d55e00",
    scale=(0.0, 0.93),
    series=("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5d6675", "#a08c00"),
)
DARK = Theme(
    name="dark",
    background="#171b22",
    ink="#e8ebf0",
    faint="#a3adbb",
    grid="#2c333d",
    empty="#2a3039",
    ours="#56b4e9",
    theirs="#e69f00",
    scale=(0.22, 1.0),
    series=("#56b4e9", "#e69f00", "#2fbf92", "#e39ac4", "#ff7f4d", "#4f8fd6", "#a3adbb", "#f0e442"),
)


class Picture(NamedTuple, Generic[Drawn]):
    """One picture and what is to be said of it."""

    name: str
    title: str
    caption: str
    draw: Callable[[Drawn, Theme], Figure]


def draw(picture: Picture[Drawn], material: Drawn) -> Shown:
    """A picture in both themes."""
    light, dark = (png(picture, material, theme) for theme in (LIGHT, DARK))
    return Shown(picture.name, picture.title, picture.caption, light, dark)


def png(picture: Picture[Drawn], material: Drawn, theme: Theme) -> bytes:
    """A picture as a PNG file, in few colours so that it stays small."""
    canvas: Any = FigureCanvasAgg(picture.draw(material, theme))
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    content = io.BytesIO()
    image.quantize(_COLOURS_IN_FILE, dither=Image.Dither.NONE).save(content, format="png", optimize=True)
    return content.getvalue()


def draw_cells(
    axes: Axes,
    x_edges: Array,
    y_edges: Array,
    values: Array,
    flown: NDArray[np.int64],
    scale: Normalize,
    theme: Theme,
    colours: Colormap | None = None,
) -> ScalarMappable:
    """Cells of shape (Y, X), as over azimuth and path angle; those flown and without a value in one faint colour."""
    tried = np.where(flown > 0, 1.0, np.nan)
    axes.pcolormesh(x_edges, y_edges, tried, cmap=ListedColormap([theme.empty]), rasterized=True)
    chosen = colours or theme.colours
    return axes.pcolormesh(x_edges, y_edges, values, cmap=chosen, norm=scale, rasterized=True)


def set_angle_ticks(axis: Axis, edges: Array) -> None:
    """Ticks at 45° or 90° along an axis in degrees that is long enough for them."""
    span = edges[-1] - edges[0]
    if span > 90.0:
        axis.set_major_locator(MultipleLocator(90.0 if span > 180.0 else 45.0))


# Style


def new_figure(theme: Theme, height: float) -> Figure:
    """A figure of a page's width; the height is in inches."""
    return Figure(figsize=(_WIDTH, height), dpi=_DOTS_PER_INCH, facecolor=theme.background, layout="constrained")


def label(axes: Axes, theme: Theme, x: str = "", y: str = "") -> None:
    """Style a pair of axes, and say what is along them."""
    axes.set_facecolor(theme.background)
    axes.set_xlabel(x, size=8.5, color=theme.faint)
    axes.set_ylabel(y, size=8.5, color=theme.faint)
    axes.tick_params(which="both", labelsize=8, colors=theme.faint, length=2)
    axes.grid(color=theme.grid, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(theme.grid)


def add_bar(figure: Figure, scale: ScalarMappable, axes: list[Any], text: str, theme: Theme, **options: Any) -> None:
    """A scale of colours below some axes."""
    bar = figure.colorbar(scale, ax=axes, location="bottom", aspect=38, shrink=0.7, pad=0.03, **options)
    style_bar(bar, text, theme)


def panel_title(axes: Axes, text: str, theme: Theme) -> None:
    """A small title at the left, above a pair of axes."""
    axes.set_title(text, loc="left", size=8.5, color=theme.ink, pad=2.5)


def style_bar(bar: Any, text: str, theme: Theme) -> None:
    """Style a scale of colours, and say of what."""
    bar.set_label(text, size=8.5, color=theme.faint)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=8, colors=theme.faint, length=2)


def column_text(column: str) -> str:
    """A column's name for people: ``path_angle_deg`` is "path angle, °"."""
    return ", ".join(filter(None, (name_text(column), unit_text(column))))


def name_text(column: str) -> str:
    """``path_angle_deg`` → path angle."""
    unit = _unit_suffix(column)
    return (column.removesuffix(f"_{unit}") if unit else column).replace("_", " ")


def unit_text(column: str) -> str:
    """``path_angle_deg`` → °."""
    return _UNIT_TEXT[_unit_suffix(column)]


def _unit_suffix(column: str) -> str:
    return next((unit for unit in _UNIT_TEXT if unit and column.endswith(f"_{unit}")), "")


def goal_text(column: str) -> str:
    """What is written along an axis for a component of the goal."""
    return f"wanted {name_text(column)}, {unit_text(column)}"
