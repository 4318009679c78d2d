"""vvc-bench: fixed-wing velocity-vector control for goal-conditioned and demonstration-based reinforcement learning.

Importing it registers the environments: ``gymnasium.make("VVC/Hard-v0")``.
"""

from vvc_bench.envs import register_environments
from vvc_bench.version import __version__ as __version__

register_environments()
