"""IRPO: clone, improve, fly every goal, keep what is new or shorter, add the mirror image; and again from there."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from vvc_bench.baselines.configurations import StagedConfiguration
from vvc_bench.baselines.recipes import Setting, train_gcbc, train_ppo
from vvc_bench.baselines.training import BEST_POLICY, write_json
from vvc_bench.datasets.build import add_mirror_image, update_by_policy
from vvc_bench.datasets.catalogue import BY_HASH, LEARNED, GoalGrid, Mirrored, Specification, Updated, grid_flown
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
    curriculum: str | None = None,
) -> dict[str, Any]:
    """Iterate. What is done is not done again: each stage is a folder of its own.

    Iteration k clones the set before it (``k-gcbc``), improves the best clone by PPO (``k-ppo``), flies the grid with
    the best policy's deterministic actions under the rules `LEARNED`, offers what reaches to the set (``k-set``), and
    adds its mirror image (``k-set-mirrored``), from which the next begins. The set that it all begins from is flown
    anew under these rules first, and by them policies are judged on the way. The sets name the policy by the SHA-256
    of its ONNX file, in their specification and in each flight's source.

    Args:
        setting: what all trainings have in common.
        folder: where.
        dataset: what it begins from: a set of the catalogue, whose goals are flown.
        name: the configuration's.
        configuration: one PPO for each iteration.
        curriculum: one of `vvc_bench.baselines.curricula.CURRICULA`; by default PPO's goals are the task's.

    Returns:
        For each iteration what was trained, and what its sets are.

    Raises:
        ValueError: for a set that is not of the catalogue, or a folder of another plan.
        OSError: if something cannot be written.
    """
    grid = grid_flown(dataset.name)
    setting = dataclasses.replace(setting, protocol=f"{setting.task}-sets-validation-v0")
    iterations = []
    for k, improving in enumerate(configuration.improving, start=1):
        cloned, improved = folder / f"{k}-gcbc", folder / f"{k}-ppo"
        cloning = configuration.cloning._replace(hidden=improving.hidden)
        trained = {
            "gcbc": train_gcbc(setting, cloned, dataset, name, cloning),
            "ppo": train_ppo(setting, improved, name, improving, cloned=cloned, curriculum=curriculum),
        }
        updated = _update(setting, folder / f"{k}-set", dataset, k, improved / BEST_POLICY, grid)
        dataset = _mirror(setting, folder / f"{k}-set-mirrored", updated, k, grid)
        iterations.append(
            {stage: {"best": document["best"], "wall_s": document["wall_s"]} for stage, document in trained.items()}
            | {"set": _described(updated), "mirrored": _described(dataset)}
        )
        write_json(folder / SUMMARY, {"iterations": iterations})
    return {"iterations": iterations}


def _update(setting: Setting, folder: Path, parent: Dataset, k: int, policy: Path, grid: GoalGrid) -> Dataset:
    """The set after the policy has flown the grid."""
    agent = open_onnx(policy)
    specification = Specification(
        f"irpo{k}-seed{setting.seed}",
        f"iteration {k} of IRPO from {parent.name}, seed {setting.seed}",
        LEARNED,
        Updated(grid, parent.name, f"{BY_HASH}{agent.sha256}"),
        setting.seed,
    )
    if not _is_made(folder, specification, parent):
        with setting.progress(f"flying {specification.name}", " goals") as progress:
            flown = agent.begin(np.zeros(len(grid.goals), dtype=np.int64))
            update_by_policy(specification, folder, parent, flown, threads=setting.threads, progress=progress)
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
