"""From Stable-Baselines3 and imitation policies to ONNX."""

from pathlib import Path
from typing import Any


def to_onnx(policy: Any, path: Path | str) -> Path:
    """Skeleton."""
    raise NotImplementedError
