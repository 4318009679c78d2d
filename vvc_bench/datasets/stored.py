"""A dataset's folder, open: its manifest, and its two tables, read as they are asked for."""

import errno
import functools
import hashlib
import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.manifest import EPISODES, MANIFEST, TRANSITIONS, damaged, parse_manifest
from vvc_bench.datasets.parquet import OpenFile, Pieces, PiecewiseTable, read_whole
from vvc_bench.datasets.schema import (
    Values,
    arrays_of,
    episode_columns,
    episode_values,
    layout,
    transition_columns,
    transition_values,
)
from vvc_bench.rollout import Episodes, Scenario

PIECES = "transitions_pieces"
"""Note in the file of episodes: the pieces of the file of transitions (`vvc_bench.datasets.parquet.Pieces`)."""

_ATTEMPTS = 100


class StoredSet:
    """A set on disk. What was opened stays readable while another writer replaces the folder.

    Nothing but the manifest is read before it is asked for. Everything that is read is compared with its checksum.

    Args:
        folder: where it lies.

    Raises:
        FileNotFoundError: if there is no such folder.
        CorruptDataset: if a file is missing, is no plain file or has another size, or the manifest is not as it was
            written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files = _open_files(folder)
        manifest = self._files[MANIFEST]
        content = manifest.read(0, manifest.size)
        self.hash = hashlib.sha256(content).hexdigest()
        self.manifest: dict[str, Any] = parse_manifest(content, manifest.path)
        self.scenario = Scenario.from_json(self.manifest["scenario"])
        self.layout = layout(self.scenario)
        self.episode_columns = episode_columns(self.scenario)
        self.transition_columns = transition_columns(self.scenario)
        for name, entry in self.manifest["files"].items():
            file = self._files[name]
            if file.size != entry["bytes"]:
                raise damaged(file.path, f"has {file.size} bytes and should have {entry['bytes']}")

    @functools.cached_property
    def _episodes(self) -> tuple[Values, dict[str, str]]:
        file, entry = self._files[EPISODES], self.manifest["files"][EPISODES]
        values, notes = read_whole(file, entry["sha256"], self.episode_columns, entry["rows"])
        lengths = values["length"]
        if (lengths < 1).any() or lengths.sum() != self.manifest["counts"]["transitions"]:
            raise damaged(file.path, "has lengths that do not add up to the number of transitions")
        return values, notes

    @property
    def episodes(self) -> Values:
        """The table of episodes."""
        return self._episodes[0]

    @functools.cached_property
    def offsets(self) -> NDArray[np.int64]:
        """Row of each episode's first transition, and the number of transitions; shape (E + 1,)."""
        return np.concatenate([[0], np.cumsum(self.episodes["length"], dtype=np.int64)])

    @functools.cached_property
    def group_bounds(self) -> NDArray[np.int64]:
        """Row that each row group begins with, and the number of transitions."""
        _, first = np.unique(self.episodes["row_group"], return_index=True)
        return np.append(self.offsets[first], self.offsets[-1])

    @functools.cached_property
    def episode_arrays(self) -> dict[str, Any]:
        """What `Episodes` hold of each episode, read-only."""
        arrays = arrays_of(self.episodes, self.layout.episodes)
        for array in arrays.values():
            array.flags.writeable = False
        return arrays

    @functools.cached_property
    def transitions(self) -> PiecewiseTable:
        """The table of transitions, unread."""
        try:
            pieces = Pieces.from_text(self._episodes[1][PIECES])
        except (KeyError, ValueError):
            raise damaged(self._files[EPISODES].path, f"has no note {PIECES!r} that can be read") from None
        rows = self.manifest["files"][TRANSITIONS]["rows"]
        return PiecewiseTable(self._files[TRANSITIONS], pieces, self.transition_columns, rows)

    def verify(self) -> None:
        """Compare every byte of both files with their checksums.

        Raises:
            CorruptDataset: if one differs.
        """
        for name, entry in self.manifest["files"].items():
            self._files[name].verify(entry["sha256"])

    def check(self) -> Episodes:
        """Everything, read and verified, the columns that follow from others recomputed.

        Raises:
            CorruptDataset: if anything is not as it should be.
        """
        self.verify()
        transitions = self.transitions.read(list(self.transition_columns))
        arrays = arrays_of(transitions, self.layout.transitions)
        episodes = Episodes(self.scenario, offsets=self.offsets, **self.episode_arrays, **arrays)
        for file, stored, expected in (
            (EPISODES, self.episodes, episode_values(episodes)),
            (TRANSITIONS, transitions, transition_values(episodes)),
        ):
            for name, values in stored.items():
                if not same_bits(values, expected[name]):
                    raise damaged(self.folder / file, f"has a column {name!r} that does not follow from the others")
        return episodes


def same_bits(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether two arrays hold the same, −0 apart from 0 and NaN equal to the same NaN."""
    if first.dtype.kind == "U":
        return np.array_equal(first, second)
    if first.dtype != second.dtype or first.shape != second.shape:
        return False
    bits = f"u{first.dtype.itemsize}"
    return np.array_equal(np.ascontiguousarray(first).view(bits), np.ascontiguousarray(second).view(bits))


def _open_files(folder: Path) -> dict[str, OpenFile]:
    """The set's files, all of one set although a writer may be replacing the folder."""
    for _ in range(_ATTEMPTS):
        directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            return {name: _open_plain(directory, folder / name) for name in (MANIFEST, EPISODES, TRANSITIONS)}
        except FileNotFoundError as error:
            if os.path.samestat(os.fstat(directory), folder.stat()):
                raise damaged(folder, f"has no file {error.filename!r}") from None
        finally:
            os.close(directory)
    raise damaged(folder, "is being replaced all the time")


def _open_plain(directory: int, path: Path) -> OpenFile:
    """A file of a folder, if it is one: links and pipes are refused."""
    try:
        descriptor = os.open(path.name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=directory)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise damaged(path, "is a link") from None
        raise
    file = OpenFile(descriptor, path)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        raise damaged(path, "is no plain file")
    return file
