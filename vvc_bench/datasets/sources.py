"""Where datasets come from: a folder, the copies on this machine, the recipe, a mirror, OpenML.

`load_dataset` is the only way in; what it returns has been verified. The environment variables ``VVC_BENCH_MIRROR`` (a
URL or a folder) and ``VVC_BENCH_OFFLINE=1`` say where else to look, and that the network is not to be used.
"""

import difflib
import functools
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from vvc_bench.datasets.catalogue import CATALOGUE, Specification
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.download import without_secrets
from vvc_bench.datasets.local import check_copy, checked_name, datasets_folder, one_at_a_time, set_aside
from vvc_bench.datasets.manifest import MANIFEST
from vvc_bench.datasets.progress import progress_line
from vvc_bench.datasets.remote import fetch_dataset, is_local
from vvc_bench.datasets.store import CorruptDataset, open_dataset

BUILD, OPENML = "build", "openml"
"""Values of ``source`` that are no mirror."""

_ON_OPENML = re.compile(r"openml-([1-9]\d{0,9})")


class _Way(NamedTuple):
    """One way to come by a dataset."""

    label: str
    make: Callable[[Path], None]
    """Makes the folder, in one move at the end."""
    needs_network: bool = False


def load_dataset(
    name_or_path: str | Path, *, source: str | None = None, offline: bool | None = None, progress: bool = True
) -> Dataset:
    """Open a dataset; where this machine has no whole copy, make or fetch one first.

    A copy that is damaged is never opened: it is set aside, and made or fetched again. Of several processes that want
    the same dataset, one makes it and the others wait.

    Args:
        name_or_path: a name of the catalogue (``"pid-v0"``), one that a mirror knows, a dataset on OpenML
            (``"openml-46012"``), or a path to a folder.
        source: where a dataset that is not on this machine comes from: ``"build"``, ``"openml"`` (for a name of the
            catalogue, the paper's set that it stands for, as ``openml-…``), or a mirror, as a URL or a folder. By
            default it is built if it has a recipe, else taken from ``VVC_BENCH_MIRROR``, else from OpenML.
        offline: whether to do without the network; by default what ``VVC_BENCH_OFFLINE`` says.
        progress: whether a line shows how far it has come, if stderr is a terminal.

    Raises:
        ValueError: for an unknown name; says which are known.
        CorruptDataset: for a damaged one that can be neither made nor fetched again, or under a path.
        OSError: if it cannot be had; says what was tried.
        ImportError: if OpenML is needed and its package is missing.
    """
    if _is_path(name_or_path):
        return _open_folder(Path(name_or_path).expanduser())
    name = checked_name(str(name_or_path))
    if source == OPENML:
        name = _name_on_openml(name)
    folder = datasets_folder() / name
    if _fault(folder) is not None:
        _obtain(name, folder, _ways(name, source, _is_offline(offline), progress))
    return open_dataset(folder)


def known_names() -> list[str]:
    """Names that `load_dataset` takes, besides those of a mirror: the catalogue's, and the paper's sets on OpenML."""
    published = [specification.published for specification in CATALOGUE.values()]
    return [*CATALOGUE, *(f"openml-{each.openml_id}" for each in published if each)]


def _is_path(name_or_path: str | Path) -> bool:
    separators = tuple(filter(None, (os.sep, os.altsep)))
    return isinstance(name_or_path, Path) or any(each in name_or_path for each in separators) or name_or_path[:1] == "~"


def _open_folder(folder: Path) -> Dataset:
    if not (folder / MANIFEST).is_file():
        raise FileNotFoundError(
            f"{folder} is no dataset: it has no {MANIFEST}; flights that the paper's public code wrote are read by "
            "vvc_bench.datasets.legacy.import_recordings"
        )
    return open_dataset(folder)


def _is_offline(offline: bool | None) -> bool:
    return os.environ.get("VVC_BENCH_OFFLINE", "0") not in ("", "0") if offline is None else offline


def _fault(folder: Path) -> Exception | None:
    """What is wrong with a copy, or that there is none."""
    try:
        check_copy(folder)
    except (FileNotFoundError, CorruptDataset) as fault:
        return fault
    return None


