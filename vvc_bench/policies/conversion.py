"""Policies of Stable-Baselines3 and imitation as ONNX files (extra ``train``).

The graph is put together from the policy's own layers, so that it is small and does not depend on PyTorch's exporters.
What the policy was trained to see and to answer (`vvc_bench.policies.views`) becomes part of it.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench import sim
from vvc_bench.envs.options import make_spaces
from vvc_bench.flight.files import write_whole
from vvc_bench.policies.agent import import_extra
from vvc_bench.policies.onnx import ACTION, DESIRED_GOAL, OBSERVATION, WIDTHS, open_onnx
from vvc_bench.policies.views import View, view_of

_OPSET, _FORMAT = 17, 8
"""Operator set and file format that onnxruntime knows since 1.12 (2022)."""
_SAMPLES = 256
_TOLERANCE = 1e-4
"""Of the range of an action: what float32 may round otherwise."""


def to_onnx(policy: Any, path: Path | str) -> Path:
    """Write a policy as an ONNX file, and check on random observations that the file answers as the policy does.

    Args:
        policy: a policy of Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG) or imitation, or what has one as ``policy``: a
            model, a trainer. Networks of fully connected layers. Its observation and action space say what it sees:
            parts of the environments' dictionary or all flattened, in the bounds that ours have or scaled to others.
        path: where; an older file of that name is replaced.

    Returns:
        The path.

    Raises:
        ValueError: for another kind of policy, layer or space, or if the file does not answer as the policy does;
            nothing is written then.
        ImportError: without PyTorch, onnx or onnxruntime; says what to install.
    """
    inner = getattr(policy, "policy", policy)
    if not hasattr(inner, "observation_space"):
        raise ValueError(f"{type(policy).__name__} is no policy of Stable-Baselines3 or imitation, and has none")
    inner.set_training_mode(False)
    view = view_of(inner.observation_space, inner.action_space)
    model = _model(inner, view)
    place = Path(path)

    def answers_alike(written: Path) -> bool:
        _compare(inner, view, written)
        return True

    write_whole(place, lambda written: _write(written, model), answers_alike)
    return place


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _model(policy: Any, view: View) -> bytes:
    """The whole graph: parts together, scaled, through the layers, and the answer scaled back."""
    graph = _Graph()
    seen = graph.add("Concat", *view.parts, axis=1)
    seen = graph.scaled(seen, view.scale, view.offset)
    answer = seen
    for layer in _layers(policy):
        answer = graph.layer(answer, layer)
    if policy.squash_output:
        answer = graph.scaled(
            answer, (view.action_high - view.action_low) / 2, (view.action_high + view.action_low) / 2
        )
    answer = graph.add("Max", answer, graph.constant(view.action_low))
    answer = graph.add("Min", answer, graph.constant(view.action_high))
    answer = graph.scaled(answer, view.action_scale, view.action_offset)
    return graph.finished(answer, view)


def _layers(policy: Any) -> list[Any]:
    """The layers between what is seen, flattened, and the answer; deterministic."""
    nn = import_extra("torch", "train").nn
    actor = getattr(policy, "actor", policy)
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C, imitation's BC
        parts = [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net]
        squash = [nn.Tanh()] if policy.squash_output else []
    elif hasattr(actor, "latent_pi"):  # SAC
        parts, squash = [actor.features_extractor, actor.latent_pi, actor.mu], [nn.Tanh()]
    elif hasattr(actor, "mu"):  # TD3, DDPG
        parts, squash = [actor.features_extractor, actor.mu], []
    else:
        raise ValueError(
            f"{type(policy).__name__} is none of the policies that can be converted: PPO, A2C, SAC, TD3, DDPG"
        )
    return [layer for part in [*parts, *squash] for layer in _leaves(part)]


def _leaves(module: Any) -> list[Any]:
    """Layers in the order in which they compute, without those that change nothing in a vector."""
    name = type(module).__name__
    if name in ("Flatten", "FlattenExtractor", "Identity", "Dropout"):
        return []
    if name == "NormalizeFeaturesExtractor":  # imitation's
        return [module.normalize]
    if name == "CombinedExtractor" and not [leaf for each in module.extractors.values() for leaf in _leaves(each)]:
        return []
    return [leaf for child in module for leaf in _leaves(child)] if name == "Sequential" else [module]


_ACTIVATIONS = {"Tanh": "Tanh", "ReLU": "Relu", "Sigmoid": "Sigmoid", "Softplus": "Softplus"}
_SLOPED = {"ELU": ("Elu", "alpha"), "LeakyReLU": ("LeakyRelu", "negative_slope")}


class _Graph:
    """An ONNX graph that grows by an operator at a time."""

    def __init__(self) -> None:
        self.onnx = import_extra("onnx", "train")
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """One operator; the name of its output."""
        name = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, inputs, [name], **attributes))
        return name

    def constant(self, values: ArrayLike) -> str:
        """Numbers within the file; their name."""
        name = f"constant_{len(self.constants)}"
        array = np.ascontiguousarray(values, dtype=np.float32)
        self.constants.append(self.onnx.numpy_helper.from_array(array, name))
        return name

    def column(self, name: str, k: int) -> str:
        """One column of a table, shape (B, 1)."""
        index = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.array([k], dtype=np.int64), index))
        return self.add("Gather", name, index, axis=1)

    def scaled(self, name: str, scale: NDArray[Any], offset: NDArray[Any]) -> str:
        """``scale · x + offset``; nothing where that changes nothing."""
        if (scale == 1.0).all() and (offset == 0.0).all():
            return name
        return self.add("Add", self.add("Mul", name, self.constant(scale)), self.constant(offset))

    def layer(self, name: str, layer: Any) -> str:
        """One layer of PyTorch's, or one that says itself how it is computed."""
        if hasattr(layer, "add_to_graph"):
            return str(layer.add_to_graph(self, name))
        kind = type(layer).__name__
        if kind == "Linear":
            weights = [self.constant(each.detach().cpu().numpy()) for each in (layer.weight, layer.bias)]
            return self.add("Gemm", name, *weights, transB=1)
        if kind == "RunningNorm":  # imitation's
            variance = layer.running_var.double().cpu().numpy() + layer.eps
            scale = 1.0 / np.sqrt(variance)
            return self.scaled(name, scale, -layer.running_mean.double().cpu().numpy() * scale)
        if kind in _ACTIVATIONS:
            return self.add(_ACTIVATIONS[kind], name)
        if kind in _SLOPED:
            operator, slope = _SLOPED[kind]
            return self.add(operator, name, alpha=float(getattr(layer, slope)))
        if kind == "SiLU":
            return self.add("Mul", name, self.add("Sigmoid", name))
        raise ValueError(
            f"a layer {kind} is none that can be converted: Linear, RunningNorm, SiLU, "
            f"{', '.join((*_ACTIVATIONS, *_SLOPED))}; export the policy yourself (docs/policies.md has the form)"
        )

    def finished(self, answer: str, view: View) -> bytes:
        """The file."""
        helper, kind = self.onnx.helper, self.onnx.TensorProto.FLOAT
        names = [name for name in WIDTHS if name in (OBSERVATION, DESIRED_GOAL, *view.parts)]
        inputs = [helper.make_tensor_value_info(name, kind, ["B", WIDTHS[name]]) for name in names]
        outputs = [helper.make_tensor_value_info(ACTION, kind, ["B", len(view.action_low)])]
        nodes = [*self.nodes, helper.make_node("Identity", [answer], [ACTION])]
        graph = helper.make_graph(nodes, "policy", inputs, outputs, self.constants)
        opset = [helper.make_opsetid("", _OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=_FORMAT, producer_name="vvc-bench")
        self.onnx.checker.check_model(model, full_check=True)
        return bytes(model.SerializeToString())


def _compare(policy: Any, view: View, path: Path) -> None:
    """Refuse a file that does not answer as the policy does."""
    observed = _random_observations(np.random.default_rng(0))
    expected = view.act(policy.predict(view.see(observed), deterministic=True)[0])
    found = np.asarray(open_onnx(path).begin(np.zeros(_SAMPLES, dtype=np.int64))(observed))
    span = (view.action_high - view.action_low) * view.action_scale
    worst = float((np.abs(found - expected) / span).max())
    if not worst <= _TOLERANCE:
        raise ValueError(
            f"the converted policy answers otherwise: by {worst:.2g} of the range of an action; not written"
        )


def _random_observations(generator: np.random.Generator) -> dict[str, NDArray[np.float32]]:
    """As the environments may give them."""
    spaces: dict[str, Any] = make_spaces(sim.Settings()).observation.spaces  # type: ignore[attr-defined]
    return {
        name: (box.low + (box.high - box.low) * generator.random((_SAMPLES, *box.shape), dtype=np.float32))
        for name, box in spaces.items()
    }
