"""Small sets of flights for the tests of datasets."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from vvc_bench import sim
from vvc_bench.experts import WEIGHT_COMPENSATED
from vvc_bench.goals import grid
from vvc_bench.rollout import Episodes, Scenario, fly_law, replay
from vvc_bench.rollout.episodes import PER_EPISODE, PER_TRANSITION
from vvc_bench.sim.fields import Conditions
from vvc_bench.tasks import TASKS, make_task

TASK = make_task(TASKS["hard"].task, step_limit=300, terminations=["reach_target", "crash", "time_limit"])


def flights(speeds: Sequence[float] = (180, 200, 220), azimuths: Sequence[float] = (-40, -20, 0, 20, 40)) -> Episodes:
    """Flights by the expert, some dozens of steps each."""
    return fly_law(Scenario(TASK), grid(speeds, (-10, 0, 10), azimuths).goals, WEIGHT_COMPENSATED).episodes


def delayed_flights() -> Episodes:
    """Flights with control delay, gusts, noise, seeds and starts of their own, and every kind of end."""
    scenario = Scenario(TASK, conditions=Conditions(delay_steps=2.0, gust_intensity=1.0, sensor_noise=1.0))
    generator = np.random.default_rng(1)
    lengths = generator.integers(1, 60, 20)
    actions = generator.uniform((-60, 0.5, 0), (60, 3, 1), (lengths.sum(), 3)).astype(np.float32)
    actions[: lengths[:10].sum(), 1] = 0.0
    goals = np.column_stack([generator.uniform(150, 250, 20), generator.uniform(-9, 9, 20), np.full(20, -0.0)])
    starts = sim.start(
        scenario.settings,
        speed_mps=generator.uniform(150, 250, 20),
        altitude_m=np.where(np.arange(20) < 10, 5.0, 3000.0),
        conditions=np.array([scenario.conditions]),
    )
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    seeds, sources = generator.integers(0, 2**50, 20), [f"policy {k % 3} äé" for k in range(20)]
    return replay(scenario, goals, actions, offsets, seeds=seeds, sources=sources, starts=starts)


def surface_flights() -> Episodes:
    """Flights by deflections, four actions wide."""
    scenario = Scenario(TASK, sim.Settings("end_to_end"))
    actions = np.tile(np.array([0.0, -1.3, 0.0, 0.2], dtype=np.float32), (90, 1))
    return replay(scenario, [[200, 0, 0], [220, 5, 9], [150, 0, -9]], actions, np.array([0, 30, 60, 90]))


def same(first: Episodes, second: Episodes) -> bool:
    """Whether flights are equal to the last bit, −0 and 0 apart."""
    names = ("offsets", *PER_EPISODE, *PER_TRANSITION)
    pairs = [(getattr(first, name), getattr(second, name)) for name in names]
    return first.scenario == second.scenario and all(
        a.shape == b.shape and a.astype(b.dtype).tobytes() == b.tobytes() and a.dtype.kind == b.dtype.kind
        for a, b in pairs
    )


def without_flights(episodes: Episodes) -> Episodes:
    """The same set, empty."""
    return dataclasses.replace(episodes.select(np.zeros(len(episodes), dtype=np.bool_)))
