"""Policies as ONNX models of a few nodes, honest and otherwise."""

from collections.abc import Sequence

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

_OPSET = [helper.make_opsetid("", 17)]


def weights(roll_gain: float = 2.0) -> NDArray[np.float32]:
    """A guidance law linear in observation and goal, shape (11, 3): flies most goals of `VVC/Normal-v0`.

    Roll, pitch, yaw, speed, path angle, azimuth, roll rate, altitude; wanted speed, path angle, azimuth → roll rate,
    load factor, throttle.
    """
    law = np.zeros((11, 3), dtype=np.float32)
    law[[0, 5, 10], 0] = -roll_gain, -2.0 * roll_gain, 2.0 * roll_gain
    law[[4, 9], 1] = -0.2, 0.2
    law[[3, 8, 9], 2] = -0.05, 0.05, 0.015
    return law


BIAS = np.array([0.0, 1.0, 0.1], dtype=np.float32)


def model(
    nodes: Sequence[onnx.NodeProto],
    initializers: Sequence[onnx.TensorProto] = (),
    functions: Sequence[onnx.FunctionProto] = (),
    opsets: Sequence[onnx.OperatorSetIdProto] = _OPSET,
) -> bytes:
    """A model with a policy's inputs and outputs."""
    graph = helper.make_graph(
        nodes,
        "policy",
        [
            helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["B", 8]),
            helper.make_tensor_value_info("desired_goal", TensorProto.FLOAT, ["B", 3]),
        ],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["B", 3])],
        list(initializers),
    )
    made = helper.make_model(graph, opset_imports=list(opsets), functions=list(functions), ir_version=8)
    return bytes(made.SerializeToString())


def linear(law: NDArray[np.float32] | None = None, *, last: Sequence[onnx.NodeProto] = (), **parts: object) -> bytes:
    """``action = [observation, goal] · law + bias``, and what ``last`` makes of it: from ``linear`` to ``action``."""
    nodes = [
        helper.make_node("Concat", ["observation", "desired_goal"], ["seen"], axis=1),
        helper.make_node("Gemm", ["seen", "law", "bias"], ["linear"]),
        *(last or [helper.make_node("Identity", ["linear"], ["action"])]),
    ]
    values = [
        numpy_helper.from_array(weights() if law is None else law, "law"),
        numpy_helper.from_array(BIAS, "bias"),
        *parts.pop("initializers", ()),  # type: ignore[misc]
    ]
    return model(nodes, values, **parts)  # type: ignore[arg-type]


def with_nan() -> bytes:
    """NaN for goals to the left."""
    return linear(
        last=[
            helper.make_node("Gather", ["desired_goal", "azimuth"], ["wanted"], axis=1),
            helper.make_node("Sqrt", ["wanted"], ["root"]),
            helper.make_node("Add", ["linear", "root"], ["action"]),
        ],
        initializers=[numpy_helper.from_array(np.array([2], dtype=np.int64), "azimuth")],
    )


def with_external_data(place: str) -> bytes:
    """Weights that lie in another file."""
    made = onnx.ModelProto.FromString(linear())
    law = made.graph.initializer[0]
    law.ClearField("raw_data")
    law.data_location = TensorProto.EXTERNAL
    law.external_data.add(key="location", value=place)
    return bytes(made.SerializeToString())


def _looping(trips: int, body_nodes: Sequence[onnx.NodeProto], initializers: Sequence[onnx.TensorProto] = ()) -> bytes:
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["go_on"]), *body_nodes],
        "body",
        [
            helper.make_tensor_value_info("trip", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("carried", TensorProto.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("go_on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("carried_on", TensorProto.FLOAT, None),
        ],
        list(initializers),
    )
    return linear(
        last=[helper.make_node("Loop", ["trips", "", "linear"], ["action"], body=body)],
        initializers=[numpy_helper.from_array(np.array(trips, dtype=np.int64), "trips")],
    )


def endless() -> bytes:
    """A loop of 10¹⁵ rounds."""
    return _looping(10**15, [helper.make_node("Neg", ["carried"], ["carried_on"])])


def with_hidden_external_data(place: str) -> bytes:
    """The same, in a constant of a loop's body."""
    law = numpy_helper.from_array(np.ones(3, dtype=np.float32), "hidden")
    law.ClearField("raw_data")
    law.data_location = TensorProto.EXTERNAL
    law.external_data.add(key="location", value=place)
    return _looping(
        1,
        [
            helper.make_node("Constant", [], ["hidden"], value=law),
            helper.make_node("Add", ["carried", "hidden"], ["carried_on"]),
        ],
    )


def greedy() -> bytes:
    """A tensor of 4·10¹¹ bytes."""
    return linear(
        last=[
            helper.make_node("ConstantOfShape", ["shape"], ["zeros"]),
            helper.make_node("ReduceSum", ["zeros"], ["zero"], keepdims=0),
            helper.make_node("Add", ["linear", "zero"], ["action"]),
        ],
        initializers=[numpy_helper.from_array(np.array([10**11], dtype=np.int64), "shape")],
    )


def with_random_numbers() -> bytes:
    """Noise that nobody can fly again."""
    return linear(
        last=[
            helper.make_node("RandomNormalLike", ["linear"], ["noise"]),
            helper.make_node("Add", ["linear", "noise"], ["action"]),
        ]
    )


def with_foreign_operator() -> bytes:
    """An operator that only onnxruntime has."""
    return linear(
        last=[helper.make_node("Gelu", ["linear"], ["action"], domain="com.microsoft")],
        opsets=[*_OPSET, helper.make_opsetid("com.microsoft", 1)],
    )


def with_function() -> bytes:
    """A function of its own."""
    double = helper.make_function(
        "own", "Double", ["x"], ["y"], [helper.make_node("Add", ["x", "x"], ["y"])], opset_imports=_OPSET
    )
    return linear(
        last=[helper.make_node("Double", ["linear"], ["action"], domain="own")],
        functions=[double],
        opsets=[*_OPSET, helper.make_opsetid("own", 1)],
    )


def with_another_output() -> bytes:
    """No ``action``."""
    made = onnx.ModelProto.FromString(linear())
    made.graph.node[-1].output[0] = made.graph.output[0].name = "force"
    return bytes(made.SerializeToString())
