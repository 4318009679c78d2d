"""vvc-bench: fixed-wing velocity-vector control for goal-conditioned and demonstration-based reinforcement learning.

Importing it registers the environments: ``gymnasium.make("VVC/Hard-v0")``.
"""

from vvc_bench.envs import register_environments

__version__ = "0.1.0"

register_environments()
