"""The only door to OpenML: tables down, tables up, through the ``openml`` package (``vvc-bench[openml]``).

Its server, its API key and its number of attempts are what the user has configured there. The cache is ours.
"""

import hashlib
import importlib
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from vvc_bench.datasets.download import BrokenPromiseError, stated, without_secrets

_ATTEMPTS = 3
_MD5 = re.compile(r'"([0-9a-f]{32})"')


def fetch_table(openml_id: int, cache: Path, *, progress: bool = True) -> pa.Table:
    """Download a dataset's table: its Parquet file, or its ARFF file where there is none.

    Args:
        openml_id: its number on OpenML.
        cache: a folder for what comes; it is emptied afterwards.
        progress: whether a bar is drawn, if stderr is a terminal.

    Raises:
        ImportError: without the ``openml`` package; says what to install.
        FileNotFoundError: if there is no such dataset.
        PermissionError: if it is private.
        OSError: if it cannot be had, or what comes does not have the length and checksum that the server states.
    """
    openml = _import("openml")
    try:
        for attempt in range(_ATTEMPTS):
            try:
                with _configured(openml, cache, progress), _plain_errors(openml, openml_id):
                    return _read(openml.datasets.get_dataset(openml_id, download_data=True))
            except BrokenPromiseError:
                shutil.rmtree(cache, ignore_errors=True)
                if attempt == _ATTEMPTS - 1:
                    raise
    finally:
        shutil.rmtree(cache, ignore_errors=True)
    raise AssertionError  # not reached


def upload_table(table: pa.Table, description: Mapping[str, Any], cache: Path) -> int:
    """Put a table on OpenML under the configured API key.

    Args:
        table: numbers, no nulls.
        description: what `openml.OpenMLDataset` takes, besides the data.
        cache: a folder for the package's files.

    Returns:
        Its number there.

    Raises:
        ImportError: without the ``openml`` package.
        PermissionError: without an API key, or with one that the server does not know.
        OSError: if the server does not take it.
    """
    openml = _import("openml")
    if not openml.config.apikey:
        raise PermissionError(
            "publishing on OpenML takes an API key (openml.org, your profile): run "
            "`openml configure apikey`, or set openml.config.apikey"
        )
    with _configured(openml, cache, progress=False), _plain_errors(openml, description["name"]):
        entry = openml.datasets.OpenMLDataset(data_format="arff", dataset=arff_text(table), **description)
        return int(entry.publish().dataset_id)


def read_arff(path: Path) -> pa.Table:
    """An ARFF file with dense rows.

    Raises:
        ValueError: if it is none.
    """
    arff = _import("arff")
    header, length = [], 0
    with path.open("rb") as file:
        for line in file:
            length += len(line)
            header.append(line.decode("utf-8"))
            if line.strip().lower() == b"@data":
                break
        else:
            raise ValueError(f"{path} has no @DATA: it is no ARFF file")
        try:
            names = [name for name, _ in arff.loads("".join(header))["attributes"]]
        except arff.ArffException as fault:
            raise ValueError(f"{path} is no ARFF file: {fault}") from fault
        return pa.csv.read_csv(
            file,
            read_options=pa.csv.ReadOptions(column_names=names),
            parse_options=pa.csv.ParseOptions(quote_char="'", escape_char="\\"),
            convert_options=pa.csv.ConvertOptions(null_values=["?"]),
        )


def arff_text(table: pa.Table) -> str:
    """A table of numbers as an ARFF file's content; they are written so that they read back as the same."""
    kinds = {field.name: "REAL" if pa.types.is_floating(field.type) else "INTEGER" for field in table.schema}
    header = [f"@ATTRIBUTE {name} {kind}" for name, kind in kinds.items()]
    rows = pa.BufferOutputStream()
    pa.csv.write_csv(table, rows, pa.csv.WriteOptions(include_header=False, quoting_style="none"))
    return "\n".join(["@RELATION vvc-bench", *header, "@DATA", rows.getvalue().to_pybytes().decode()])


def _import(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        raise ImportError(
            f"OpenML takes the package {module}, which is missing: pip install 'vvc-bench[openml]'"
        ) from fault


@contextmanager
def _configured(openml: Any, cache: Path, progress: bool) -> Iterator[None]:
    """With our cache in place of the user's."""
    users = openml.config.get_config_as_dict()
    cache.mkdir(parents=True, exist_ok=True)
    openml.config.set_root_cache_directory(cache)
    openml.config.show_progress = progress and sys.stderr is not None and sys.stderr.isatty()
    try:
        yield
    finally:
        openml.config.set_root_cache_directory(users["cachedir"])
        openml.config.show_progress = users["show_progress"]


@contextmanager
def _plain_errors(openml: Any, what: object) -> Iterator[None]:
    """The errors of the package, and of those under it, as Python's own."""
    faults, urllib3, minio, requests = openml.exceptions, *map(_import, ("urllib3", "minio", "requests"))
    place = without_secrets(openml.config.server)
    try:
        yield
    except faults.OpenMLServerNoResult as fault:
        raise FileNotFoundError(f"{place} has no dataset {what}: {fault.message}") from fault
    except (faults.OpenMLPrivateDatasetError, faults.OpenMLNotAuthorizedError) as fault:
        raise PermissionError(f"{place} does not give access to dataset {what}: {fault.message}") from fault
    except faults.OpenMLHashException as fault:
        raise BrokenPromiseError(f"dataset {what} from {place} is damaged: {fault}") from fault
    except (urllib3.exceptions.ProtocolError, requests.exceptions.ChunkedEncodingError) as fault:
        raise BrokenPromiseError(f"dataset {what} from {place} broke off: {fault}") from fault
    except (
        faults.PyOpenMLError,
        urllib3.exceptions.HTTPError,
        requests.exceptions.RequestException,
        minio.error.MinioException,
        ExpatError,
    ) as fault:
        raise OSError(f"dataset {what} could not be had from {place}: {fault}") from fault


def _read(dataset: Any) -> pa.Table:
    if dataset.parquet_file is None:
        return read_arff(Path(dataset.data_file))
    path = Path(dataset.parquet_file)
    _check_against_server(dataset._parquet_url, path)
    return pa.parquet.read_table(path, page_checksum_verification=True)


def _check_against_server(url: str, path: Path) -> None:
    """What the package leaves out for Parquet files: length, and MD5 where the object store's ETag is one."""
    length, version = stated(url)
    if length is not None and length != path.stat().st_size:
        raise BrokenPromiseError(f"{without_secrets(url)} has {length} bytes, {path.stat().st_size} came")
    digest = _MD5.fullmatch(version)
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "md5").hexdigest()
    if digest and digest[1] != found:
        raise BrokenPromiseError(f"{without_secrets(url)} has MD5 {digest[1]}, what came has {found}")
