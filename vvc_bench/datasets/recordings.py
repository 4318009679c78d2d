"""Flights that the paper's public code wrote down, as it wrote them.

Its scripts (github.com/GongXudong/fly-craft-examples, ``demonstrations/``) write one CSV file for each flight that
reached its goal, ``traj_200_10_-30.csv`` for the goal (200 m/s, 10°, −30°), with the columns ``time``, eight states
``s_*``, three actions ``a_*`` and ``a_rud``, and one index ``res.csv`` with ``v, mu, chi, length`` of every goal flown,
length 0 where the flight failed. The columns of the eight sets on OpenML are documented nowhere; these flights one
after another in one table, with or without goals, are read here too. Anything else is refused.
"""

import io
import re
import stat
import tarfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from vvc_bench.goals import checked_goals

STATES = ("s_phi", "s_theta", "s_psi", "s_v", "s_mu", "s_chi", "s_p", "s_h")
"""The public code's names of `Observation`'s fields, in order, in the same units."""

ACTIONS = ("a_p", "a_nz", "a_pla")
"""Of `GuidanceCommand`'s. ``a_rud``, which its control law ignores, is left out."""

GOALS = (("target_v", "target_mu", "target_chi"), ("goal_v", "goal_mu", "goal_chi"), ("v", "mu", "chi"))
"""Names that the public code has for a goal, in its logs, its settings and its index."""

TIME = "time"
INDEX = "res.csv"

LARGEST_BYTES = 20 * 10**9
"""Of an archive's files, unpacked."""

_MOST_FILES = 1_000_000
_NUMBER = r"(-?\d+(?:\.\d+)?)"
_FLIGHT_FILE = re.compile(rf"\w*?_{_NUMBER}_{_NUMBER}_{_NUMBER}\.csv")
_TIME_TOLERANCE = 0.011  # s; the public code rounds times to 0.01


class UnknownLayoutError(ValueError):
    """What was found is none of the layouts that can be read."""


@dataclass(frozen=True)
class Recordings:
    """E flights with N rows in all, as they were written down.

    Args:
        goals: shape (E, 3), in outside units; None where they were not written down.
        offsets: shape (E + 1,).
        states: shape (N, 8), in outside units.
        actions: shape (N, 3), in outside units.
        frequency_hz: rows per second; None where there are no times.
        goals_flown: shape (G, 3): all goals that were tried, in outside units; None where there is no index.
        notes: what else a reader should know, by name.
    """

    goals: NDArray[np.float64] | None
    offsets: NDArray[np.int64]
    states: NDArray[np.float64]
    actions: NDArray[np.float64]
    frequency_hz: float | None
    goals_flown: NDArray[np.float64] | None
    notes: Mapping[str, Any]


def read_recordings(path: Path) -> Recordings:
    """Flights from a folder or an archive (zip, tar) of CSV files, or from one table (CSV, Parquet).

    Nothing of an archive is unpacked onto the disk.

    Raises:
        UnknownLayoutError: if there are other columns or files than the public code's; says what was found.
        ValueError: for values that are no numbers, or an archive with members that point elsewhere or are too large.
        OSError: if it cannot be read.
    """
    if path.is_dir():
        return _read_flights(str(path), ((file.name, file.read_bytes()) for file in sorted(path.rglob("*.csv"))))
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            return _read_flights(str(path), _zip_members(archive))
    if path.suffix == ".parquet":
        return read_table(pa.parquet.read_table(path, page_checksum_verification=True))
    if tarfile.is_tarfile(path):
        with tarfile.open(path) as tape:
            return _read_flights(str(path), _tar_members(tape))
    return read_table(pa.csv.read_csv(path))


