"""Judge policies: named protocols, one evaluation that anyone can repeat to the last byte."""

from vvc_bench.evaluation.evaluate import Evaluation, evaluate, measure_latency, read_evaluation
from vvc_bench.evaluation.protocols import PROTOCOLS, Protocol, held_out, named_protocol

__all__ = [
    "PROTOCOLS",
    "Evaluation",
    "Protocol",
    "evaluate",
    "held_out",
    "measure_latency",
    "named_protocol",
    "read_evaluation",
]
