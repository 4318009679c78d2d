"""What the tables hold, and what a budget spends on them.

The paper's text was not at hand: which rows stand together is ours, from what is known of its tables.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from vvc_bench.baselines.configurations import (
    GCBC_FAST,
    GCBC_RELEASED,
    GCBC_SMALL,
    PPO_FAST,
    PPO_RELEASED,
    PPO_SMALL,
    SAC_FAST,
    SAC_RELEASED,
    SAC_SMALL,
    STAGED,
    CloningConfiguration,
    Configuration,
    PpoConfiguration,
    SacConfiguration,
    with_amount,
)
from vvc_bench.datasets.catalogue import CATALOGUE

GCBC, PPO, SAC, HER = "gcbc", "ppo", "sac", "sac-her"
FINE_TUNED, WITHOUT_PENALTY = "gcbc-ppo", "gcbc-ppo-without-penalty"
"""Kinds of learners that a budget has a configuration for; the last two improve on a clone by PPO."""

PAPER_SETS = (
    "pid-v0",
    "pid-aug-v0",
    *(f"irpo{k}{suffix}-v0" for k in (1, 2, 3) for suffix in ("", "-aug")),
)
LEARNED_SETS = tuple(name for name in CATALOGUE if name.startswith("learned"))
SETS = (*PAPER_SETS, *LEARNED_SETS, "pursuit-v0", "search-v0")
"""Rows of Tables 1 and 12; the paper has nothing like those that follow its own."""
CLONED = (
    "pid-v0",
    *(f"{family}-aug-v0" for family in ("pid", "irpo1", "irpo2", "irpo3", "learned3")),
    "pursuit-v0",
    "search-v0",
)
"""Sets of demonstrations in Table 2."""
SHIPPED = MappingProxyType(
    {
        "irpo1-seed0": "IRPO from search-v0, iteration 1",
        **{f"irpo{k}-seed{seed}": f"IRPO, iteration {k}, seed {seed}" for k in (2, 3) for seed in (0, 1)},
        "learned2": "irpo1-seed0, then PPO by the sets' rules",
        "learned3": "irpo1-seed0, then PPO by the sets' rules, within 1.5°",
    }
)
"""Policies of the package in Table 3, and what they are."""


@dataclass(frozen=True)
class Budget:
    """How much is spent on a table.

    Args:
        name: as given on the command line.
        says: what is to be thought of the results, as a sentence.
        task: that is learned.
        samples: whether samples stand for the sets.
        configurations: kind of learner → name and values.
        seeds: each learner is trained once with each; another number of them may be asked for (`with_seeds`).
        curricula: that PPO is tried with, besides the task's own goals.
        protocols: what policies are judged on; the paper's figure is compared with the first.
        evaluations: on validation goals during a training.
        judges_sets: whether the sets are those that the paper's figures are about.
        judges_learners: whether learners are trained as the paper's were.
    """

    name: str
    says: str
    task: str
    samples: bool
    configurations: Mapping[str, tuple[str, Configuration]]
    seeds: tuple[int, ...]
    curricula: tuple[str, ...]
    protocols: tuple[str, ...]
    evaluations: int
    judges_sets: bool
    judges_learners: bool

    def set_name(self, name: str) -> str:
        """The set that stands for one at this budget: itself or its sample."""
        return f"{name.removesuffix('-v0')}-sample-v0" if self.samples else name

    def with_seeds(self, count: int) -> "Budget":
        """The same with so many seeds, from 0.

        Raises:
            ValueError: for less than one.
        """
        if count < 1:
            raise ValueError(f"learners take at least one seed, got {count}")
        return dataclasses.replace(self, seeds=tuple(range(count)))


@dataclass(frozen=True)
class Trial:
    """A learner in a table: what is trained, on what, from where.

    Args:
        name: of its folders; the same in every table that it stands in.
        label: for people.
        algorithm: ``gcbc``, ``ppo``, ``sac`` or ``sac-her``.
        configuration_name: as it will stand in ``training.json``.
        configuration: with the amount.
        demonstrations: name of the set that is cloned, for ``gcbc``.
        demonstrator: the trial whose best clone is improved on, for ``ppo``.
        curriculum: one of `vvc_bench.baselines.configurations.CURRICULA`.
        paper_percent: the paper's figure, where it is at hand; none is.
    """

    name: str
    label: str
    algorithm: str
    configuration_name: str
    configuration: Configuration
    demonstrations: str | None = None
    demonstrator: "Trial | None" = None
    curriculum: str | None = None
    paper_percent: float | None = None


@dataclass(frozen=True)
class Shipped:
    """A policy of the package in a table; nothing is trained."""

    name: str
    label: str
    paper_percent: float | None = None


Entry: TypeAlias = Trial | Shipped


# Budgets


def _configurations(
    name: str,
    cloning: tuple[str, CloningConfiguration],
    ppo: PpoConfiguration,
    improving: PpoConfiguration,
    sac: SacConfiguration,
) -> Mapping[str, tuple[str, Configuration]]:
    """By kind of learner; all but GCBC's have one name."""
    return MappingProxyType(
        {
            GCBC: cloning,
            PPO: (name, ppo),
            SAC: (name, sac),
            HER: (name, sac._replace(hindsight=True)),
            FINE_TUNED: (name, improving),
            WITHOUT_PENALTY: (f"{name}-without-penalty", improving._replace(demonstrator_penalty=0.0)),
        }
    )