def read_table(table: pa.Table) -> Recordings:
    """Flights one after another: a new one where time restarts or the goal changes.

    Raises:
        UnknownLayoutError: if columns are missing; says what was found.
        ValueError: for values that are no numbers, or times with gaps.
    """
    goal_names = next((names for names in GOALS if set(names) <= set(table.column_names)), None)
    timed = TIME in table.column_names
    if not {*STATES, *ACTIONS} <= set(table.column_names) or not (timed or goal_names) or not table.num_rows:
        raise UnknownLayoutError(_what_was_found(table))
    states, actions = _numbers(table, STATES), _numbers(table, ACTIONS)
    time = _numbers(table, (TIME,))[:, 0] if timed else None
    goals = _numbers(table, goal_names) if goal_names else None
    offsets = _cut(table.num_rows, time, goals)
    return Recordings(
        goals=None if goals is None else checked_goals(goals[offsets[:-1]]),
        offsets=offsets,
        states=states,
        actions=actions,
        frequency_hz=None if time is None else _frequency(time, offsets),
        goals_flown=None,
        notes={"layout": "one table", "columns": list(table.column_names)},
    )


def _cut(rows: int, time: NDArray[np.float64] | None, goals: NDArray[np.float64] | None) -> NDArray[np.int64]:
    """Where flights begin, and the number of rows."""
    new = np.zeros(rows, dtype=np.bool_)
    new[0] = True
    if time is not None:
        new[1:] |= np.diff(time) <= 0.0
    if goals is not None:
        new[1:] |= (np.diff(goals, axis=0) != 0.0).any(axis=1)
    return np.append(np.flatnonzero(new), rows)


def _frequency(time: NDArray[np.float64], offsets: NDArray[np.int64]) -> float | None:
    """Rows per second; None where no flight has two.

    Raises:
        ValueError: if times have gaps.
    """
    steps = np.diff(time)
    inside = np.ones(len(steps), dtype=np.bool_)
    inside[offsets[1:-1] - 1] = False
    if not inside.any():
        return None
    step = float(np.median(steps[inside]))
    gaps = np.flatnonzero(inside & (np.abs(steps - step) > _TIME_TOLERANCE))
    if len(gaps):
        row = int(gaps[0])
        raise ValueError(
            f"rows are {step:g} s apart, but {TIME} goes from {time[row]:g} to {time[row + 1]:g} in row {row + 1}"
        )
    return round(1.0 / step, 2)


