"""Who stands where: the entries of each protocol with what they reached and the ranks that this leaves open."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vvc_bench.evaluation import PROTOCOLS, named_protocol, read_evaluation
from vvc_bench.evaluation.comparison import compare
from vvc_bench.evaluation.methods import Method
from vvc_bench.leaderboard.entries import Entry, list_entries, read_entry
from vvc_bench.leaderboard.submission import Submission
from vvc_bench.metrics import RankInterval


@dataclass(frozen=True)
class Place:
    """An entry among those of its protocol.

    Args:
        submission: what it says.
        summary: what it did.
        rank: first and last rank that it may have; None once another entry has corrected it.
        corrected_by: that entry's name, or "".
        reason: what was wrong, in its author's words.
    """

    submission: Submission
    summary: Mapping[str, Any]
    rank: RankInterval | None
    corrected_by: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Standings:
    """The entries of one protocol, the best first; those that were corrected last."""

    protocol: str
    about: str
    places: tuple[Place, ...]

    @property
    def current(self) -> tuple[Place, ...]:
        """Those that no other entry has corrected."""
        return tuple(place for place in self.places if place.rank is not None)


def standings(root: Path) -> list[Standings]:
    """Read all entries and rank them, protocol by protocol in the order of `PROTOCOLS`.

    Raises:
        ValueError: for an entry that cannot be read, or of an unknown protocol; `verify` says more.
        FileNotFoundError: if there is no such folder.
    """
    entries: dict[str, list[Entry]] = {}
    for folder in list_entries(root):
        entry = read_entry(folder)
        entries.setdefault(named_protocol(entry.submission.protocol).name, []).append(entry)
    return [_ranked(name, entries[name]) for name in PROTOCOLS if name in entries]


def _ranked(protocol: str, entries: Sequence[Entry]) -> Standings:
    corrections = {
        said.supersedes.entry: {"corrected_by": said.entry, "reason": said.supersedes.reason}
        for said in (entry.submission for entry in entries)
        if said.supersedes is not None
    }
    ranks = _ranks([entry for entry in entries if entry.submission.entry not in corrections])
    places = [
        Place(
            entry.submission,
            entry.summary,
            ranks.get(entry.submission.entry),
            **corrections.get(entry.submission.entry, {}),
        )
        for entry in entries
    ]
    places.sort(key=lambda place: (place.rank is None, -place.summary["success"]["rate"], place.submission.entry))
    return Standings(protocol, PROTOCOLS[protocol].summary, tuple(places))


def _ranks(entries: Sequence[Entry]) -> dict[str, RankInterval]:
    """Ranks by pairwise tests on the same goals, corrected for how many there are."""
    if len(entries) < 2:
        return {entry.submission.entry: RankInterval(1, 1) for entry in entries}
    methods = [Method(entry.submission.entry, (read_evaluation(entry.folder),)) for entry in entries]
    found = compare(methods, np.random.default_rng(0))  # the generator has no say in ranks
    return {contender.label: contender.rank for contender in found.contenders}