def _improving(name: str) -> PpoConfiguration:
    return STAGED[FINE_TUNED][name].improving[0]


SMALL = Budget(
    "small",
    "a test of the pipeline, no reproduction: an easy task, samples of the sets, minutes",
    task="normal",
    samples=True,
    configurations=_configurations(
        "small",
        ("small", with_amount(GCBC_SMALL, 20)),
        with_amount(PPO_SMALL, 200_000),
        with_amount(_improving("small"), 200_000),
        with_amount(SAC_SMALL, 4_000),
    ),
    seeds=(0,),
    curricula=("mega",),
    protocols=("normal-1k-v0",),
    evaluations=1,
    judges_sets=False,
    judges_learners=False,
)
_JUDGED = ("hard-1k-v0", "hard-grid-v0", "normal-1k-v0")
LAPTOP = Budget(
    "laptop",
    "whole sets and the hard task; learners get less than the authors'",
    task="hard",
    samples=False,
    configurations=_configurations(
        "fast",
        ("fast", with_amount(GCBC_FAST, 10)),
        with_amount(PPO_FAST, 12_000_000),
        with_amount(_improving("fast"), 12_000_000),
        SAC_FAST,
    ),
    seeds=(0,),
    curricula=(),
    protocols=_JUDGED,
    evaluations=10,
    judges_sets=True,
    judges_learners=False,
)
FULL = Budget(
    "full",
    "what the authors released",
    task="hard",
    samples=False,
    configurations=_configurations(
        "released", ("released", GCBC_RELEASED), PPO_RELEASED, _improving("released"), SAC_RELEASED
    ),
    seeds=(0, 1, 2, 3, 4),
    curricula=("mega",),
    protocols=_JUDGED,
    evaluations=10,
    judges_sets=True,
    judges_learners=True,
)
BUDGETS: Mapping[str, Budget] = MappingProxyType({budget.name: budget for budget in (SMALL, LAPTOP, FULL)})
"""By name, the smallest first."""


# Tables of learners


def table_2(budget: Budget) -> tuple[Entry, ...]:
    """What demonstrations are worth: clones of one set each."""
    return tuple(_clone(budget, name) for name in CLONED)


def table_3(budget: Budget) -> tuple[Entry, ...]:
    """With demonstrations and without."""
    return (
        _alone(budget, PPO),
        _fine_tuned(budget, "pid-aug-v0", FINE_TUNED),
        _fine_tuned(budget, "pid-aug-v0", WITHOUT_PENALTY),
        _fine_tuned(budget, "search-v0", FINE_TUNED),
        *(Shipped(name, label) for name, label in SHIPPED.items()),
    )


def table_9(budget: Budget) -> tuple[Entry, ...]:
    """Without demonstrations."""
    return (
        _alone(budget, SAC),
        _alone(budget, HER),
        _alone(budget, PPO),
        *(_alone(budget, PPO, each) for each in budget.curricula),
    )


_LABELS = {GCBC: "GCBC", PPO: "PPO", SAC: "SAC", HER: "SAC+HER"}


def _alone(budget: Budget, kind: str, curriculum: str | None = None) -> Trial:
    name = kind if curriculum is None else f"{kind}-{curriculum}"
    label = _LABELS[kind] + (f", {curriculum.upper()}" if curriculum else "")
    return Trial(name, label, kind, *budget.configurations[kind], curriculum=curriculum)


def _clone(budget: Budget, name: str) -> Trial:
    used = budget.set_name(name)
    return Trial(f"gcbc-{_short(name)}", f"GCBC from {used}", GCBC, *budget.configurations[GCBC], demonstrations=used)


def _fine_tuned(budget: Budget, name: str, kind: str) -> Trial:
    configuration_name, configuration = budget.configurations[kind]
    assert isinstance(configuration, PpoConfiguration)
    penalty = configuration.demonstrator_penalty
    label = f"GCBC+PPO from {budget.set_name(name)}, " + (f"penalty {penalty:g}" if penalty else "no penalty")
    folder = kind.replace(FINE_TUNED, f"{FINE_TUNED}-{_short(name)}")
    clone = _clone(budget, name)
    return Trial(folder, label, PPO, configuration_name, configuration, demonstrator=clone)


def _short(name: str) -> str:
    return name.removesuffix("-v0")


TABLES_OF_LEARNERS: Mapping[str, tuple[str, Callable[[Budget], tuple[Entry, ...]]]] = MappingProxyType(
    {
        "table2": ("What demonstrations are worth: GCBC on each set", table_2),
        "table3": ("With and without demonstrations", table_3),
        "table9": ("Without demonstrations", table_9),
    }
)
"""Name → title, and what makes the rows for a budget."""
TABLES_OF_SETS: Mapping[str, str] = MappingProxyType(
    {"table1": "The sets of demonstrations", "table12": "Smoothness of the sets"}
)
"""Name → title."""
TABLES = ("table1", "table2", "table3", "table9", "table12")
