"""Datasets on disk: a folder with a manifest, a table of episodes and a table of transitions."""

import hashlib
from pathlib import Path

import numpy as np

from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.folders import replaced_folder
from vvc_bench.datasets.manifest import (
    EPISODES,
    MANIFEST,
    TRANSITIONS,
    CorruptDataset,
    Description,
    manifest_text,
)
from vvc_bench.datasets.parquet import cut, write_parquet
from vvc_bench.datasets.schema import (
    episode_columns,
    episode_values,
    layout,
    transition_columns,
    transition_values,
)
from vvc_bench.datasets.stored import PIECES, StoredSet, same_bits
from vvc_bench.rollout import Episodes

__all__ = ["CorruptDataset", "Description", "open_dataset", "write_dataset"]


def open_dataset(folder: Path | str) -> Dataset:
    """Open a set; only its manifest is read.

    Raises:
        FileNotFoundError: if there is no such folder.
        CorruptDataset: if it holds no set, or a damaged one.
    """
    return Dataset(StoredSet(Path(folder)))


def write_dataset(folder: Path | str, episodes: Episodes, description: Description) -> Path:
    """Write a set: the same flights and description give the same bytes.

    It is written beside its place, read back, compared bit for bit and then moved into place in one step, so that
    readers have the old set or the new one, whatever happens.

    Args:
        folder: where; a set that is there is replaced, anything else is not.
        episodes: the flights.
        description: what is to be said of them.

    Returns:
        The folder.

    Raises:
        TypeError: if the description is no JSON document.
        ValueError: for arrays of other types or shapes than `Episodes` says.
        FileExistsError: if there is something else than a set.
        OSError: if it cannot be written, as with a full disk. The old set stays.
    """
    folder = Path(folder)
    _require_layout(episodes)
    transitions, table = transition_values(episodes), episode_values(episodes)
    _, firsts = np.unique(table["row_group"], return_index=True)
    bounds = [*episodes.offsets[firsts].tolist(), len(episodes.rewards)]
    with replaced_folder(folder, MANIFEST) as place:
        write_parquet(place / TRANSITIONS, transition_columns(episodes.scenario), transitions, bounds, {})
        notes = {PIECES: cut(place / TRANSITIONS).to_text()}
        write_parquet(place / EPISODES, episode_columns(episodes.scenario), table, [0, len(episodes)], notes)
        files = {
            EPISODES: _file_entry(place / EPISODES, len(episodes)),
            TRANSITIONS: _file_entry(place / TRANSITIONS, len(episodes.rewards)),
        }
        text = manifest_text(description, episodes, transitions, files)
        (place / MANIFEST).write_text(text, encoding="utf-8", newline="\n")
        _require_same(StoredSet(place).check(), episodes)
    return folder


def _file_entry(path: Path, rows: int) -> dict[str, str | int]:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"sha256": digest, "bytes": path.stat().st_size, "rows": rows}


def _require_layout(episodes: Episodes) -> None:
    """Refuse arrays that the tables cannot hold as they are."""
    if (episodes.lengths < 1).any() or episodes.offsets.dtype != np.int64:
        raise ValueError(f"offsets must be rising int64, got {episodes.offsets!r}")
    stored, known = layout(episodes.scenario), transition_columns(episodes.scenario)
    known |= episode_columns(episodes.scenario)
    expected = [(int(episodes.offsets[-1]), *item) for item in stored.transitions.items()]
    expected += [(len(episodes), *item) for item in stored.episodes.items()]
    for rows, attribute, names in expected:
        array, kind = getattr(episodes, attribute), np.dtype(known[names[0]].type).type
        shape = (rows,) if len(names) == 1 else (rows, len(names))
        if array.shape != shape or array.dtype.type is not kind:
            raise ValueError(f"{attribute} must be {kind.__name__} {shape}, got {array.dtype} {array.shape}")


def _require_same(read: Episodes, written: Episodes) -> None:
    stored = layout(written.scenario)
    for name in ("offsets", *stored.episodes, *stored.transitions):
        if not same_bits(getattr(read, name), getattr(written, name)):
            raise OSError(f"nothing was written: {name} does not read back as it should; is the disk full?")
