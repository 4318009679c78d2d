"""A line on the terminal that says how far a long task has come."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_WIDTH = 24
_BETWEEN = 0.1  # s between two drawings of the line
_PREFIXES = ("", "k", "M", "G", "T")


@contextmanager
def progress_line(label: str, unit: str, *, shown: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Draw a line on stderr while a task runs, if that is a terminal.

    Args:
        label: what is being done.
        unit: of what.
        shown: whether to draw at all.

    Yields:
        What to tell how many units are done, and how many there are.
    """
    line = _Line(label, unit)
    seen = shown and sys.stderr is not None and sys.stderr.isatty()
    try:
        yield line.show if seen else _show_nothing
    finally:
        line.close()


def _show_nothing(_done: int, _total: int) -> None:
    """Draw no line."""


class _Line:
    def __init__(self, label: str, unit: str) -> None:
        self._label, self._unit = label, unit
        self._begun, self._drawn = time.monotonic(), 0.0

    def show(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._drawn >= _BETWEEN or done >= total:
            self._drawn = now
            sys.stderr.write(f"\r{self._text(done, total, now - self._begun)}\x1b[K")
            sys.stderr.flush()

    def close(self) -> None:
        if self._drawn:
            sys.stderr.write("\n")
            sys.stderr.flush()

    def _text(self, done: int, total: int, seconds: float) -> str:
        share = min(done / max(total, 1), 1.0)
        bar = ("█" * round(share * _WIDTH)).ljust(_WIDTH, "░")
        left = "" if not 0.0 < share < 1.0 else f", {seconds / share - seconds:.0f} s left"
        return f"{self._label} {bar} {share:4.0%} {short_number(done)}/{short_number(total)}{self._unit}{left}"


def short_number(value: float) -> str:
    """Three digits and a prefix, with a space for the unit that follows: ``"138 M"``."""
    power = 0
    while abs(value) >= 999.5 and power < len(_PREFIXES) - 1:
        value, power = value / 1000.0, power + 1
    return f"{value:.3g} {_PREFIXES[power]}"
