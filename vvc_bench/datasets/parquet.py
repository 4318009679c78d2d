"""Parquet files whose every byte is compared with a recorded checksum before it is decoded.

Parquet's own page checksums, which are written and verified too, cover neither page headers nor footers. So a file is
taken as a row of pieces (its first bytes, each chunk of a column, its footer) with a CRC-32 each, kept elsewhere: then
a column or a row group can be read alone, and nothing that was changed reaches the decoder.
"""

import bisect
import contextlib
import functools
import hashlib
import io
import itertools
import os
import threading
import weakref
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.manifest import CorruptDataset, damaged
from vvc_bench.datasets.schema import Column, Values, arrow_schema
from vvc_bench.sim.parallel import available_threads

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

_MAGIC = 4  # bytes of "PAR1", which a file begins with
_BLOCK = 1 << 20
_GROUPS_OF_A_THREAD = 2  # so few row groups are decoded sooner than a thread for them is started


class Pieces(NamedTuple):
    """A file in P pieces, without gaps; the last is the footer."""

    bounds: tuple[int, ...]
    """Where each piece begins, and the file's size: P + 1."""
    checksums: tuple[int, ...]
    """P of them."""

    def to_text(self) -> str:
        """As hexadecimal digits."""
        return np.array([np.diff(self.bounds), self.checksums], dtype="<u4").tobytes().hex()

    @classmethod
    def from_text(cls, text: str) -> "Pieces":
        """Pieces that `to_text` wrote.

        Raises:
            ValueError: if it was not that.
        """
        sizes, checksums = np.frombuffer(bytes.fromhex(text), dtype="<u4").reshape(2, -1).tolist()
        return cls(tuple(itertools.accumulate(sizes, initial=0)), tuple(checksums))


