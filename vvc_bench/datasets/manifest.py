"""What a dataset says about itself: ``manifest.json``, which tells when a single byte of it was changed."""

import hashlib
import importlib.metadata
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vvc_bench.datasets.schema import Values, episode_columns, transition_columns
from vvc_bench.rollout import Episodes, Scenario
from vvc_bench.version import __version__

FORMAT, FORMAT_VERSION = "vvc-bench-dataset", 1
MANIFEST, EPISODES, TRANSITIONS = "manifest.json", "episodes.parquet", "transitions-00000.parquet"

_PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_SEAL = "sha256"
_TYPES = {
    **{"name": str, "specification": dict, "scenario": dict, "versions": dict, "seed": int, "counts": dict},
    **{"last_events": dict, "metrics": dict, "parents": dict, "files": dict, "columns": dict},
}
_COUNTS = {"goals_flown", "episodes", "transitions"}


class CorruptDataset(ValueError):  # noqa: N818  (said of a set, as in "this is a corrupt dataset")
    """A dataset that is not as it was written; the message names the file and says what to do."""


def damaged(place: Path, what: str) -> CorruptDataset:
    """The error for a file of a set."""
    return CorruptDataset(f"{place} {what}; the set is damaged: build or download it again")


@dataclass(frozen=True)
class Description:
    """What is to be said of a set besides its flights.

    Args:
        name: letters, digits, dots, dashes and underscores.
        specification: how it was made, as a JSON document.
        seed: what it was made with.
        last_events: event that ended a flight, or ``"none"`` → over how many of the goals flown.
        goals_flown: how many goals were tried.
        metrics: measures, as a JSON document.
        parents: name → hash of the sets that it was made from.
    """

    name: str
    specification: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    last_events: Mapping[str, int] = field(default_factory=dict)
    goals_flown: int = 0
    metrics: Mapping[str, Any] = field(default_factory=dict)
    parents: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not _PLAIN_NAME.fullmatch(self.name):
            raise ValueError(f"a set's name has letters, digits, '.', '_' and '-', at most 100; got {self.name!r}")


def manifest_text(description: Description, episodes: Episodes, values: Values, files: Mapping[str, Any]) -> str:
    """The manifest of a set.

    Args:
        description: what its maker says.
        episodes: its flights.
        values: its table of transitions, for the statistics.
        files: ``sha256``, ``bytes`` and ``rows`` of each file.

    Raises:
        TypeError: if the description is no JSON document.
        ValueError: if it holds NaN or infinity.
    """
    scenario = episodes.scenario
    transitions = {
        name: _described(column) | _statistics(values[name]) for name, column in transition_columns(scenario).items()
    }
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": description.name,
        "specification": dict(description.specification),
        "scenario": scenario.to_json(),
        "versions": {"vvc_bench": __version__}
        | {name: importlib.metadata.version(name) for name in ("numba", "numpy", "pyarrow")},
        "seed": description.seed,
        "counts": {
            "goals_flown": description.goals_flown,
            "episodes": len(episodes),
            "transitions": len(episodes.rewards),
        },
        "last_events": dict(description.last_events),
        "metrics": dict(description.metrics),
        "parents": dict(description.parents),
        "files": dict(files),
        "columns": {
            "transitions": transitions,
            "episodes": {name: _described(column) for name, column in episode_columns(scenario).items()},
        },
    }
    return _text(document | {_SEAL: _sha256(_text(document))})


def parse_manifest(content: bytes, place: Path) -> dict[str, Any]:
    """A manifest, if it is one, and as it was written.

    Args:
        content: the bytes of ``manifest.json``.
        place: where they are from, for messages.

    Raises:
        CorruptDataset: otherwise.
    """
    try:
        document = json.loads(content)
        written = _text(document).encode() == content
    except (ValueError, RecursionError):
        raise damaged(place, "is no JSON document") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise damaged(place, f"is no manifest of a {FORMAT}")
    if document.get("format_version") != FORMAT_VERSION:
        found = document.get("format_version")
        raise CorruptDataset(f"{place} has format version {found!r}, this vvc-bench reads {FORMAT_VERSION}: update it")
    seal = document.pop(_SEAL, None)
    if seal != _sha256(_text(document)) or not written:
        raise damaged(place, "differs from its own checksum")
    problem = _problem(document)
    if problem:
        raise damaged(place, problem)
    return document


def _problem(document: Mapping[str, Any]) -> str:
    """What is wrong with a manifest whose checksum is right; empty if nothing is."""
    for key, kind in _TYPES.items():
        if type(document.get(key)) is not kind:
            return f"has no {key!r} that is a {kind.__name__}"
    counts, files = document["counts"], document["files"]
    if not _PLAIN_NAME.fullmatch(document["name"]):
        return f"has a name that is not plain: {document['name']!r}"
    if set(counts) != _COUNTS or not all(_is_count(count) for count in counts.values()):
        return f"has counts other than {', '.join(sorted(_COUNTS))}"
    if set(files) != {EPISODES, TRANSITIONS}:
        return f"lists files other than {EPISODES} and {TRANSITIONS}: {', '.join(map(repr, sorted(files)))}"
    rows = {EPISODES: counts["episodes"], TRANSITIONS: counts["transitions"]}
    if not all(_is_file(entry) and entry["rows"] == rows[name] for name, entry in files.items()):
        return "lists a file without its sha256, bytes and rows"
    return _scenario_problem(document)


def _scenario_problem(document: Mapping[str, Any]) -> str:
    try:
        scenario = Scenario.from_json(document["scenario"])
        known = {"transitions": transition_columns(scenario), "episodes": episode_columns(scenario)}
        stored = {table: list(document["columns"][table]) for table in known}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return f"has a scenario or columns that cannot be read ({error})"
    return "" if stored == {table: list(names) for table, names in known.items()} else "has other columns"


def _is_count(value: object) -> bool:
    return type(value) is int and value >= 0


def _is_file(entry: object) -> bool:
    return (
        isinstance(entry, dict)
        and set(entry) == {"sha256", "bytes", "rows"}
        and isinstance(entry["sha256"], str)
        and _SHA256.fullmatch(entry["sha256"]) is not None
        and _is_count(entry["bytes"])
        and _is_count(entry["rows"])
    )


def _described(column: Any) -> dict[str, Any]:
    return {"type": column.type, "unit": column.unit, "meaning": column.meaning}


def _statistics(values: Any) -> dict[str, float]:
    """Mean, standard deviation, minimum and maximum of measured values, to nine digits; none if one is not finite."""
    if values.dtype != np.float32 or not len(values) or not np.isfinite(values).all():
        return {}
    exact = values.astype(np.float64)
    measures = {"mean": exact.mean(), "std": exact.std(), "min": exact.min(), "max": exact.max()}
    return {name: float(f"{value:.9g}") for name, value in measures.items()}


def _text(document: object) -> str:
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
