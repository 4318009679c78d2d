"""The sets by name: each a value that says how it is made, so that it can be made again.

A name's meaning never changes: another figure is a new version.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vvc_bench.experts.pid import TABLE_1, WEIGHT_COMPENSATED, PidParameters
from vvc_bench.experts.pursuit import PURSUIT, PursuitParameters
from vvc_bench.goals import grid
from vvc_bench.rollout.scenario import Scenario
from vvc_bench.search import NICHES, Budget
from vvc_bench.tasks import TASKS, make_task


class Axis(NamedTuple):
    """Evenly spaced values, both ends included."""

    low: float
    high: float
    points: int

    @property
    def values(self) -> NDArray[np.float64]:
        """Shape (points,)."""
        return np.linspace(self.low, self.high, self.points)


class GoalGrid(NamedTuple):
    """Every combination of three axes, azimuth fastest."""

    speed_mps: Axis
    path_angle_deg: Axis
    azimuth_deg: Axis

    @property
    def goals(self) -> NDArray[np.float64]:
        """Shape (K, 3), in outside units."""
        return grid(*(axis.values.tolist() for axis in self)).goals


@dataclass(frozen=True)
class FlownByLaw:
    """Every goal of the grid flown by a guidance law, Appendix C's or pursuit; what reaches is kept."""

    grid: GoalGrid
    parameters: PidParameters | PursuitParameters


@dataclass(frozen=True)
class Searched:
    """For every goal of the grid, the best flights of those that a search tried."""

    grid: GoalGrid
    budget: Budget


@dataclass(frozen=True)
class Mirrored:
    """Another set and its mirror image, left for right (Appendix D); of two flights to one goal the shorter is kept."""

    parent: str
    resimulate: bool
    """Fly the mirrored commands anew and keep what reaches, in place of mirroring what was recorded."""


@dataclass(frozen=True)
class Updated:
    """Another set, after policies have flown every goal: flights are kept where they are new or shorter (IRPO)."""

    grid: GoalGrid
    parent: str
    policies: tuple[str, ...]
    """`BY_HASH` and the SHA-256 of an ONNX file each; of equally short flights the first one's is kept."""

    @classmethod
    def by_files(cls, grid: GoalGrid, parent: str, hashes: Iterable[str]) -> "Updated":
        """With policies by the SHA-256 of their files."""
        return cls(grid, parent, tuple(f"{BY_HASH}{sha256}" for sha256 in hashes))


BY_HASH = "sha256:"


Recipe: TypeAlias = FlownByLaw | Searched | Mirrored | Updated


class Published(NamedTuple):
    """The set of the paper's that one of ours stands for; its figures are in `vvc_bench.metrics.PUBLISHED`."""

    name: str
    openml_id: int


@dataclass(frozen=True)
class Specification:
    """A set as a function of code, specification and seed."""

    name: str
    summary: str
    scenario: Scenario
    recipe: Recipe
    seed: int = 0
    published: Published | None = None

    def to_json(self) -> dict[str, Any]:
        """All that the set is made from, as a document."""
        return {"name": self.name, "summary": self.summary, "seed": self.seed, "recipe": _recipe_to_json(self.recipe)}


def _recipe_to_json(recipe: Recipe) -> dict[str, Any]:
    match recipe:
        case FlownByLaw(grid, parameters):
            kind = "flown_by_law" if isinstance(parameters, PidParameters) else "flown_by_pursuit"
            return {"kind": kind, "grid": _grid_to_json(grid), "parameters": parameters._asdict()}
        case Searched(grid, budget):
            return {"kind": "searched", "grid": _grid_to_json(grid), "budget": budget._asdict()}
        case Mirrored(parent, resimulate):
            return {"kind": "mirrored", "parent": parent, "resimulate": resimulate}
        case Updated(grid, parent, policies):
            return {"kind": "updated", "grid": _grid_to_json(grid), "parent": parent, "policies": list(policies)}


def _grid_to_json(grid: GoalGrid) -> dict[str, Any]:
    return {name: axis._asdict() for name, axis in grid._asdict().items()}


PAPER_GRID = GoalGrid(Axis(100.0, 300.0, 21), Axis(-85.0, 85.0, 35), Axis(-170.0, 170.0, 69))
"""Appendix D, Table 5: steps of 10 m/s, 5° and 5°, 50,715 goals."""

