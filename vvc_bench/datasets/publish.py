"""A dataset made ready for others: a folder that serves as a mirror, and an entry on OpenML."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from vvc_bench.datasets.catalogue import CATALOGUE
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.folders import replaced_folder
from vvc_bench.datasets.local import check_files
from vvc_bench.datasets.manifest import MANIFEST
from vvc_bench.datasets.schema import OBSERVED
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.home import home_folder
from vvc_bench.sim.fields import columns
from vvc_bench.version import __version__

OPENML_ENTRY = "openml.json"
"""What OpenML is told of the set: the arguments of `openml.OpenMLDataset` besides the data."""


def publish(dataset: Dataset, directory: Path | str) -> Path:
    """Write what others need into ``directory/NAME``: the dataset, its OpenML entry, and its data card.

    The card is left out for a name that the catalogue does not have, as it is not known then which goals were flown.

    Whoever serves the directory runs a mirror: ``VVC_BENCH_MIRROR`` may name it, as a folder or by its URL.

    Args:
        dataset: a whole one, as it was opened.
        directory: where to; other sets may be in it.

    Returns:
        The folder.

    Raises:
        ValueError: for a choice of a dataset's episodes.
        CorruptDataset: if it is damaged; nothing is written then.
        FileExistsError: if another dataset of that name is there: what a name means must not change.
        ImportError: without matplotlib, which draws the card; says what to install.
        OSError: if it cannot be written.
    """
    _require_whole(dataset)
    place = Path(directory) / dataset.name
    if (place / MANIFEST).is_file() and (place / MANIFEST).read_bytes() != (dataset.folder / MANIFEST).read_bytes():
        raise FileExistsError(f"{place} is another dataset of that name; publish this one under a new name")
    with replaced_folder(place, MANIFEST) as unfinished:
        for name in (MANIFEST, *dataset.manifest["files"]):
            shutil.copyfile(dataset.folder / name, unfinished / name)
        check_files(unfinished, dataset.name)
        if dataset.name in CATALOGUE:
            from vvc_bench.datasets.card import write_dataset_card  # takes the extra plot

            write_dataset_card(dataset, unfinished)
        entry = json.dumps(openml_entry(dataset), indent=2) + "\n"
        (unfinished / OPENML_ENTRY).write_text(entry, encoding="utf-8", newline="\n")
    return place


def publish_on_openml(dataset: Dataset) -> int:
    """Upload a dataset's transitions to OpenML under the API key that is configured there.

    Returns:
        Its number on OpenML.

    Raises:
        ValueError: for a choice of a dataset's episodes.
        CorruptDataset: if it is damaged.
        ImportError: without the ``openml`` package.
        PermissionError: without an API key, or with one that the server does not know.
        OSError: if the server does not take it.
    """
    from vvc_bench.datasets.openml_source import upload_table

    _require_whole(dataset)
    return upload_table(openml_table(dataset), openml_entry(dataset), home_folder() / "openml")


def openml_table(dataset: Dataset) -> pa.Table:
    """The table for OpenML: a row for each transition, with its episode's goal.

    Columns: ``episode``, ``step``, ``goal_…``, what was seen, ``action_…``, ``reward``, ``terminated``, ``truncated``.
    """
    goals = np.repeat(dataset.goals, dataset.lengths, axis=0)
    ends = {name: dataset.column(name).astype(np.uint8) for name in ("terminated", "truncated")}
    return pa.table(
        {name: dataset.column(name) for name in ("episode", "step")}
        | {f"goal_{name}": goals[:, k] for k, name in enumerate(GOAL_COLUMNS)}
        | {name: dataset.column(name) for name in (*OBSERVED, *_action_names(dataset), "reward")}
        | ends
    )


def openml_entry(dataset: Dataset) -> dict[str, Any]:
    """What OpenML is told of a dataset; it takes plain ASCII only."""
    counts, manifest = dataset.manifest["counts"], dataset.manifest
    specification = CATALOGUE.get(dataset.name)
    about = {key: manifest[key] for key in ("specification", "scenario", "seed", "metrics", "parents", "versions")}
    summary = specification.summary if specification else "flights of an F-16 to given velocity vectors"
    return {
        "name": dataset.name,
        "description": (
            f"{_ascii(summary)}.\n\n{counts['episodes']} episodes, {counts['transitions']} transitions of fixed-wing "
            "velocity-vector control; a row is what was seen before an action, the action, and the reward after it. "
            f"Units are in the columns' names. Made by vvc-bench {__version__}, which loads the whole dataset, with "
            f"true next states, and can fly every row again. SHA-256 of its manifest: {dataset.hash}.\n\n"
            f"{json.dumps(about, indent=1)}"
        ),
        "creator": "The vvc-bench developers",
        "language": "English",
        "licence": "MIT",
        "default_target_attribute": ",".join(_action_names(dataset)),
        "row_id_attribute": None,
        "ignore_attribute": ["episode", "step"],
        "citation": (
            "Gong et al., VVC-Gym: A Fixed-Wing UAV Reinforcement Learning Environment for Multi-Goal Long-Horizon "
            "Problems, ICLR 2025 (task); vvc-bench (data)"
        ),
        "version_label": __version__,
        "paper_url": "https://openreview.net/forum?id=5xSRg3eYZz",
    }


def _action_names(dataset: Dataset) -> list[str]:
    return [f"action_{name}" for name in columns(dataset.scenario.settings.command_fields)]


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()


def _require_whole(dataset: Dataset) -> None:
    if len(dataset) != dataset.manifest["counts"]["episodes"]:
        raise ValueError(
            f"{len(dataset)} of the {dataset.manifest['counts']['episodes']} episodes of {dataset.name} are no dataset "
            "yet: write them as one, under a name of its own (vvc_bench.datasets.store.write_dataset)"
        )
