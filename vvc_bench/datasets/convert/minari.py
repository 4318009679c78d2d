"""Flights as Minari datasets, and back (extra ``minari``)."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from vvc_bench.datasets.dataset import ENVIRONMENT_ID, environment_options
from vvc_bench.datasets.transitions import dictionary, seen, transitions_of
from vvc_bench.envs.environment import VelocityVectorEnv
from vvc_bench.rollout import Episodes, Scenario, replay
from vvc_bench.sim.fields import Conditions

try:
    import minari
    from minari import MinariDataset
    from minari.data_collector import EpisodeBuffer
except ImportError as error:
    raise ImportError("this takes Minari, which is missing: pip install vvc-bench[minari]") from error

_START = ("altitude_m", "speed_mps", "heading_deg")


def to_minari(episodes: Episodes, dataset_id: str, **metadata: Any) -> MinariDataset:
    """Store flights as a Minari dataset, whose environment is the one that they are from.

    Each episode's reset options hold its goal and its start, its seed that of gusts and sensor noise.

    Args:
        episodes: the flights.
        dataset_id: as Minari has them: ``vvc/pid-v0``.
        **metadata: what else `minari.create_dataset_from_buffers` takes, as ``author`` or ``data_format``.
    """
    made = transitions_of(episodes)
    buffers = []
    for e in range(len(episodes)):
        steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
        buffers.append(
            EpisodeBuffer(
                id=e,
                seed=int(episodes.seeds[e]),
                options={"goal": episodes.goals[e], "state": episodes.starts[e]},
                observations=dictionary(seen(episodes, e), episodes.goals[e]),
                actions=made.actions[steps],
                rewards=made.rewards[steps],
                terminations=made.terminated[steps],
                truncations=made.truncated[steps],
            )
        )
    environment = gymnasium.make(ENVIRONMENT_ID, **environment_options(episodes.scenario))
    return minari.create_dataset_from_buffers(dataset_id, buffers, env=environment, **metadata)


def from_minari(dataset: MinariDataset | str) -> Episodes:
    """Flights of a Minari dataset that was recorded in one of our environments, by `to_minari` or otherwise.

    The actions are flown again, which gives everything that Minari does not hold, and must show what was recorded.

    Args:
        dataset: it, or its id.

    Raises:
        ValueError: if it is from another environment, or its actions fly other flights than were recorded.
    """
    dataset = minari.load_dataset(dataset) if isinstance(dataset, str) else dataset
    scenario = _scenario_of(dataset)
    records = list(dataset.iterate_episodes())
    known = list(dataset.storage.get_episode_metadata(dataset.episode_indices))
    options = [entry.get("options") or {} for entry in known]
    ours = all("state" in each for each in options)
    flown = replay(
        scenario,
        np.array([_goal_of(each, record) for each, record in zip(options, records, strict=True)]),
        np.concatenate([np.asarray(record.actions, dtype=np.float32) for record in records]),
        np.concatenate([[0], np.cumsum([len(record.rewards) for record in records])]),
        seeds=[entry["seed"] for entry in known] if ours else int(scenario.conditions.seed),
        sources=dataset.spec.dataset_id,
        starts=np.array([each["state"] for each in options]) if ours else None,
    )
    for e, record in enumerate(records):
        if not np.array_equal(seen(flown, e), record.observations["observation"]):
            raise ValueError(f"episode {e} of {dataset.spec.dataset_id} is not what its actions fly in {scenario}")
    return flown


def _scenario_of(dataset: MinariDataset) -> Scenario:
    environment = dataset.recover_environment().unwrapped
    if not isinstance(environment, VelocityVectorEnv):
        raise ValueError(f"{dataset.spec.dataset_id} was recorded in {environment}, and not in a VVC environment")
    given = dataset.env_spec.kwargs
    fleet = environment.fleet
    start = {name: given[name] for name in _START if name in given}
    return Scenario(fleet.task, fleet.settings, conditions=Conditions(*fleet.conditions[0].tolist()), **start)


def _goal_of(options: Mapping[str, Any], record: Any) -> NDArray[np.float64]:
    """An episode's goal: as it was asked for if that is known, else as it was seen."""
    return np.asarray(options.get("goal", record.observations["desired_goal"][0]), dtype=np.float64)
