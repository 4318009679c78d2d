"""Train a learner in a folder: measured now and then, kept often, and gone on with after it was killed.

A folder holds

- ``training.json``: what is trained with what, and how far it has come;
- ``last.pt``: all that learning goes on from, and ``best.pt``: the weights that did best on the validation goals. The
  first is a pickle: open none that you do not trust;
- ``policy.onnx`` and ``policy-best.onnx``: the same two policies as anything that judges them takes them;
- ``logs``: for TensorBoard, where that is installed.
"""

import dataclasses
import hashlib
import importlib.metadata
import importlib.util
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from vvc_bench import sim
from vvc_bench.baselines.unit_actions import from_unit
from vvc_bench.datasets.folders import locked
from vvc_bench.envs.options import make_spaces
from vvc_bench.evaluation import Evaluation, evaluate, named_protocol, protocols
from vvc_bench.evaluation.columns import GOAL
from vvc_bench.evaluation.summary import summarise
from vvc_bench.flight.files import write_whole
from vvc_bench.policies import to_onnx
from vvc_bench.policies.trusted import FunctionAgent
from vvc_bench.version import __version__

TRAINING, LAST, BEST, LOGS = "training.json", "last.pt", "best.pt", "logs"
POLICY, BEST_POLICY = "policy.onnx", "policy-best.onnx"

_BETWEEN = 120.0  # s between two checkpoints, at least
_PACKAGES = ("gymnasium", "imitation", "numpy", "stable_baselines3", "torch")

Progress = Callable[[int, int], object]
"""Told how many epochs or steps are done, and how many there are."""


