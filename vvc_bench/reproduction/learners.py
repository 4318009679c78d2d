"""Rows of Tables 2, 3 and 9: learners, trained where that is not done yet, and judged (extra ``train``)."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vvc_bench.baselines import recipes
from vvc_bench.baselines.configurations import CloningConfiguration, PpoConfiguration, SacConfiguration
from vvc_bench.baselines.training import BEST_POLICY, TRAINING, read_training
from vvc_bench.evaluation import Evaluation, Protocol, evaluate, named_protocol, read_evaluation
from vvc_bench.evaluation.aggregate import aggregate
from vvc_bench.evaluation.columns import SUCCESS
from vvc_bench.evaluation.comparison import success_rate
from vvc_bench.evaluation.evaluate import SUMMARY
from vvc_bench.evaluation.methods import protocol_hash
from vvc_bench.metrics import Estimate
from vvc_bench.metrics.documents import plain
from vvc_bench.policies import Agent, open_agent
from vvc_bench.reproduction.sets import NotThereError, find_set
from vvc_bench.reproduction.trials import Budget, Entry, Shipped, Trial
from vvc_bench.reproduction.verdicts import NOT_RUN, Verdict, judge_learner
from vvc_bench.version import __version__

_SCORE = "success_percent"
_BOOTSTRAP_SEED = 0

Progress = Callable[[str, str], AbstractContextManager[Callable[[int, int], None]]]
"""Makes a line of a label and a unit."""


@dataclass(frozen=True)
class Workplace:
    """Where trials are run, and how.

    Args:
        budget: what is spent.
        runs: folder of all trainings; those that are there are gone on with.
        threads: of trainings and evaluations.
        progress: makes a line of a label and a unit.
    """

    budget: Budget
    runs: Path
    threads: int
    progress: Progress

    def folder(self, name: str, seed: int) -> Path:
        """Of a training."""
        return self.runs / self.budget.name / run_name(name, seed)

    def evaluation(self, name: str, seed: int, protocol: str) -> Path:
        """Of an evaluation."""
        return self.runs / self.budget.name / "evaluations" / run_name(name, seed) / protocol


class _Judged(NamedTuple):
    """A policy on all protocols of the budget."""

    seed: int
    trainings: tuple[Path, ...]
    """Folders, the demonstrator's before its own."""
    policy: dict[str, str | None]
    evaluations: dict[str, Evaluation]
    summaries: dict[str, Path]


def run_name(name: str, seed: int) -> str:
    """Of what one trial leaves with one seed."""
    return f"{name}-seed{seed}"


def row(entry: Entry, place: Workplace) -> dict[str, Any]:
    """Train what is not trained, judge what is not judged, and say what came of it, as a document.

    Raises:
        ValueError: for a folder that holds another training, or demonstrations too few for a batch.
        OSError: if a folder cannot be written.
    """
    document = {"name": entry.name, "label": entry.label, "paper": entry.paper_percent, **_origins(entry)}
    try:
        judged = [_judged(entry, seed, place) for seed in _seeds(entry, place.budget)]
    except NotThereError as reason:
        return _finished(document | {"ours": None, "verdict": Verdict(NOT_RUN, str(reason))})
    ours = {name: _result([each.evaluations[name] for each in judged]) for name in place.budget.protocols}
    first = ours[place.budget.protocols[0]]
    estimate = Estimate(first["percent"], first["low"], first["high"])
    return _finished(
        document
        | {
            "ours": ours,
            "verdict": judge_learner(estimate, entry.paper_percent, run=place.budget.judges_learners),
            "trainings": list(_trainings(judged)),
            "policies": [{"seed": each.seed, "sha256": each.policy["sha256"]} for each in judged],
            "evaluations": [
                {"seed": each.seed, "protocol": name, "summary_sha256": _sha256(path)}
                for each in judged
                for name, path in each.summaries.items()
            ],
        }
    )


def _finished(document: dict[str, Any]) -> dict[str, Any]:
    finished: dict[str, Any] = plain(document)
    return finished


def _origins(entry: Entry) -> dict[str, Any]:
    """What is trained, in words and values."""
    if isinstance(entry, Shipped):
        return {"algorithm": "shipped"}
    return {
        "algorithm": entry.algorithm,
        "configuration": {"name": entry.configuration_name, **entry.configuration._asdict()},
        "demonstrations": entry.demonstrations,
        "demonstrator": entry.demonstrator.name if entry.demonstrator else None,
        "curriculum": entry.curriculum,
    }