SAMPLE_GRID = GoalGrid(Axis(100.0, 300.0, 5), Axis(-30.0, 30.0, 7), Axis(-120.0, 120.0, 9))
"""315 of the same goals, for tests and tutorials."""

_ENDINGS = ("reach_target", "crash", "time_limit")


def _kept_by_means(step_limit: int) -> Scenario:
    """How the paper's PID flights were kept (model.md): means over a second within 10 m/s, 1° and 1°."""
    return Scenario(
        make_task(
            TASKS["hard"].task,
            rules="demonstration",
            direction_band_deg=1.0,
            step_limit=step_limit,
            terminations=_ENDINGS,
        )
    )


LEARNED = Scenario(
    make_task(
        TASKS["hard"].task,
        rules="public_code",
        direction_band_deg=1.0,
        terminations=_ENDINGS,
    )
)
"""How the flights of learned policies are kept: means over a second within 10 m/s and 1° between the velocity vectors.

The paper does not say how its own were kept; this is what the accuracies in its Table 1 fit."""

PID, PID_400, HARD = _kept_by_means(1200), _kept_by_means(400), Scenario(TASKS["hard"].task)

SEARCH = Budget(sweeps=18, generations=1, population=16)
SEARCH_WAYS = Budget(sweeps=8, generations=1, population=16, ways=NICHES, patience=1.3)
"""Of the sets with one flight to a goal, and with several."""

_IRPO_POLICIES = {
    1: ("74fe13e33ed34e8ad4cc6eb13bf0f1e1b4aa106f18d83294c80c5e979921fc06",),
    2: (
        "d7f2647a185b0b8d22d48348ee7abd98274660af9958eea53e9cb30df938ea70",
        "5015ecca99a841e1911e499083eb784ebc740a40256fc2689f9f9a2ade68577b",
    ),
    3: (
        "9320cea3683f5ad330c3be8d7fd8d755bd40e2b7f57be35d7637fcde71030220",
        "c6392977419e8730c5597a6ee0e21ca9157e921c3cb2b89675e7af5e7a33c31e",
    ),
}
"""IRPO's iteration → SHA-256 of its policies, each one of `vvc_bench.policies.trained.TRAINED`."""
_LEARNED_POLICIES = {
    2: ("8690f5e66a72745d4ccbfe13abd9749a25e29a8e88eb007fb2bc55bb0f01512c",),
    3: ("14cf5a456706aeb3d6b000a0d5c3cd9bb610a4c943f9561062f474d24781af08",),
}
"""The same for sets after IRPO's first, by policies that went on from the first one's weights in place of clones."""
_LACKING_POLICIES = {
    4: (*_IRPO_POLICIES[3], "e55b76be0ee19f3b8f88f6297c6ea1b94eb5d517aa7b66a544e9098afd878acf"),
    5: (
        "efdcaed0790de446a909ae68fb17cf78f10106b4062c191133b7ef2469a14cd7",
        "609cee240aa7c165897b63ca4d116a6982ecf02f3e9b14cd4f9d00c7d695bbe5",
    ),
}
"""The same for sets after these, by IRPO's last policies, and by others that went on from the first one's weights with
goals alone that the set before lacked."""


def _updated(
    family: str, parent: str, flown: str, policies: Mapping[int, Sequence[str]], published: bool
) -> Iterator[Specification]:
    """Sets made from one another by policies, and each one's mirror image, from which the next is made.

    Args:
        family: of their names.
        parent: the set that the first is made from.
        flown: by which policies, in words.
        policies: number → SHA-256 of each policy.
        published: whether they stand for the paper's.
    """
    for k, hashes in policies.items():
        name, image = f"{family}{k}-v0", f"{family}{k}-aug-v0"
        yield Specification(
            name,
            f"{parent} after {flown} {k} flew the grid",
            LEARNED,
            Updated.by_files(PAPER_GRID, parent, hashes),
            published=Published(f"D_E^{k}", 46010 + 2 * k) if published else None,
        )
        yield Specification(
            image,
            f"{name} and its mirror image",
            LEARNED,
            Mirrored(name, resimulate=False),
            published=Published(f"D_E^{k}, augmented", 46011 + 2 * k) if published else None,
        )
        parent = image


