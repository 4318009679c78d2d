"""Tables and pages of all entries."""

from pathlib import Path


def render(root: Path, *, check: bool = False) -> list[Path]:
    """Not yet."""
    return []
