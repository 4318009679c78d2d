"""The baselines by name: from a task, a set of demonstrations and a configuration to a trained policy in a folder."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from gymnasium import spaces

from vvc_bench import sim
from vvc_bench.baselines.actors import DemonstratedPolicy, make_policy
from vvc_bench.baselines.configurations import (
    INTERMEDIATE,
    CloningConfiguration,
    Configuration,
    PpoConfiguration,
    SacConfiguration,
    StagedConfiguration,
    amount_of,
)
from vvc_bench.baselines.curricula import Intermediate, make_curriculum
from vvc_bench.baselines.devices import CPU
from vvc_bench.baselines.gcbc import Cloning
from vvc_bench.baselines.ppo import Improving
from vvc_bench.baselines.sac import SoftActorCritic
from vvc_bench.baselines.training import Learner, Plan, protocol_for, train, weights, weights_sha256
from vvc_bench.baselines.unit_actions import UnitActions, unit_box
from vvc_bench.datasets.catalogue import PAPER_GRID
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.progress import progress_line
from vvc_bench.envs import ENVIRONMENT_IDS
from vvc_bench.envs.options import make_spaces
from vvc_bench.envs.stable_baselines import VelocityVectorVecEnv
from vvc_bench.goals import GoalDistribution
from vvc_bench.tasks import named_problem

VALIDATION_SHARE = 0.1
"""Of the goals of a set, held out to measure a loss on (`Dataset.split`)."""
GCBC, PPO = "gcbc", "ppo"
"""Folders of the stages of GCBC+PPO."""

_VALUES = "value_net"
"""In the names of the critic's weights, in Stable-Baselines3."""
_HINDSIGHT = {"reward": "sparse", "reach_steps": 1}
"""Of the task that hindsight learns on: what a pair of goals is worth then follows from them alone."""


def silent(label: str, unit: str) -> AbstractContextManager[Callable[[int, int], None]]:
    """No line of progress."""
    return progress_line(label, unit, shown=False)


@dataclass(frozen=True)
class Setting:
    """What all trainings have in common.

    Args:
        task: a name from `vvc_bench.tasks.TASKS`.
        seed: of all that is drawn.
        evaluations: how often a policy is judged on the way, evenly spread, besides the start.
        threads: of PyTorch, of the aircraft and of evaluations.
        between: seconds between two checkpoints, at least.
        progress: makes a line of a label and a unit.
        fields: of the task, by column name (`vvc_bench.tasks.make_task`), for PPO and SAC to learn on a variant of it.
        protocol: what policies are judged on on the way, in place of the task's validation goals as they are.
        lacking: a set, for PPO and SAC to learn near goals of the paper's grid that it lacks, and nowhere else, and to
            be judged there.
        device: of the networks (`vvc_bench.baselines.devices.find_device`).
    """

    task: str
    seed: int = 0
    evaluations: int = 10
    threads: int = 1
    between: float = 120.0
    progress: Callable[[str, str], AbstractContextManager[Callable[[int, int], None]]] = silent
    fields: Mapping[str, Any] = field(default_factory=dict)
    protocol: str | None = None
    lacking: Dataset | None = None
    device: torch.device = CPU

    def run(self, plan: Plan, folder: Path, make_learner: Callable[[], Learner], unit: str) -> dict[str, Any]:
        """Train with a line that says how far it has come."""
        with self.progress(f"{plan.algorithm} in {folder}", unit) as progress:
            return train(
                plan,
                folder,
                make_learner,
                threads=self.threads,
                between=self.between,
                judged=None if plan.lacking is None else self.lacking_goals().covers(protocol_for(plan).goals),
                progress=progress,
            )

    def lacking_goals(self) -> Intermediate:
        """A curriculum of goals near those that a set lacks.

        Raises:
            ValueError: if it lacks none of the task's.
        """
        assert self.lacking is not None
        every = PAPER_GRID.goals
        return Intermediate(named_problem(self.task).goals, among=every[~self.lacking.is_seen(every)])


def train_gcbc(
    setting: Setting, folder: Path, dataset: Dataset, name: str, configuration: CloningConfiguration
) -> dict[str, Any]:
    """Clone the demonstrations of a set.

    Args:
        setting: what all trainings have in common.
        folder: where.
        dataset: what is cloned, but for a tenth of its goals, which a loss is measured on.
        name: the configuration's.
        configuration: how.

    Returns:
        What ``training.json`` holds.

    Raises:
        ValueError: for fewer transitions than a batch, or another plan's folder.
        OSError: if it cannot be written.
    """
    plan = _plan("gcbc", setting, name, configuration, demonstrations=_named(dataset))

    def make() -> Cloning:
        training, validation = dataset.split(VALIDATION_SHARE)
        return Cloning(
            training.transitions(),
            validation.transitions() if len(validation) else None,
            make_spaces(dataset.scenario.settings),
            configuration,
            setting.seed,
            setting.device,
        )

    return setting.run(plan, folder, make, " epochs")


