"""Look through an ONNX model before anything runs it: a submission holds data alone, and all of it within its file.

The model is parsed and walked; it is not loaded, and no file that it names is opened.
"""

from collections.abc import Iterator
from typing import Any

from vvc_bench.policies.onnx import LARGEST_FILE

MOST_NODES = 10_000

_STANDARD = {"", "ai.onnx"}
_RANDOM = {"Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike"}


def check_model(content: bytes) -> None:
    """Accept a model that is nothing but operators of the ONNX standard and numbers within this file.

    Inputs and outputs are checked where policies are opened.

    Raises:
        ValueError: for anything else; says what was found.
        ImportError: without onnx; says what to install.
    """
    if len(content) > LARGEST_FILE:
        raise ValueError(f"the model has {len(content)} bytes; at most {LARGEST_FILE} are taken")
    model = _parse(content)
    if model.functions or model.training_info:
        raise ValueError("the model brings functions or training information of its own; only a graph is taken")
    nodes = 0
    for graph in _graphs(model.graph):
        for tensor in _tensors(graph):
            _check_tensor(tensor)
        for node in graph.node:
            nodes += 1
            _check_node(node)
    if not 0 < nodes <= MOST_NODES:
        raise ValueError(f"the model has {nodes} nodes; 1 to {MOST_NODES} are taken")


def _parse(content: bytes) -> Any:
    try:
        import onnx
        from google.protobuf.message import DecodeError
    except ImportError as error:
        raise ImportError("looking through a model takes onnx: pip install vvc-bench[leaderboard]") from error
    try:
        model = onnx.ModelProto.FromString(content)
    except DecodeError:
        raise ValueError("the file is no whole ONNX model: it cannot be parsed") from None
    if not model.ir_version or not model.opset_import or not model.HasField("graph"):
        raise ValueError("the file is no whole ONNX model: it lacks a version, operator sets or a graph")
    return model


def _check_node(node: Any) -> None:
    if node.domain not in _STANDARD:
        raise ValueError(
            f"the model uses operator {node.domain}.{node.op_type}; only those of the ONNX standard are taken"
        )
    if node.op_type in _RANDOM:
        raise ValueError(f"the model draws random numbers ({node.op_type}): it cannot be flown again as it was flown")


def _check_tensor(tensor: Any) -> None:
    import onnx

    if tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data:
        places = ", ".join(repr(entry.value) for entry in tensor.external_data if entry.key == "location") or "a file"
        raise ValueError(f"tensor {tensor.name!r} lies outside of the model, in {places}; all must be within its file")


def _graphs(graph: Any) -> Iterator[Any]:
    """A graph and all graphs within its nodes, as those of If and Loop."""
    left = [graph]
    while left:
        one = left.pop()
        yield one
        for node in one.node:
            for attribute in node.attribute:
                left += [*attribute.graphs, *([attribute.g] if attribute.HasField("g") else [])]


def _tensors(graph: Any) -> Iterator[Any]:
    """All tensors that are stored in one graph, without those of graphs within."""
    sparse = list(graph.sparse_initializer)
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from attribute.tensors
            sparse += attribute.sparse_tensors
            if attribute.HasField("t"):
                yield attribute.t
            if attribute.HasField("sparse_tensor"):
                sparse.append(attribute.sparse_tensor)
    for tensor in sparse:
        yield from (tensor.values, tensor.indices)
