"""Policies that run code which comes with them: Python, Stable-Baselines3 (whose files are pickles), TorchScript."""

import contextlib
import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench.policies.agent import Agent, file_sha256, import_extra
from vvc_bench.policies.views import view_of
from vvc_bench.rollout import Policy


@dataclass(frozen=True)
class FunctionAgent:
    """A policy without memory: one function for all aircraft and threads."""

    kind: str
    name: str
    sha256: str | None
    function: Policy

    def begin(self, _seeds: NDArray[np.int64]) -> Policy:
        """The function itself."""
        return self.function

    def describe(self) -> dict[str, str | None]:
        """What it was opened from."""
        return {"kind": self.kind, "name": self.name, "sha256": self.sha256}


@dataclass(frozen=True)
class PythonAgent:
    """What a factory made, under the name that it was asked for by."""

    name: str
    made: Agent

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        """As the factory's agent has it."""
        return self.made.begin(seeds)

    def describe(self) -> dict[str, str | None]:
        """The entry point; code has no hash here."""
        return {"kind": "python", "name": self.name, "sha256": None}


def open_python(entry_point: str) -> Agent:
    """Import a module, from the working folder too, and call a function of it without arguments.

    Args:
        entry_point: ``"module:factory"``; the factory returns an `Agent`, or a function from observations to actions
            that keeps nothing between calls, as it is called from several threads.

    Raises:
        ValueError: if there is no such module or factory, or it returns something else.
    """
    module, _, factory = entry_point.partition(":")
    with _working_folder_on_path():
        try:
            made: Any = getattr(importlib.import_module(module), factory)()
        except (ModuleNotFoundError, AttributeError) as error:
            raise ValueError(f"cannot call {entry_point}: {error}; it must be module:factory") from error
    if hasattr(made, "begin"):
        return PythonAgent(entry_point, made)
    if callable(made):
        return FunctionAgent("python", entry_point, None, made)
    raise ValueError(f"{entry_point} must return an agent with begin(), or a function; it returned {made!r}")


@contextlib.contextmanager
def _working_folder_on_path() -> Iterator[None]:
    """As for ``python -m``: an installed command's own folder comes first otherwise."""
    sys.path.insert(0, "")
    try:
        yield
    finally:
        sys.path.remove("")


def open_stable_baselines(path: Path) -> Agent:
    """Open a Stable-Baselines3 model and take its deterministic actions; it sees what its own spaces say.

    Raises:
        ValueError: for a file that holds no model, or one of other spaces.
        FileNotFoundError: for a file that is not there.
        ImportError: without Stable-Baselines3.
    """
    sha256 = file_sha256(path)
    policy = load_stable_baselines(path)
    view = view_of(policy.observation_space, policy.action_space)

    def act(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        answer, _ = policy.predict(view.see(observed), deterministic=True)
        return view.act(np.asarray(answer, dtype=np.float32))

    return FunctionAgent("stable-baselines3", path.stem, sha256, act)


def load_stable_baselines(path: Path) -> Any:
    """The policy of a Stable-Baselines3 model, whatever the algorithm, without an environment.

    Raises:
        ValueError: for a file that holds no model.
        ImportError: without Stable-Baselines3.
    """
    save_util = import_extra("stable_baselines3.common.save_util", "train")
    _one_torch_thread()
    try:
        data, parameters, _ = save_util.load_from_zip_file(path, device="cpu")
        options = dict(data["policy_kwargs"] or {})
        if data.get("use_sde"):
            options["use_sde"] = True
        policy = data["policy_class"](data["observation_space"], data["action_space"], _no_learning, **options)
        policy.load_state_dict(parameters["policy"])
    except (ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise ValueError(f"{path} holds no Stable-Baselines3 model that can be opened: {error}") from error
    policy.set_training_mode(False)
    return policy


def _no_learning(_progress: float) -> float:
    return 0.0


def open_torchscript(path: Path) -> Agent:
    """Open a TorchScript module that is called with ``observation``, ``achieved_goal`` and ``desired_goal``.

    All are float32, in the units of the environments' spaces; it returns actions in those of the action space.

    Raises:
        ValueError: for a file that holds no such module.
        FileNotFoundError: for a file that is not there.
        ImportError: without PyTorch.
    """
    sha256 = file_sha256(path)
    torch = import_extra("torch", "train")
    _one_torch_thread()
    try:
        module = torch.jit.load(str(path), map_location="cpu").eval()
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path} holds no TorchScript module: {error}") from error

    def act(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        with torch.no_grad():
            inputs = (torch.from_numpy(observed[key]) for key in ("observation", "achieved_goal", "desired_goal"))
            return np.asarray(module(*inputs).numpy())

    return FunctionAgent("torchscript", path.stem, sha256, act)


def _one_torch_thread() -> None:
    """Evaluation has threads of its own, and what is computed must not depend on the number of cores."""
    set_threads: Callable[[int], None] = import_extra("torch", "train").set_num_threads
    set_threads(1)