def _numbers(table: pa.Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Columns as one array, shape (N, len(names)).

    Raises:
        ValueError: for values that are missing or no finite numbers.
    """
    values = np.empty((table.num_rows, len(names)))
    for k, name in enumerate(names):
        column = table[name]
        try:
            values[:, k] = column.cast(pa.float64()).to_numpy()
        except pa.ArrowInvalid as fault:
            raise ValueError(f"column {name} has a value that is no number: {fault}") from fault
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, k = bad[0]
        raise ValueError(
            f"column {names[k]} has {table[names[k]][int(row)]} in row {row}, where a finite number must be"
        )
    return values


def _read_flights(place: str, files: Iterator[tuple[str, bytes]]) -> Recordings:
    """One CSV file for each flight, its goal in its name, and an index if there is one."""
    flights: list[Recordings] = []
    goals: list[tuple[float, ...]] = []
    index: NDArray[np.float64] | None = None
    others: list[str] = []
    for name, content in files:
        named = _FLIGHT_FILE.fullmatch(name)
        if name == INDEX:
            index = _read_index(content)
        elif named:
            flights.append(_read_flight(name, content))
            goals.append(tuple(float(number) for number in named.groups()))
        else:
            others.append(name)
    if not flights:
        raise UnknownLayoutError(
            f"{place} has no file named like traj_200_10_-30.csv, for the goal (200 m/s, 10°, −30°); "
            f"found {_some([*([] if index is None else [INDEX]), *others]) or 'no CSV file'}"
        )
    frequencies = sorted({flight.frequency_hz for flight in flights if flight.frequency_hz is not None})
    if len(frequencies) > 1:
        raise ValueError(f"{place} mixes flights of {_some([f'{each:g} Hz' for each in frequencies])}")
    lengths = np.array([len(flight.states) for flight in flights])
    return Recordings(
        goals=checked_goals(goals),
        offsets=np.concatenate([[0], np.cumsum(lengths)]),
        states=np.concatenate([flight.states for flight in flights]),
        actions=np.concatenate([flight.actions for flight in flights]),
        frequency_hz=frequencies[0] if frequencies else None,
        goals_flown=None if index is None else checked_goals(index[:, :-1]),
        notes={
            "layout": "one file for each flight",
            "index": None if index is None else _compared(index, dict(zip(goals, lengths.tolist(), strict=True))),
        },
    )


def _read_flight(name: str, content: bytes) -> Recordings:
    try:
        flight = read_table(pa.csv.read_csv(io.BytesIO(content)))
    except (UnknownLayoutError, ValueError) as fault:
        raise type(fault)(f"{name}: {fault}") from fault
    if len(flight.offsets) != 2:
        raise ValueError(f"{name}: {TIME} restarts in row {flight.offsets[1]}; there must be one flight in a file")
    return flight


def _read_index(content: bytes) -> NDArray[np.float64]:
    """Goals flown, and how many rows each flight has, 0 where it failed; shape (G, 4)."""
    table = pa.csv.read_csv(io.BytesIO(content))
    names = (*GOALS[-1], "length")
    if not set(names) <= set(table.column_names):
        raise UnknownLayoutError(f"{INDEX} must have columns {', '.join(names)}; it has {_some(table.column_names)}")
    return _numbers(table, names)


def _compared(index: NDArray[np.float64], lengths: Mapping[tuple[float, ...], int]) -> dict[str, int]:
    """What the index says, and where the files, which count, say otherwise."""
    stated = {tuple(goal): int(length) for *goal, length in index.tolist() if length > 0}
    return {
        "goals": len(index),
        "reached": len(stated),
        "without_a_file": len(stated.keys() - lengths.keys()),
        "of_another_length": sum(lengths[goal] != stated[goal] for goal in stated.keys() & lengths.keys()),
    }


def _zip_members(archive: zipfile.ZipFile) -> Iterator[tuple[str, bytes]]:
    members = [member for member in archive.infolist() if not member.is_dir()]
    _check_members([(member.filename, member.file_size, _points_elsewhere(member)) for member in members])
    for member in members:
        if member.filename.endswith(".csv"):
            with archive.open(member) as file:
                yield PurePosixPath(member.filename).name, _read_member(file, member.filename, member.file_size)


def _points_elsewhere(member: zipfile.ZipInfo) -> bool:
    mode = member.external_attr >> 16
    return stat.S_IFMT(mode) not in (0, stat.S_IFREG)


def _tar_members(archive: tarfile.TarFile) -> Iterator[tuple[str, bytes]]:
    members = [member for member in archive.getmembers() if not member.isdir()]
    _check_members([(member.name, member.size, not member.isfile()) for member in members])
    for member in members:
        file = archive.extractfile(member)
        if member.name.endswith(".csv") and file is not None:
            yield PurePosixPath(member.name).name, _read_member(file, member.name, member.size)


def _check_members(members: list[tuple[str, int, bool]]) -> None:
    """Refuse an archive whose members are not plain files inside of it, or are too many or too large."""
    for name, _, points_elsewhere in members:
        if points_elsewhere:
            raise ValueError(f"the archive's member {name!r} is a link or a device; only files are taken")
        if ".." in PurePosixPath(name).parts or "\\" in name or PureWindowsPath(name).anchor or name.startswith("/"):
            raise ValueError(f"the archive's member {name!r} points out of the archive; such an archive is not read")
    total = sum(size for _, size, _ in members)
    if len(members) > _MOST_FILES or total > LARGEST_BYTES:
        raise ValueError(
            f"the archive has {len(members)} files of {total} bytes in all; "
            f"at most {_MOST_FILES} files of {LARGEST_BYTES} bytes are read"
        )


def _read_member(file: IO[bytes], name: str, size: int) -> bytes:
    content = file.read(size + 1)
    if len(content) != size:
        raise ValueError(f"the archive's member {name!r} does not have the {size} bytes that the archive states")
    return content


def _what_was_found(table: pa.Table) -> str:
    first = ", ".join(f"{name}={table[name][0]}" for name in table.column_names[:20]) if table.num_rows else "none"
    goals = " or ".join(", ".join(names) for names in GOALS)
    return (
        f"these {table.num_rows} rows are in no known layout. Found columns: {_some(table.column_names)}; "
        f"first row: {first}. Needed: {', '.join((*STATES, *ACTIONS))}, and {TIME} or a goal ({goals})"
    )


def _some(names: list[str]) -> str:
    return ", ".join(names[:30]) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
