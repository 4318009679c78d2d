"""Policies as ONNX files: a linear law that flies well, a network of random weights, a recurrent one, odd ones."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

INPUTS = {"observation": 8, "desired_goal": 3}


def linear_law() -> NDArray[np.float32]:
    """From observation and goal to roll rate, load factor and throttle, shape (11, 3): flies most of VVC/Normal-v0."""
    law = np.zeros((11, 3), dtype=np.float32)
    law[[0, 5, 10], 0] = -2.0, -4.0, 4.0
    law[[4, 9], 1] = -0.2, 0.2
    law[[3, 8, 9], 2] = -0.05, 0.05, 0.015
    return law


BIAS = np.array([0.0, 1.0, 0.1], dtype=np.float32)


def write_model(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    constants: dict[str, NDArray[np.float32]],
    inputs: dict[str, int] = INPUTS,
    outputs: dict[str, int] | None = None,
    batch: str | int = "B",
) -> Path:
    def tensors(widths: dict[str, int]) -> list[onnx.ValueInfoProto]:
        return [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, width]) for name, width in widths.items()
        ]

    graph = helper.make_graph(
        nodes,
        "policy",
        tensors(inputs),
        tensors(outputs or {"action": 3}),
        [numpy_helper.from_array(values, name) for name, values in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def write_linear(path: Path, bias: NDArray[np.float32] = BIAS) -> Path:
    """``action = [observation, goal] · law + bias``."""
    nodes = [
        helper.make_node("Concat", ["observation", "desired_goal"], ["seen"], axis=1),
        helper.make_node("Gemm", ["seen", "law", "bias"], ["action"]),
    ]
    return write_model(path, nodes, {"law": linear_law(), "bias": bias})


def write_network(path: Path, width: int = 128) -> Path:
    """The linear law plus a little of a tanh network with two hidden layers: it flies, and costs what one does."""
    generator = np.random.default_rng(0)
    sizes = (11, width, width, 3)
    scale = np.array([180, 90, 180, 1000, 90, 180, 300, 20000, 1000, 90, 180], dtype=np.float32)
    constants = {"law": linear_law(), "bias": BIAS, "scale": scale}
    nodes = [
        helper.make_node("Concat", ["observation", "desired_goal"], ["seen"], axis=1),
        helper.make_node("Gemm", ["seen", "law", "bias"], ["linear"]),
        helper.make_node("Div", ["seen", "scale"], ["layer0"]),
    ]
    for k, (fan_in, fan_out) in enumerate(itertools.pairwise(sizes)):
        constants[f"w{k}"] = (generator.standard_normal((fan_in, fan_out)) / np.sqrt(fan_in)).astype(np.float32)
        constants[f"b{k}"] = np.zeros(fan_out, dtype=np.float32)
        last = k == len(sizes) - 2
        nodes.append(helper.make_node("Gemm", [f"layer{k}", f"w{k}", f"b{k}"], ["small" if last else f"sum{k}"]))
        if not last:
            nodes.append(helper.make_node("Tanh", [f"sum{k}"], [f"layer{k + 1}"]))
    constants["little"] = np.array([2.0, 0.02, 0.01], dtype=np.float32)
    nodes += [
        helper.make_node("Mul", ["small", "little"], ["added"]),
        helper.make_node("Add", ["linear", "added"], ["action"]),
    ]
    return write_model(path, nodes, constants)


def write_recurrent(path: Path) -> Path:
    """The linear law, and a state that counts steps; from step 5 on it commands full throttle."""
    constants = {
        "law": linear_law(),
        "bias": BIAS,
        "one": np.ones((1, 1), dtype=np.float32),
        "five": np.full((1, 1), 5.0, dtype=np.float32),
        "throttle": np.array([[0.0, 0.0, 1.0]], dtype=np.float32),
    }
    nodes = [
        helper.make_node("Concat", ["observation", "desired_goal"], ["seen"], axis=1),
        helper.make_node("Gemm", ["seen", "law", "bias"], ["linear"]),
        helper.make_node("Add", ["state", "one"], ["next_state"]),
        helper.make_node("GreaterOrEqual", ["state", "five"], ["late"]),
        helper.make_node("Cast", ["late"], ["late_number"], to=TensorProto.FLOAT),
        helper.make_node("Mul", ["late_number", "throttle"], ["more"]),
        helper.make_node("Add", ["linear", "more"], ["action"]),
    ]
    return write_model(path, nodes, constants, {**INPUTS, "state": 1}, {"action": 3, "next_state": 1})
