"""Policies as ONNX files: the portable form, which holds numbers and no code.

Inputs, all float32, in the units of the environments' spaces (normalising them is the graph's own affair):

- ``observation`` (B, 8) and ``desired_goal`` (B, 3);
- ``achieved_goal`` (B, 3), if the graph wants it;
- ``state`` (B, S), if it is recurrent; zeros at the start of an episode.

Outputs: ``action`` (B, 3) in guidance or (B, 4) in end-to-end mode, in the units of the action space; with ``state``
also ``next_state`` (B, S). B is free: any number of aircraft are asked at once. All within one file, of operators of
the ONNX standard.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.policies.agent import file_sha256, import_extra
from vvc_bench.rollout import Policy
from vvc_bench.sim.fields import GuidanceCommand, Observation, SurfaceCommand

LARGEST_FILE = 32 * 10**6
"""Bytes; a network of 8 million weights."""

OBSERVATION, DESIRED_GOAL, ACHIEVED_GOAL, STATE = "observation", "desired_goal", "achieved_goal", "state"
ACTION, NEXT_STATE = "action", "next_state"
WIDTHS = {OBSERVATION: len(Observation._fields), DESIRED_GOAL: len(GOAL_COLUMNS), ACHIEVED_GOAL: len(GOAL_COLUMNS)}
"""Of the inputs that are observed; a policy must take the first two."""
ACTION_WIDTHS = (len(GuidanceCommand._fields), len(SurfaceCommand._fields))

_REQUIRED = (OBSERVATION, DESIRED_GOAL)
_TRIAL = 2
"""Aircraft that a graph is tried with when it is opened."""


@dataclass(frozen=True)
class OnnxAgent:
    """A policy from an ONNX file; see the module for its form.

    Args:
        name: the file's, without its ending.
        sha256: of the file.
        session: an open ``onnxruntime.InferenceSession``, which threads may share: each computes in its own.
        observed: names of the inputs that are observed.
        state_width: S; 0 for a policy without memory.
    """

    name: str
    sha256: str
    session: Any
    observed: tuple[str, ...]
    state_width: int

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        """A policy with an empty state."""
        outputs = [ACTION, *([NEXT_STATE] if self.state_width else [])]
        state = {STATE: np.zeros((len(seeds), self.state_width), dtype=np.float32)} if self.state_width else {}

        def policy(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
            nonlocal state
            inputs = {name: observed[name] for name in self.observed}
            action, *following = self.session.run(outputs, inputs | state)
            state = dict(zip(state, following, strict=True))
            return np.asarray(action)

        return policy

    def describe(self) -> dict[str, str | None]:
        """The file's hash tells one policy from another."""
        return {"kind": "onnx", "name": self.name, "sha256": self.sha256}


def open_onnx(path: Path) -> OnnxAgent:
    """Open an ONNX file and check that it is a policy.

    Raises:
        ValueError: for a file that is too large, is no ONNX model, or has other inputs or outputs; says which are
            needed.
        FileNotFoundError: for a file that is not there.
        ImportError: without onnxruntime.
    """
    sha256 = file_sha256(path)
    if path.stat().st_size > LARGEST_FILE:
        raise ValueError(f"{path} has {path.stat().st_size:,} bytes; at most {LARGEST_FILE:,} are taken")
    session = _open_session(path)
    inputs = {each.name: each for each in session.get_inputs()}
    outputs = {each.name: each for each in session.get_outputs()}
    _check_names(path, set(inputs), set(outputs))
    for name, width in WIDTHS.items():
        if name in inputs:
            _check_tensor(path, inputs[name], (width,))
    _check_tensor(path, outputs[ACTION], ACTION_WIDTHS)
    state_width = _state_width(path, inputs[STATE], outputs[NEXT_STATE]) if STATE in inputs else 0
    agent = OnnxAgent(path.stem, sha256, session, tuple(name for name in WIDTHS if name in inputs), state_width)
    _try(path, agent)
    return agent


def _open_session(path: Path) -> Any:
    """A session that computes in the thread that asks, so that the bits do not depend on how many cores there are."""
    runtime = import_extra("onnxruntime", "evaluate")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = runtime.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4  # what is wrong is raised
    try:
        return runtime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has a class for each status
        raise ValueError(f"{path} is no ONNX model that onnxruntime can open: {error}") from error


def _check_names(path: Path, inputs: set[str], outputs: set[str]) -> None:
    wanted = {ACTION, *([NEXT_STATE] if STATE in inputs else [])}
    if not set(_REQUIRED) <= inputs <= {*WIDTHS, STATE}:
        raise ValueError(
            f"{path}: inputs must be {', '.join(_REQUIRED)}, and may be {ACHIEVED_GOAL} and {STATE}; "
            f"it has {', '.join(sorted(inputs))}"
        )
    if outputs != wanted:
        raise ValueError(
            f"{path}: outputs must be {ACTION}, and {NEXT_STATE} if there is an input {STATE}; "
            f"it has {', '.join(sorted(outputs))}"
        )


def _check_tensor(path: Path, tensor: Any, widths: tuple[int, ...]) -> None:
    """A tensor must be float32 of shape (B, one of the widths), B free; an output may leave its width open."""
    batch, width = tensor.shape if len(tensor.shape) == 2 else (None, None)
    free = len(tensor.shape) == 2 and not isinstance(batch, int)
    if tensor.type != "tensor(float)" or not free or (isinstance(width, int) and width not in widths):
        raise ValueError(
            f"{path}: {tensor.name!r} must be float32 of shape (B, {' or '.join(map(str, widths))}) with a free B; "
            f"it is {tensor.type} of shape {_shape(tensor)}"
        )


def _state_width(path: Path, state: Any, next_state: Any) -> int:
    """S of a recurrent policy."""
    width = state.shape[-1] if state.shape else None
    if not isinstance(width, int) or width < 1:
        raise ValueError(f"{path}: input 'state' must have shape (B, S) with a fixed S; it has {_shape(state)}")
    _check_tensor(path, state, (width,))
    _check_tensor(path, next_state, (width,))
    return width


def _shape(tensor: Any) -> str:
    return f"({', '.join('?' if size is None else str(size) for size in tensor.shape)})"


def _try(path: Path, agent: OnnxAgent) -> None:
    """Ask for a few actions, as shapes that a graph declares need not be those that it computes."""
    observed = {name: np.zeros((_TRIAL, width), dtype=np.float32) for name, width in WIDTHS.items()}
    try:
        policy = agent.begin(np.zeros(_TRIAL, dtype=np.int64))
        shapes = {np.shape(policy(observed)) for _ in range(2)}  # the second time from its own state
    except Exception as error:
        raise ValueError(f"{path} fails on a batch of {_TRIAL}: {error}") from error
    if not shapes <= {(_TRIAL, width) for width in ACTION_WIDTHS}:
        raise ValueError(
            f"{path}: 'action' must have shape (B, {' or '.join(map(str, ACTION_WIDTHS))}); for a batch of {_TRIAL} it "
            f"has {min(shapes)}"
        )