CATALOGUE = {
    specification.name: specification
    for specification in (
        Specification(
            "pid-v0",
            "the paper's grid flown by the guidance law of Appendix C, 120 s at most",
            PID,
            FlownByLaw(PAPER_GRID, TABLE_1),
            published=Published("D_E^0", 46000),
        ),
        Specification(
            "pid-aug-v0",
            "pid-v0 and its mirror image",
            PID,
            Mirrored("pid-v0", resimulate=False),
            published=Published("D_E^0, augmented", 46011),
        ),
        Specification(
            "pid-aug-flown-v0",
            "pid-v0 and its mirrored commands, flown anew",
            PID,
            Mirrored("pid-v0", resimulate=True),
        ),
        Specification(
            "pid400-v0",
            "as pid-v0 within the task's own 400 steps",
            PID_400,
            FlownByLaw(PAPER_GRID, TABLE_1),
        ),
        Specification(
            "pid-compensated-v0",
            "the paper's grid flown with a weight-compensated throttle, under the rules of VVC/Hard-v0",
            HARD,
            FlownByLaw(PAPER_GRID, WEIGHT_COMPENSATED),
        ),
        Specification(
            "pid-sample-v0", "315 goals of pid-v0, for tests and tutorials", PID, FlownByLaw(SAMPLE_GRID, TABLE_1)
        ),
        Specification(
            "pid-aug-sample-v0",
            "pid-sample-v0 and its mirror image",
            PID,
            Mirrored("pid-sample-v0", resimulate=False),
        ),
        Specification(
            "pursuit-v0",
            "the paper's grid flown by bank-to-turn pursuit, under the rules of VVC/Hard-v0",
            HARD,
            FlownByLaw(PAPER_GRID, PURSUIT),
        ),
        Specification(
            "pursuit-sample-v0",
            "315 goals of pursuit-v0, for tests and tutorials",
            HARD,
            FlownByLaw(SAMPLE_GRID, PURSUIT),
        ),
        Specification(
            "search-v0",
            "the shortest flight to each goal that a search found, under the rules of VVC/Hard-v0",
            HARD,
            Searched(PAPER_GRID, SEARCH),
        ),
        Specification(
            "search-multi-v0",
            "up to four short flights to each goal, that end higher or lower, to the right or left",
            HARD,
            Searched(PAPER_GRID, SEARCH_WAYS),
        ),
        Specification(
            "search-aug-flown-v0",
            "search-v0 and its mirrored commands, flown anew",
            HARD,
            Mirrored("search-v0", resimulate=True),
        ),
        Specification(
            "search-sample-v0",
            "315 goals searched with a small budget, for tests and tutorials",
            HARD,
            Searched(SAMPLE_GRID, Budget(sweeps=3, generations=1, population=16)),
        ),
        Specification(
            "search-multi-sample-v0",
            "the same with up to four flights to each goal",
            HARD,
            Searched(SAMPLE_GRID, Budget(sweeps=3, generations=1, population=16, ways=NICHES, patience=1.3)),
        ),
        *_updated("irpo", "search-v0", "the policies of IRPO's iteration", _IRPO_POLICIES, published=True),
        *_updated("learned", "irpo1-aug-v0", "policy", _LEARNED_POLICIES, published=False),
        *_updated("learned", "learned3-aug-v0", "the policies of step", _LACKING_POLICIES, published=False),
        Specification(
            "irpo1-sample-v0",
            "pursuit-sample-v0 after the policy of IRPO's first iteration has flown its goals, for tests and tutorials",
            LEARNED,
            Updated.by_files(SAMPLE_GRID, "pursuit-sample-v0", _IRPO_POLICIES[1]),
        ),
    )
}
"""Every set by name."""


def grid_flown(name: str) -> GoalGrid:
    """The grid that the oldest ancestor of a set was flown to.

    Raises:
        ValueError: for an unknown name.
    """
    recipe = named_specification(name).recipe
    return grid_flown(recipe.parent) if isinstance(recipe, Mirrored) else recipe.grid


def goals_flown(name: str) -> NDArray[np.float64]:
    """All goals of `grid_flown`, shape (K, 3): coverage is a share of them.

    Raises:
        ValueError: for an unknown name.
    """
    return grid_flown(name).goals


def named_specification(name: str) -> Specification:
    """One of `CATALOGUE`.

    Raises:
        ValueError: for an unknown name; says which are known.
    """
    if name not in CATALOGUE:
        close = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise ValueError(f"unknown set {name!r}{hint} Known are {', '.join(CATALOGUE)}")
    return CATALOGUE[name]