def _obtain(name: str, folder: Path, ways: list[_Way]) -> None:
    """Make or fetch a copy, unless another process has done so in the meantime."""
    with one_at_a_time(folder):
        fault = _fault(folder)
        if fault is None:
            return
        if isinstance(fault, CorruptDataset):
            if not ways:
                raise fault
            set_aside(folder, fault)
        failures: dict[str, Exception] = {}
        for way in ways:
            try:
                way.make(folder)
                check_copy(folder)
            except (OSError, CorruptDataset) as failure:
                failures[way.label] = failure
            else:
                return
    raise _failure(name, failures)


def _failure(name: str, failures: dict[str, Exception]) -> Exception:
    """What to say when no way has led to the dataset."""
    known = name in known_names() or _ON_OPENML.fullmatch(name)
    if not known and all(isinstance(failure, FileNotFoundError) for failure in failures.values()):
        return ValueError(_unknown(name, list(failures)))
    if len(failures) == 1:
        return next(iter(failures.values()))
    return OSError(f"{name} could not be had: " + "; ".join(f"{label}: {why}" for label, why in failures.items()))


def _ways(name: str, source: str | None, offline: bool, progress: bool) -> list[_Way]:
    """The ways to a dataset, in the order in which they are tried."""
    mirror = os.environ.get("VVC_BENCH_MIRROR") if source is None else source
    possible: list[_Way] = []
    specification = CATALOGUE.get(name)
    if source in (None, BUILD) and specification is not None:
        possible.append(_building(specification, offline, progress))
    if mirror and source not in (BUILD, OPENML):
        possible.append(_fetching(mirror, name, progress))
    if source in (None, OPENML) and (number := _ON_OPENML.fullmatch(name)):
        possible.append(_importing(name, int(number[1]), progress))
    allowed = [way for way in possible if not (offline and way.needs_network)]
    if not allowed and not (datasets_folder() / name).exists():
        raise _nowhere(name, possible)
    return allowed


def _nowhere(name: str, forbidden: list[_Way]) -> Exception:
    """What to say when there is no way to a dataset, or only such as need the network and must not use it."""
    if forbidden:
        return OSError(
            f"{name} is not on this machine, and the network is not to be used (VVC_BENCH_OFFLINE); "
            f"without that it would come from {' or '.join(way.label for way in forbidden)}"
        )
    return ValueError(_unknown(name, []))


def _unknown(name: str, asked: list[str]) -> str:
    names = known_names()
    close = difflib.get_close_matches(name, names, n=3)
    return (
        f"unknown dataset {name!r}"
        + (f"; {' and '.join(asked)} has none of that name either" if asked else "")
        + (f"; did you mean {' or '.join(close)}?" if close else "")
        + f" Known are {', '.join(names)}, and any other set on OpenML as openml-NUMBER"
    )


def _building(specification: Specification, offline: bool, progress: bool) -> _Way:
    def make(folder: Path) -> None:
        from vvc_bench.datasets.build import build_dataset

        find_parent = functools.partial(load_dataset, offline=offline, progress=progress)
        with progress_line(f"building {specification.name}", "goals", shown=progress) as show:
            build_dataset(specification, folder, find_parent=find_parent, progress=show)

    return _Way("its recipe", make)


def _fetching(mirror: str, name: str, progress: bool) -> _Way:
    def make(folder: Path) -> None:
        fetch_dataset(mirror, name, folder, progress=progress)

    return _Way(without_secrets(mirror), make, not is_local(mirror))


def _importing(name: str, number: int, progress: bool) -> _Way:
    def make(folder: Path) -> None:
        from vvc_bench.datasets.legacy import write_imported
        from vvc_bench.datasets.openml_source import fetch_table
        from vvc_bench.datasets.recordings import read_table

        table = fetch_table(number, folder.with_name(f".{name}.arriving"), progress=progress)
        write_imported(read_table(table), folder, name=name, origin=f"OpenML {number}")

    return _Way("OpenML", make, needs_network=True)


def _name_on_openml(name: str) -> str:
    """The name of the paper's set that one of the catalogue stands for."""
    specification = CATALOGUE.get(name)
    if specification is not None and specification.published is not None:
        return f"openml-{specification.published.openml_id}"
    if _ON_OPENML.fullmatch(name):
        return name
    raise ValueError(f"{name} stands for no set on OpenML; those that do: {', '.join(known_names())}")