def write_parquet(
    path: Path, known: Mapping[str, Column], values: Values, bounds: Sequence[int], notes: Mapping[str, str]
) -> None:
    """Write a table.

    Args:
        path: where.
        known: its columns, in order.
        values: their values.
        bounds: where each row group begins, and the number of rows.
        notes: metadata of the file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = arrow_schema(known).with_metadata(dict(notes))
    table = pa.table([pa.array(values[name], type=schema.field(name).type) for name in known], schema=schema)
    dictionary = [name for name, column in known.items() if column.few_values]
    split = {name: "BYTE_STREAM_SPLIT" for name, column in known.items() if column.type in ("float32", "float64")}
    counted = {name: "DELTA_BINARY_PACKED" for name, column in known.items() if column.type in ("int32", "int64")}
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        compression_level=3,
        use_dictionary=dictionary,
        column_encoding={name: way for name, way in (split | counted).items() if name not in dictionary},
        write_statistics=["episode"],
        write_page_checksum=True,
    ) as writer:
        for start, stop in itertools.pairwise(bounds):
            writer.write_table(table.slice(start, stop - start), row_group_size=max(stop - start, 1))


def cut(path: Path) -> Pieces:
    """The pieces of a file that was just written."""
    import pyarrow.parquet as pq

    footer = pq.read_metadata(path)
    groups = (footer.row_group(i) for i in range(footer.num_row_groups))
    sizes = [group.column(j).total_compressed_size for group in groups for j in range(group.num_columns)]
    bounds = (*itertools.accumulate([_MAGIC, *sizes], initial=0), path.stat().st_size)
    content = memoryview(path.read_bytes())
    return Pieces(bounds, tuple(zlib.crc32(content[start:stop]) for start, stop in itertools.pairwise(bounds)))


class OpenFile:
    """A file, open for reading; it stays readable where its folder is replaced or deleted.

    Args:
        descriptor: of the file; closed when this is no longer used.
        path: for messages.
    """

    def __init__(self, descriptor: int, path: Path) -> None:
        weakref.finalize(self, os.close, descriptor)
        self._descriptor = descriptor
        self.path = path
        self.size = os.fstat(descriptor).st_size

    def read(self, start: int, stop: int) -> bytes:
        """Bytes start ≤ i < stop.

        Raises:
            CorruptDataset: if the file ends before.
        """
        parts = []
        while start < stop:
            parts.append(os.pread(self._descriptor, stop - start, start))
            if not parts[-1]:
                raise damaged(self.path, "ends early")
            start += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def verify(self, sha256: str) -> None:
        """Read everything.

        Raises:
            CorruptDataset: if a byte differs.
        """
        digest = hashlib.sha256()
        for start in range(0, self.size, _BLOCK):
            digest.update(self.read(start, min(start + _BLOCK, self.size)))
        if digest.hexdigest() != sha256:
            raise damaged(self.path, "differs from its checksum")


class _Checked(io.RawIOBase):
    """An open file as Arrow reads it: piece by piece, and only what agrees with its checksum is handed over."""

    def __init__(self, file: OpenFile, pieces: Pieces) -> None:
        self._file = file
        self._pieces = pieces
        self._at = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._file.size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def read(self, size: int = -1) -> bytes:
        start, stop = self._at, self._file.size if size < 0 else min(self._at + size, self._file.size)
        self._at = max(stop, start)
        if start >= stop:
            return b""
        bounds, checksums = self._pieces
        first, last = bisect.bisect_right(bounds, start) - 1, bisect.bisect_left(bounds, stop)
        origin = bounds[first]
        content = self._file.read(origin, bounds[last])
        view = memoryview(content)
        for k in range(first, last):
            if zlib.crc32(view[bounds[k] - origin : bounds[k + 1] - origin]) != checksums[k]:
                where = f"between bytes {bounds[k]} and {bounds[k + 1]}"
                raise damaged(self._file.path, f"differs from its checksum {where}")
        return content[start - origin : stop - origin]


class PiecewiseTable:
    """A Parquet file of which columns and row groups are read alone, and checked alone.

    Args:
        file: the file.
        pieces: how it was cut when it was written.
        known: the columns that it should have.
        rows: how many rows it should have.
    """

    def __init__(self, file: OpenFile, pieces: Pieces, known: Mapping[str, Column], rows: int) -> None:
        self._file = file
        self._pieces = pieces
        self._known = known
        self._rows = rows
        self._of_thread = threading.local()

    @functools.cached_property
    def _footer(self) -> "pq.FileMetaData":
        import pyarrow as pa
        import pyarrow.parquet as pq

        if self._pieces.bounds[-1] != self._file.size:
            raise damaged(self._file.path, "has other pieces than are listed")
        last = _Checked(self._file, self._pieces)
        last.seek(self._pieces.bounds[-2])
        with _decoding(self._file):
            footer = pq.read_metadata(pa.BufferReader(last.read()))
        _require(self._file, footer.schema.to_arrow_schema(), footer.num_rows, self._known, self._rows)
        return footer

    def read(self, names: Sequence[str], groups: Sequence[int] | None = None) -> Values:
        """Columns, of all row groups or of some in the order given; the arrays may be read-only.

        Raises:
            CorruptDataset: if what is read is not what was written.
        """
        import pyarrow as pa

        chosen = list(range(self._footer.num_row_groups) if groups is None else groups)
        count = min(available_threads(), -(-len(chosen) // _GROUPS_OF_A_THREAD)) or 1
        parts = [chosen[len(chosen) * k // count : len(chosen) * (k + 1) // count] for k in range(count)]
        with _decoding(self._file):
            if count == 1:
                return _arrays(self._read_groups(names, chosen), names)
            with ThreadPoolExecutor(count) as pool:
                tables = list(pool.map(functools.partial(self._read_groups, names), parts))
            return _arrays(pa.concat_tables(tables), names)

    def _read_groups(self, names: Sequence[str], groups: Sequence[int]) -> "pa.Table":
        """Some row groups, in this thread.

        Arrow's own threads let go of Python's bytes late, and abort a process that is ending then (apache/arrow#34314).
        """
        return self._reader.read_row_groups(groups, columns=list(names), use_threads=False)

    @property
    def _reader(self) -> "pq.ParquetFile":
        """Arrow's reader, kept for each thread: making one takes a tenth of the time of reading a trajectory."""
        import pyarrow.parquet as pq

        if not hasattr(self._of_thread, "reader"):
            checked = _Checked(self._file, self._pieces)
            self._of_thread.reader = pq.ParquetFile(checked, metadata=self._footer, page_checksum_verification=True)
        return self._of_thread.reader


def read_whole(file: OpenFile, sha256: str, known: Mapping[str, Column], rows: int) -> tuple[Values, dict[str, str]]:
    """A small table, all of it, and the notes of its file.

    Raises:
        CorruptDataset: if it is not what was written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = file.read(0, file.size)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise damaged(file.path, "differs from its checksum")
    with _decoding(file):
        # in this thread, as in `PiecewiseTable`
        table = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True).read(use_threads=False)
    _require(file, table.schema, table.num_rows, known, rows)
    notes = {name.decode(): note.decode() for name, note in (table.schema.metadata or {}).items()}
    return _arrays(table, list(known)), notes


def _require(file: OpenFile, schema: "pa.Schema", rows: int, known: Mapping[str, Column], expected_rows: int) -> None:
    expected = arrow_schema(known)
    if schema.names != expected.names or schema.types != expected.types:
        raise damaged(file.path, f"has other columns: {', '.join(schema.names)} in place of {', '.join(known)}")
    if rows != expected_rows:
        raise damaged(file.path, f"has {rows} rows and should have {expected_rows}")


@contextlib.contextmanager
def _decoding(file: OpenFile) -> Iterator[None]:
    """Say which file it was that could not be decoded."""
    import pyarrow as pa

    try:
        yield
    except CorruptDataset:
        raise
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise damaged(file.path, f"cannot be decoded ({error})") from error


def _arrays(table: "pa.Table", names: Sequence[str]) -> Values:
    return {name: _array(table[name].to_numpy()) for name in names}


def _array(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.str_) if values.dtype == object else values
