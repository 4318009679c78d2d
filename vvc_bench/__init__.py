"""vvc-bench: fixed-wing velocity-vector control for goal-conditioned and demonstration-based reinforcement learning.

Importing it registers the environments: ``gymnasium.make("VVC/Hard-v0")``. Demonstrations: ``load_dataset("pid-v0")``.
"""

from typing import TYPE_CHECKING, Any

from vvc_bench.envs import register_environments
from vvc_bench.version import __version__ as __version__

if TYPE_CHECKING:
    from vvc_bench.datasets.sources import load_dataset as load_dataset

register_environments()


def __getattr__(name: str) -> Any:
    """Import what datasets need only when they are asked for."""
    if name == "load_dataset":
        from vvc_bench.datasets.sources import load_dataset

        return load_dataset
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
