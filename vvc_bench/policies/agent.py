"""What a policy must offer to be judged."""

import hashlib
import importlib
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Policy


class Agent(Protocol):
    """What can be judged."""

    @property
    def name(self) -> str:
        """``"pid"``, or a file's name without its ending."""
        ...

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        """A fresh policy for some aircraft.

        They are asked together at every step, always in the same rows, those that have finished too: it may keep a
        recurrent state. Several may be in use at a time, in different threads.

        Args:
            seeds: shape (B,): one for each aircraft, for whatever the policy draws.
        """
        ...

    def describe(self) -> dict[str, str | None]:
        """``kind``, ``name``, and ``sha256`` of the file or None."""
        ...


def file_sha256(path: Path) -> str:
    """Hash of a file.

    Raises:
        FileNotFoundError: if there is none.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no policy file {path}")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def import_extra(module: str, extra: str) -> Any:
    """An optional module.

    Raises:
        ImportError: if it is not installed; says what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(f"this takes {package}, which is missing: pip install vvc-bench[{extra}]") from error