def train_ppo(
    setting: Setting,
    folder: Path,
    name: str,
    configuration: PpoConfiguration,
    *,
    cloned: Path | None = None,
    critic: Path | None = None,
    curriculum: str | None = None,
) -> dict[str, Any]:
    """Learn by PPO, from nothing or from a policy that was trained before, as a clone.

    Args:
        setting: what all trainings have in common.
        folder: where.
        name: the configuration's.
        configuration: how.
        cloned: folder of a training, mostly by GCBC, with the same networks; its best policy is the demonstrator.
        critic: folder of a training by PPO, whose value function it begins with in place of the demonstrator's: a
            clone's is untrained.
        curriculum: one of `vvc_bench.baselines.configurations.CURRICULA`; by default goals are the task's.

    Returns:
        What ``training.json`` holds.

    Raises:
        ValueError: for other networks, another plan's folder, or a set that lacks nothing.
        FileNotFoundError: for a demonstrator without weights.
        OSError: if it cannot be written.
    """
    demonstrator, known = (None, None) if cloned is None else _beginning(cloned, critic)
    algorithm = "ppo" if cloned is None else "gcbc-ppo"
    origins = {"curriculum": curriculum, "lacking": _named(setting.lacking), "fields": setting.fields}
    plan = _plan(algorithm, setting, name, configuration, demonstrator=known, **origins)

    def make() -> Improving:
        environments = make_environments(
            setting, configuration.environments, curriculum, configuration.reward_scale, **setting.fields
        )
        shown = None if demonstrator is None else _policy_with(demonstrator, configuration.hidden)
        return Improving(environments, configuration, setting.seed, shown, setting.device)

    return setting.run(plan, folder, make, " steps")


def train_sac(
    setting: Setting, folder: Path, name: str, configuration: SacConfiguration, *, curriculum: str | None = None
) -> dict[str, Any]:
    """Learn by SAC, or SAC with hindsight. Arguments, result and errors as for `train_ppo`."""
    algorithm = "sac-her" if configuration.hindsight else "sac"
    fields = {**setting.fields, **(_HINDSIGHT if configuration.hindsight else {})}
    origins = {"curriculum": curriculum, "lacking": _named(setting.lacking), "fields": fields}
    plan = _plan(algorithm, setting, name, configuration, **origins)

    def make() -> SoftActorCritic:
        environments = make_environments(setting, configuration.environments, curriculum, **fields)
        return SoftActorCritic(environments, configuration, setting.seed, setting.device)

    return setting.run(plan, folder, make, " steps")


def train_gcbc_ppo(
    setting: Setting,
    folder: Path,
    dataset: Dataset,
    name: str,
    configuration: StagedConfiguration,
    *,
    critic: Path | None = None,
    curriculum: str | None = None,
) -> dict[str, Any]:
    """Clone demonstrations, in the folder ``gcbc``, and improve on the best clone, in ``ppo``.

    Arguments and errors are those of `train_gcbc` and `train_ppo`.

    Returns:
        What ``training.json`` of both holds.
    """
    improving = configuration.improving[0]
    cloning = configuration.cloning._replace(hidden=improving.hidden)
    return {
        GCBC: train_gcbc(setting, folder / GCBC, dataset, name, cloning),
        PPO: train_ppo(
            *(setting, folder / PPO, name, improving), cloned=folder / GCBC, critic=critic, curriculum=curriculum
        ),
    }


def make_environments(
    setting: Setting, count: int, curriculum: str | None = None, reward_scale: float = 1.0, **fields: object
) -> UnitActions:
    """Environments to learn in.

    Args:
        setting: task, seed and threads.
        count: how many.
        curriculum: one of `vvc_bench.baselines.configurations.CURRICULA`; with a set whose goals are lacking,
            ``intermediate``.
        reward_scale: what rewards are multiplied by.
        **fields: of the task.

    Raises:
        ValueError: for an unknown task or curriculum.
    """
    goals = _goals(setting, curriculum)
    ids = {task: environment_id for environment_id, task in ENVIRONMENT_IDS.items()}
    return UnitActions(
        VelocityVectorVecEnv(
            ids[setting.task], count, seed=setting.seed, threads=setting.threads, goals=goals, **fields
        ),
        reward_scale,
    )


def _goals(setting: Setting, curriculum: str | None) -> GoalDistribution:
    """What is learned."""
    box = named_problem(setting.task).goals
    if setting.lacking is not None:
        if curriculum != INTERMEDIATE:
            raise ValueError(f"goals that a set lacks are learned with the curriculum {INTERMEDIATE}, not {curriculum}")
        return setting.lacking_goals()
    return box if curriculum is None else make_curriculum(curriculum, box, setting.seed)


def _named(dataset: Dataset | None) -> dict[str, str] | None:
    return None if dataset is None else {"name": dataset.name, "hash": dataset.hash}


def _plan(algorithm: str, setting: Setting, name: str, configuration: Configuration, **origins: Any) -> Plan:
    return Plan(
        algorithm,
        setting.task,
        {"name": name, **configuration._asdict()},
        setting.seed,
        amount_of(configuration),
        evaluations=setting.evaluations,
        protocol=setting.protocol,
        **origins,
    )


def _beginning(cloned: Path, critic: Path | None) -> tuple[dict[str, Any], dict[str, str]]:
    """Weights to begin with, and where they are from."""
    demonstrator = weights(cloned)
    known = {"sha256": weights_sha256(demonstrator)}
    if critic is None:
        return demonstrator, known
    judging = weights(critic)
    values = {part: tensor for part, tensor in judging.items() if _VALUES in part}
    return demonstrator | values, known | {"critic_sha256": weights_sha256(judging)}


def _policy_with(state: dict[str, Any], hidden: tuple[int, ...]) -> DemonstratedPolicy:
    where = make_spaces(sim.Settings())
    assert isinstance(where.action, spaces.Box)
    policy = make_policy(where.observation, unit_box(where.action), hidden, lambda _: 0.0)
    try:
        policy.load_state_dict(state)
    except RuntimeError as error:
        raise ValueError(f"the demonstrator's networks are not those of the configuration: {error}") from error
    return policy
