"""Pictures of an episode so far, by the same drawing that `vvc-bench fly` makes (extra ``plot``)."""

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
    """A window that shows frames, by matplotlib's interactive backend."""

    def __init__(self) -> None:
        import matplotlib.pyplot as plt

        if not plt.get_backend().lower().startswith(("qt", "tk", "gtk", "wx", "macosx")):
            raise RuntimeError(
                "render_mode='human' needs a display and an interactive matplotlib backend, "
                f"not {plt.get_backend()!r}; use render_mode='rgb_array' for images"
            )
        self._plt: Any = plt
        self._figure = plt.figure("vvc-bench", figsize=(9.6, 5.4), frameon=False)
        self._image: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Put a frame on the screen."""
        if self._image is None:
            axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            self._image = axes.imshow(frame)
        self._image.set_data(frame)
        self._plt.pause(0.001)

    def close(self) -> None:
        """Close the window."""
        self._plt.close(self._figure)