class Learner(Protocol):
    """What can be trained here: `Cloning`, `Improving`, `SoftActorCritic`."""

    unit: str
    """``"epochs"`` or ``"steps"``."""

    @property
    def done(self) -> int:
        """So many of them."""
        ...

    @property
    def policy(self) -> Any:
        """A policy of Stable-Baselines3 with actions of ±1."""
        ...

    def advance(self, logger: Logger) -> None:
        """Learn a little."""
        ...

    def state(self) -> dict[str, Any]:
        """All that learning goes on from."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        ...


@dataclass(frozen=True)
class Plan:
    """What is trained: the same plan gives the same weights on the same machine and versions.

    Args:
        algorithm: its name.
        task: a name from `vvc_bench.tasks.TASKS`; validation goals are its own.
        configuration: ``name`` and all values.
        seed: of all that is drawn.
        total: epochs, or steps of all environments together; the last roll-out may go beyond.
        demonstrations: ``name`` and ``hash`` of a set, or None.
        demonstrator: ``sha256`` of the weights that it begins from, and of a critic that is not among them, or None.
        curriculum: a name, or None.
        lacking: ``name`` and ``hash`` of a set, where only goals that it lacks are learned, or None.
        fields: of the task, where it learns on a variant of it; it is judged on the task itself.
        evaluations: how often it is judged on the way, evenly spread, besides the start.
        protocol: what it is judged on, in place of the task's validation goals as they are.
    """

    algorithm: str
    task: str
    configuration: Mapping[str, Any]
    seed: int
    total: int
    demonstrations: Mapping[str, str] | None = None
    demonstrator: Mapping[str, str] | None = None
    curriculum: str | None = None
    lacking: Mapping[str, str] | None = None
    fields: Mapping[str, Any] = field(default_factory=dict)
    evaluations: int = 10
    protocol: str | None = None

    def to_json(self) -> dict[str, Any]:
        """As a document."""
        document: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return document


def protocol_for(plan: Plan) -> protocols.Protocol:
    """What a training is judged on: validation goals, which no result is reported on.

    Raises:
        ValueError: for a task without them.
    """
    return named_protocol(plan.protocol or f"{plan.task}-validation-v0")


def train(
    plan: Plan,
    folder: Path,
    make_learner: Callable[[], Learner],
    *,
    threads: int = 1,
    between: float = _BETWEEN,
    judged: NDArray[np.bool_] | None = None,
    progress: Progress = lambda _done, _total: None,
) -> dict[str, Any]:
    """Train, or go on from where this was interrupted; nothing if it is done.

    A training that was killed goes on from its last checkpoint and does what it would have done. Of several processes
    one trains and the others wait.

    Args:
        plan: what is trained.
        folder: where; new, or of the same plan.
        make_learner: the learner as it begins.
        threads: PyTorch's; more than one pays for large batches only, and is slow where cores are busy.
        between: seconds between two checkpoints, at least; there is one at every evaluation besides.
        judged: which of the validation goals count, shape (N,); by default all.
        progress: told after each bit.

    Returns:
        What ``training.json`` holds.

    Raises:
        ValueError: for a task without validation goals, none that count, or a folder that holds a training of another
            plan.
        FileExistsError: if it holds anything else.
        OSError: if it cannot be written.
    """
    protocol = protocol_for(plan)
    if judged is not None and not judged.any():
        raise ValueError(f"there is nothing to judge on: none of the goals of {protocol.name} is to be learned")
    begin(plan, folder)
    with locked(folder):
        begun = begin(plan, folder)  # another process may have trained in the meantime
        if begun.get("finished"):
            return begun
        for left in folder.glob(".*.unfinished*"):  # by a process that was killed as it wrote
            left.unlink()
        torch.set_num_threads(threads)
        return _resumed(plan, folder, make_learner(), threads, judged).run(between, progress)


def _resumed(plan: Plan, folder: Path, learner: Learner, threads: int, judged: NDArray[np.bool_] | None) -> "_Session":
    """A training as it begins, or as its last checkpoint left it."""
    record: dict[str, Any] = {"evaluations": [], "wall_s": 0.0}
    if (folder / LAST).exists():
        kept = torch.load(folder / LAST, map_location="cpu", weights_only=False)
        learner.restore(kept["learner"])
        record = kept["record"]
    return _Session(plan, folder, learner, record, threads, judged)


def begin(plan: Plan, folder: Path) -> dict[str, Any]:
    """What the folder says of a training of this plan; it is made ready if it is new.

    Raises:
        ValueError: if it holds a training of another plan.
        FileExistsError: if it holds anything else.
    """
    if (folder / TRAINING).is_file():
        document = read_training(folder)
        for key, value in plan.to_json().items():
            if document["plan"].get(key) != value:
                raise ValueError(
                    f"{folder} holds a training with {key} {document['plan'].get(key)!r}, not {value!r}: choose "
                    "another folder, or train with the same options to go on with it"
                )
        return document
    if folder.is_dir() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} holds other things than a training; it is left as it is: choose another place")
    document = {"plan": plan.to_json(), "finished": False}
    write_json(folder / TRAINING, document)
    return document


def read_training(folder: Path) -> dict[str, Any]:
    """What ``training.json`` of a folder holds.

    Raises:
        FileNotFoundError: if there is none.
        ValueError: if it is damaged.
    """
    path = folder / TRAINING
    if not path.is_file():
        raise FileNotFoundError(f"{folder} holds no training: it has no {TRAINING}; `vvc-bench train` makes one")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is no JSON document: {error}") from error
    if not isinstance(document, dict) or "plan" not in document:
        raise ValueError(f"{path} is no record of a training: it has no 'plan'")
    return document


def weights(folder: Path) -> dict[str, torch.Tensor]:
    """The weights of a training that did best on the validation goals.

    Raises:
        FileNotFoundError: if there are none.
    """
    if not (folder / BEST).is_file():
        raise FileNotFoundError(f"{folder} holds no training with a policy to begin with: it has no {BEST}")
    found: dict[str, torch.Tensor] = torch.load(folder / BEST, map_location="cpu", weights_only=True)
    return found


def weights_sha256(state: Mapping[str, torch.Tensor]) -> str:
    """A hash of weights, the same wherever they are kept."""
    digest = hashlib.sha256()
    for name, values in state.items():
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()


def deterministic(policy: Any) -> FunctionAgent:
    """What is judged while it learns: actions in the units of the action space."""
    bounds: Any = make_spaces(sim.Settings()).action

    def act(observed: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        return from_unit(policy.predict(observed, deterministic=True)[0], bounds)

    return FunctionAgent("stable-baselines3", "learner", None, act)


class _Session:
    """A training in one process."""

    def __init__(
        self,
        plan: Plan,
        folder: Path,
        learner: Learner,
        record: dict[str, Any],
        threads: int,
        judged: NDArray[np.bool_] | None,
    ) -> None:
        self._plan, self._folder, self._learner, self._record = plan, folder, learner, record
        self._threads, self._judged = threads, judged
        self._begun = time.monotonic() - record["wall_s"]
        self._logger = _make_logger(folder / LOGS)

    def run(self, between: float, progress: Progress) -> dict[str, Any]:
        plan, learner = self._plan, self._learner
        if not self._record["evaluations"]:
            self._judge()
        kept = time.monotonic()
        progress(learner.done, plan.total)
        while learner.done < plan.total:
            before = learner.done
            learner.advance(self._logger)
            if _is_due(before, learner.done, plan):
                self._judge()
            elif time.monotonic() - kept >= between:
                self._keep()
            else:
                progress(learner.done, plan.total)
                continue
            kept = time.monotonic()
            progress(learner.done, plan.total)
        self._logger.close()
        return self._finish()

    def _judge(self) -> None:
        """Fly the validation goals; keep the policy if it is the best so far."""
        protocol = protocol_for(self._plan)
        evaluation = evaluate(deterministic(self._learner.policy), protocol, threads=self._threads)
        summary = evaluation.summary if self._judged is None else _summary_of(evaluation, protocol, self._judged)
        result = {"done": self._learner.done, **{name: summary[name] for name in ("success", "length_steps", "return")}}
        self._logger.record("validation/success", summary["success"]["rate"])
        self._logger.dump(self._learner.done)
        history = self._record["evaluations"]
        rank = _rank(result)
        if not history or rank > max(map(_rank, history)):
            _save(self._folder / BEST, self._learner.policy.state_dict(), weights_only=True)
            to_onnx(self._learner.policy, self._folder / BEST_POLICY)
        history.append(result)
        self._keep()

    def _keep(self) -> None:
        """A checkpoint; what it says goes into ``training.json`` too."""
        self._record["wall_s"] = time.monotonic() - self._begun
        kept = {"learner": self._learner.state(), "record": self._record}
        _save(self._folder / LAST, kept, weights_only=False)
        self._write(finished=False)

    def _finish(self) -> dict[str, Any]:
        to_onnx(self._learner.policy, self._folder / POLICY)
        return self._write(finished=True)

    def _write(self, finished: bool) -> dict[str, Any]:
        history = self._record["evaluations"]
        files = [self._folder / name for name in (POLICY, BEST_POLICY)] if finished else []
        document = {
            "plan": self._plan.to_json(),
            "finished": finished,
            "unit": self._learner.unit,
            "done": self._learner.done,
            "protocol": protocol_for(self._plan).name,
            "evaluations": history,
            "best": max(history, key=_rank),
            "policies": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
            "weights_sha256": weights_sha256(self._learner.policy.state_dict()),
            "wall_s": round(self._record["wall_s"], 3),
            "threads": self._threads,
            "device": str(self._learner.policy.device),
            "versions": {"vvc_bench": __version__} | {name: importlib.metadata.version(name) for name in _PACKAGES},
        }
        write_json(self._folder / TRAINING, document)
        return document


def _rank(result: Mapping[str, Any]) -> tuple[float, float]:
    """What makes one evaluation better than another: goals reached, and then the return."""
    return result["success"]["rate"], result["return"]["mean"]


def _summary_of(evaluation: Evaluation, protocol: protocols.Protocol, judged: NDArray[np.bool_]) -> dict[str, Any]:
    """Of some of the goals."""
    episodes = evaluation.episodes
    return summarise(episodes[judged[episodes[GOAL].to_numpy()]], protocol, {}, evaluation.summary["seeds"])


def _is_due(before: int, done: int, plan: Plan) -> bool:
    """Whether an evaluation lies between two counts, or training ends there."""
    return done * plan.evaluations // plan.total > before * plan.evaluations // plan.total or done >= plan.total


def _make_logger(folder: Path) -> Logger:
    installed = importlib.util.find_spec("tensorboard") is not None
    return Logger(str(folder), [TensorBoardOutputFormat(str(folder))] if installed else [])


def _save(path: Path, content: Any, *, weights_only: bool) -> None:
    def opens(place: Path) -> bool:
        torch.load(place, map_location="cpu", weights_only=weights_only)
        return True

    write_whole(path, lambda place: torch.save(content, place), opens)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document, or replace an older one, in one move.

    Raises:
        OSError: if it cannot be written.
    """
    text = json.dumps(document, indent=2, sort_keys=True, allow_nan=False) + "\n"

    def write(place: Path) -> None:
        place.write_text(text, encoding="utf-8")

    write_whole(path, write, lambda place: place.read_text(encoding="utf-8") == text)
