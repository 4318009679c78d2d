"""Pictures of an episode so far, by the same drawing that `vvc-bench fly` makes (extra ``plot``)."""

import importlib
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench.flight.recording import Flight

FRAME_DOTS_PER_INCH = 60  # 960 × 540 pixels


def draw_frame(flight: Flight) -> NDArray[np.uint8]:
    """A flight as an image, shape (540, 960, 3).

    Raises:
        ImportError: without matplotlib, saying how to get it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from vvc_bench.flight.plot import plot

    figure = plot(flight)
    figure.set_dpi(FRAME_DOTS_PER_INCH)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    frame: NDArray[np.uint8] = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    return frame


class Window:
    """A window that shows an episode while it is flown, by matplotlib's interactive backend (extra ``plot``).

    Drawing takes longer than most steps, so frames are left out to keep the pace of the flight. Of a flight that is
    itself slower than its pace, by a slow policy, all frames are shown.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        RuntimeError: without a display.
    """

    def __init__(self) -> None:
        importlib.import_module("vvc_bench.flight.plot")  # says so if matplotlib is missing
        import matplotlib.pyplot as plt

        if not plt.get_backend().lower().startswith(("qt", "tk", "gtk", "wx", "macosx")):
            raise RuntimeError(
                "render_mode='human' needs a display and an interactive matplotlib backend, "
                f"not {plt.get_backend()!r}; use render_mode='rgb_array' for images"
            )
        with plt.rc_context({"toolbar": "None"}):
            self._figure: Any = plt.figure("vvc-bench", figsize=(9.6, 5.4), dpi=100, frameon=False)
        axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        self._image: Any = axes.imshow(np.full((540, 960, 3), 255, dtype=np.uint8))
        self._figure.show()
        self._shown, self._began, self._took = 0.0, 0.0, 0.0  # of the last frame: time in flight, time, and how long

    def show(self, flight: Flight, *, ended: bool) -> None:
        """Show an episode so far: no earlier than due, and not while it makes up for the time of the last drawing.

        Args:
            flight: the episode so far. Its beginning is always shown.
            ended: whether this is all of it, which is always shown.
        """
        flown = float(flight.time[-1])
        early = (flown - self._shown) - (time.monotonic() - self._began) if flown > 0.0 else 0.0
        if -self._took < early < 0.0 and not ended:
            return
        if early > 0.0:
            self._figure.canvas.start_event_loop(early)
        self._shown, self._began = flown, time.monotonic()
        self._image.set_data(draw_frame(flight))
        self._figure.canvas.draw()
        self._figure.canvas.flush_events()
        self._took = time.monotonic() - self._began

    def close(self) -> None:
        """Close the window."""
        import matplotlib.pyplot as plt

        plt.close(self._figure)
