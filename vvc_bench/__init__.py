"""vvc-bench: fixed-wing velocity-vector control for goal-conditioned and demonstration-based reinforcement learning."""

__version__ = "0.1.0"