def _seeds(entry: Entry, budget: Budget) -> Sequence[int]:
    return (0,) if isinstance(entry, Shipped) else budget.seeds


def _judged(entry: Entry, seed: int, place: Workplace) -> _Judged:
    """One run of an entry: trained with one seed, its best policy flown to every goal."""
    if isinstance(entry, Shipped):
        trainings: tuple[Path, ...] = ()
        agent = _shipped(entry)
    else:
        trainings = tuple(_trained(entry, seed, place))
        agent = open_agent(str(trainings[-1] / BEST_POLICY))
    folders = {name: place.evaluation(entry.name, seed, name) for name in place.budget.protocols}
    evaluations = {
        name: _evaluated(agent, run_name(entry.name, seed), named_protocol(name), folder, place)
        for name, folder in folders.items()
    }
    summaries = {name: folder / SUMMARY for name, folder in folders.items()}
    return _Judged(seed, trainings, agent.describe(), evaluations, summaries)


def _shipped(entry: Shipped) -> Agent:
    try:
        return open_agent(entry.name)
    except (ValueError, OSError) as error:
        raise NotThereError(f"the package has no policy {entry.name} yet") from error


def _trained(trial: Trial, seed: int, place: Workplace) -> Iterator[Path]:
    """Train, the demonstrator first where there is one; the folders in that order."""
    if trial.demonstrator is not None:
        yield from _trained(trial.demonstrator, seed, place)
    folder, name, configuration = place.folder(trial.name, seed), trial.configuration_name, trial.configuration
    budget = place.budget
    setting = recipes.Setting(budget.task, seed, budget.evaluations, place.threads, progress=place.progress)
    match configuration:
        case CloningConfiguration():
            assert trial.demonstrations is not None
            recipes.train_gcbc(setting, folder, find_set(trial.demonstrations), name, configuration)
        case PpoConfiguration():
            cloned = None if trial.demonstrator is None else place.folder(trial.demonstrator.name, seed)
            recipes.train_ppo(setting, folder, name, configuration, cloned=cloned, curriculum=trial.curriculum)
        case SacConfiguration():
            recipes.train_sac(setting, folder, name, configuration, curriculum=trial.curriculum)
    yield folder


def _evaluated(agent: Agent, label: str, protocol: Protocol, folder: Path, place: Workplace) -> Evaluation:
    """The policy's evaluation, flown unless it is there."""
    kept = read_evaluation(folder) if (folder / SUMMARY).is_file() else None
    if kept is not None and _is_of(kept, agent, protocol):
        return kept
    with place.progress(f"{label} on {protocol.name}", " flights") as show:
        evaluation = evaluate(agent, protocol, threads=place.threads, progress=show)
    evaluation.write(folder)
    return evaluation


def _is_of(evaluation: Evaluation, agent: Agent, protocol: Protocol) -> bool:
    known = (evaluation.summary["policy"], protocol_hash(evaluation), evaluation.summary["versions"])
    return known == (agent.describe(), protocol.hash, {"vvc_bench": __version__})


def _result(evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """Share of goals reached, in percent: of one policy with Wilson's interval, of several the interquartile mean."""
    if len(evaluations) == 1:
        percent, low, high = (100.0 * part for part in success_rate(evaluations[0].episodes[SUCCESS].to_numpy()))
        return {"percent": percent, "low": low, "high": high, "interval": "Wilson", "policies": 1}
    found = aggregate(evaluations, _SCORE, np.random.default_rng(_BOOTSTRAP_SEED))
    middle = found.interquartile_mean
    return {
        "percent": middle.value,
        "low": middle.low,
        "high": middle.high,
        "interval": "interquartile mean, bootstrap over policies",
        "policies": len(evaluations),
        "mean_std": found.mean_std,
    }


def _trainings(judged: Sequence[_Judged]) -> Iterator[dict[str, Any]]:
    """What was spent, training by training."""
    for each in judged:
        for folder in each.trainings:
            document = read_training(folder)
            yield {
                "run": folder.name,
                "seed": each.seed,
                "demonstrations": document["plan"]["demonstrations"],
                "done": document["done"],
                "unit": document["unit"],
                "wall_s": document["wall_s"],
                "threads": document["threads"],
                "training_sha256": _sha256(folder / TRAINING),
            }


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
