"""What can be judged: built-in policies, ONNX files, and, where they are trusted, Python and PyTorch."""

from vvc_bench.policies.agent import Agent
from vvc_bench.policies.conversion import to_onnx
from vvc_bench.policies.opening import open_agent

__all__ = ["Agent", "open_agent", "to_onnx"]
