"""IRPO: clone, improve, fly every goal, keep what is new or shorter, add the mirror image; and again from there.

As the authors' public script does (``rollout_by_policy_and_update_demostrations.py`` of ``fly-craft-examples``), a set
is updated by policies of several seeds, one after another.
"""

import dataclasses
import multiprocessing
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from vvc_bench.baselines.configurations import StagedConfiguration
from vvc_bench.baselines.recipes import PPO, Setting, silent, train_gcbc_ppo
from vvc_bench.baselines.training import BEST_POLICY, write_json
from vvc_bench.datasets.build import add_mirror_image, update_by_policies
from vvc_bench.datasets.catalogue import LEARNED, GoalGrid, Mirrored, Specification, Updated, grid_flown
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.manifest import MANIFEST
from vvc_bench.datasets.store import open_dataset
from vvc_bench.policies.onnx import open_onnx

SUMMARY = "irpo.json"


def train_irpo(
    setting: Setting,
    folder: Path,
    dataset: Dataset,
    name: str,
    configuration: StagedConfiguration,
    *,
    seeds: Sequence[int] = (1,),
    processes: int = 1,
    curriculum: str | None = None,
) -> dict[str, Any]:
    """Iterate. What is done is not done again: each stage is a folder of its own.

    Iteration k clones the set before it and improves the best clone by PPO, with each seed (``k-seed<s>``), flies the
    grid with the best policies' deterministic actions under the rules `LEARNED`, offers what reaches to the set
    (``k-set``), and adds its mirror image (``k-set-mirrored``), from which the next begins. The set that it all begins
    from is flown anew under these rules first, and by them policies are judged on the way, but for iterations by the
    task as it is (`StagedConfiguration.by_task`). The sets name the policies by the SHA-256 of their ONNX files, in
    their specification and in each flight's source.

    Args:
        setting: what all trainings have in common.
        folder: where.
        dataset: what it begins from: a set of the catalogue, whose goals are flown.
        name: the configuration's.
        configuration: one PPO for each iteration.
        seeds: policies of each iteration, or one number for all; the first has the setting's seed, the next the one
            after that.
        processes: trainings of an iteration side by side; the others than the first show no progress.
        curriculum: one of `vvc_bench.baselines.configurations.CURRICULA`; by default PPO's goals are the task's.

    Returns:
        For each iteration what was trained, and what its sets are.

    Raises:
        ValueError: for a set that is not of the catalogue, a folder of another plan, less than one seed or process, or
            seeds for another number of iterations.
        OSError: if something cannot be written.
    """
    every = len(configuration.improving)
    counts = [*seeds] * every if len(seeds) == 1 else [*seeds]
    if min(*counts, processes) < 1:
        raise ValueError(f"IRPO takes at least one seed and one process, got {counts} and {processes}")
    if len(counts) != every:
        raise ValueError(f"seeds must be one number, or one for each of {every} iterations; got {counts}")
    grid = grid_flown(dataset.name)
    by_task = dataclasses.replace(setting, fields={})
    by_sets_rules = dataclasses.replace(setting, protocol=f"{setting.task}-sets-validation-v0")
    alone = dataclasses.replace(setting, threads=setting.threads * processes)
    critics: list[Path | None] = [None]
    iterations = []
    for k, (improving, count) in enumerate(zip(configuration.improving, counts, strict=True), start=1):
        learning = by_task if k <= configuration.by_task else by_sets_rules
        once = StagedConfiguration(configuration.cloning, (improving,))
        trainings = [
            _Training(
                dataclasses.replace(learning, seed=seed),
                folder / f"{k}-seed{seed}",
                *(dataset, name, once, critics[i % len(critics)], curriculum),
            )
            for i, seed in enumerate(range(setting.seed, setting.seed + count))
        ]
        if configuration.keeps_critic:
            critics = [training.folder / PPO for training in trainings]
        trained = _train_all(trainings, processes)
        policies = [training.folder / PPO / BEST_POLICY for training in trainings]
        updated = _update(alone, folder / f"{k}-set", dataset, k, policies, grid)
        dataset = _mirror(alone, folder / f"{k}-set-mirrored", updated, k, grid)
        iterations.append({"trained": trained, "set": _described(updated), "mirrored": _described(dataset)})
        write_json(folder / SUMMARY, {"iterations": iterations})
    return {"iterations": iterations}


class _Training(NamedTuple):
    """One seed of an iteration."""

    setting: Setting
    folder: Path
    dataset: Dataset
    name: str
    configuration: StagedConfiguration
    critic: Path | None
    curriculum: str | None

    def run(self) -> dict[str, Any]:
        """Train; what came of the clone, and of PPO."""
        documents = train_gcbc_ppo(
            *(self.setting, self.folder, self.dataset, self.name, self.configuration),
            critic=self.critic,
            curriculum=self.curriculum,
        )
        return {
            stage: {"best": document["best"], "wall_s": document["wall_s"]} for stage, document in documents.items()
        }


def _train_all(trainings: Sequence[_Training], processes: int) -> dict[str, Any]:
    """Folder's name → what came of it."""
    names = [training.folder.name for training in trainings]
    if processes == 1:
        return dict(zip(names, map(_Training.run, trainings), strict=True))
    shown, *others = trainings
    hidden = [each._replace(setting=dataclasses.replace(each.setting, progress=silent)) for each in others]
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _end_with_parent) as pool:
        return dict(zip(names, pool.map(_Training.run, [shown, *hidden]), strict=True))


def _end_with_parent() -> None:
    """A killed parent leaves no training behind that would hold its folder for an hour."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _update(
    setting: Setting, folder: Path, parent: Dataset, k: int, policies: Sequence[Path], grid: GoalGrid
) -> Dataset:
    """The set after the policies have flown the grid."""
    agents = [open_onnx(policy) for policy in policies]
    specification = Specification(
        f"irpo{k}-seed{setting.seed}",
        f"iteration {k} of IRPO from {parent.name}, seed {setting.seed}",
        LEARNED,
        Updated.by_files(grid, parent.name, [agent.sha256 for agent in agents]),
        setting.seed,
    )
    if not _is_made(folder, specification, parent):
        with setting.progress(f"flying {specification.name}", " goals") as progress:
            update_by_policies(specification, folder, parent, agents, threads=setting.threads, progress=progress)
    return open_dataset(folder)


def _mirror(setting: Setting, folder: Path, parent: Dataset, k: int, grid: GoalGrid) -> Dataset:
    specification = Specification(
        f"irpo{k}-aug-seed{setting.seed}",
        f"{parent.name} and its mirror image",
        parent.scenario,
        Mirrored(parent.name, resimulate=False),
        setting.seed,
    )
    if not _is_made(folder, specification, parent):
        add_mirror_image(specification, folder, parent, grid.goals, threads=setting.threads)
    return open_dataset(folder)


def _is_made(folder: Path, specification: Specification, parent: Dataset) -> bool:
    """Whether a folder holds this very set.

    Raises:
        ValueError: if it holds another one.
    """
    if not (folder / MANIFEST).exists():
        return False
    manifest = open_dataset(folder).manifest
    if manifest["specification"] != specification.to_json() or manifest["parents"] != {parent.name: parent.hash}:
        raise ValueError(
            f"{folder} holds another set than {specification.name} from {parent.name}: choose another folder"
        )
    return True


def _described(dataset: Dataset) -> dict[str, Any]:
    """What there is to say of a set; its manifest has the rest."""
    return {
        "name": dataset.name,
        "hash": dataset.hash,
        "episodes": len(dataset),
        "metrics": dataset.manifest["metrics"],
    }
