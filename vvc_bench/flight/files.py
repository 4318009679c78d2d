"""Flights as files: CSV, Parquet, Tacview and a picture.

A file appears under its name only when it is whole: it is written under a temporary name in the same folder, read back,
and moved into place. Whatever goes wrong before that leaves an older file of that name as it was.
"""

import csv
import importlib.util
import json
import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.flight.acmi import acmi_text
from vvc_bench.flight.recording import Flight, table, table_fields, to_frame
from vvc_bench.sim import Conditions, Field, columns
from vvc_bench.sim.fields import Goal
from vvc_bench.version import __version__

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"  # W3C, Portable Network Graphics, section 5.2
_PNG_END = b"IEND\xaeB\x60\x82"


class FileFormat(NamedTuple):
    """How to write a flight in one format, and how to tell whether the file is whole."""

    write: Callable[[Flight, Path], None]
    is_whole: Callable[[Flight, Path], bool]
    module: str
    """The third-party module it takes; empty for none."""
    requirement: str = "vvc-bench"
    """What to install to have that module."""


def write_flight(flight: Flight, path: Path | str) -> Path:
    """Write a flight in the format that the file's name ends with: ``.csv``, ``.parquet``, ``.acmi`` or ``.png``.

    Args:
        flight: what to write.
        path: where; the folder is made if need be, and an older file of that name is replaced.

    Returns:
        The path.

    Raises:
        ValueError: for an unknown ending.
        ImportError: if the format takes an extra that is not installed; says which.
        OSError: if the folder cannot be made or written to, or what was written does not read back whole.
    """
    path = Path(path)
    chosen = find_format(path.suffix.removeprefix("."))
    write_whole(path, lambda place: chosen.write(flight, place), lambda place: chosen.is_whole(flight, place))
    return path


def write_whole(path: Path, write: Callable[[Path], None], is_whole: Callable[[Path], bool]) -> None:
    """Make or replace a file in one move, once ``write`` has written it elsewhere and ``is_whole`` agrees.

    Raises:
        OSError: if the folder cannot be made or written to, or ``is_whole`` says no. Nothing is left behind then.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.unfinished{path.suffix}")
    try:
        write(unfinished)
        if not is_whole(unfinished):
            raise OSError(f"{path} was not written: it does not read back as it should; is the disk full?")
        with unfinished.open("rb+") as file:
            os.fsync(file.fileno())
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def available_formats() -> list[str]:
    """The formats that can be written with what is installed."""
    return [name for name, known in FORMATS.items() if not known.module or importlib.util.find_spec(known.module)]


def find_format(name: str) -> FileFormat:
    """The format of that name.

    Raises:
        ValueError: if there is none.
        ImportError: if it takes an extra that is not installed; says which.
    """
    if name not in FORMATS:
        raise ValueError(f"unknown format {name!r}; choose from {', '.join(FORMATS)}")
    if name not in available_formats():
        known = FORMATS[name]
        raise ImportError(f"{name} files take {known.module}, which is missing: pip install {known.requirement}")
    return FORMATS[name]


def _same(expected: dict[str, NDArray[np.float64]], read: dict[str, NDArray[np.float64]]) -> bool:
    """Whether columns that were read back are those that were written, NaN for NaN."""
    return list(read) == list(expected) and all(
        np.array_equal(expected[name], read[name], equal_nan=True) for name in expected
    )


def _write_csv(flight: Flight, path: Path) -> None:
    to_frame(flight).to_csv(path, index=False)


def _csv_is_whole(flight: Flight, path: Path) -> bool:
    with path.open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    values = np.array([[float(cell or "nan") for cell in row] for row in rows])
    return _same(table(flight), dict(zip(names, values.T, strict=True)))


def _metadata(flight: Flight) -> dict[str, str]:
    """What a Parquet file says about itself: enough to fly the flight again."""
    settings: dict[str, str | float] = {
        "control_mode": flight.settings.control_mode,
        "dynamics": flight.settings.dynamics,
        "frequency_hz": flight.settings.frequency_hz,
    }
    values = {"settings": settings, "conditions": _outside(Conditions, flight.conditions[0])}
    if flight.goal is not None:
        values["goal"] = _outside(Goal, flight.goal)
    return {"vvc_bench_version": __version__} | {what: json.dumps(value) for what, value in values.items()}


def _outside(kind: type[tuple[float, ...]], row: NDArray[np.float64]) -> dict[str, str | float]:
    """Values of one of the simulator's classes by column name, in outside units."""
    known = columns(kind)
    return {name: float(value * known[name].unit.scale) for name, value in zip(known, row, strict=True)}


def _column_metadata(field: Field | None) -> dict[str, str]:
    if field is None:
        return {"unit": "s", "meaning": "time since the start"}
    return {"unit": field.unit.outside or field.unit.inside, "symbol": field.symbol, "meaning": field.meaning}


def _write_parquet(flight: Flight, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    known = [
        pa.field(name, pa.float64(), metadata=_column_metadata(field)) for name, field in table_fields(flight).items()
    ]
    pq.write_table(pa.table(table(flight), schema=pa.schema(known, metadata=_metadata(flight))), path)


def _parquet_is_whole(flight: Flight, path: Path) -> bool:
    import pyarrow.parquet as pq

    read = pq.read_table(path)
    return _same(table(flight), {name: read[name].to_numpy() for name in read.column_names})


def _write_acmi(flight: Flight, path: Path) -> None:
    path.write_text(acmi_text(flight), encoding="utf-8", newline="\n")


def _acmi_is_whole(flight: Flight, path: Path) -> bool:
    return path.read_text(encoding="utf-8") == acmi_text(flight)


def _write_png(flight: Flight, path: Path) -> None:
    from vvc_bench.flight.plot import plot

    plot(flight).savefig(path)


def _png_is_whole(_flight: Flight, path: Path) -> bool:
    content = path.read_bytes()
    return content.startswith(_PNG_SIGNATURE) and content.endswith(_PNG_END)


FORMATS = {
    "csv": FileFormat(_write_csv, _csv_is_whole, "pandas"),
    "parquet": FileFormat(_write_parquet, _parquet_is_whole, "pyarrow"),
    "acmi": FileFormat(_write_acmi, _acmi_is_whole, ""),
    "png": FileFormat(_write_png, _png_is_whole, "matplotlib", "vvc-bench[plot]"),
}
"""By name, which is also the ending of the file's name."""
