"""Protocols: which goals a policy is judged on, under which rules, in which conditions.

A name's meaning never changes: another figure is a new version. `Protocol.hash` covers all of it, and the tests hold
the hash of every name.
"""

import dataclasses
import difflib
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.datasets.catalogue import LEARNED, PAPER_GRID, GoalGrid
from vvc_bench.envs.sub_goals import TURN_CLIMB
from vvc_bench.rollout import Scenario
from vvc_bench.sim.fields import STILL, Conditions
from vvc_bench.tasks import TASKS, make_task

Triple: TypeAlias = tuple[float, float, float]

REGIONS = 10
"""Equal parts of each axis of a box for which success is counted."""

_TEST, _VALIDATION, _EPISODES = 1, 2, 3  # streams of random numbers that have nothing in common
_LARGE = 1000
_SEED_BITS = 53
"""`Conditions.seed` is a float64: larger whole numbers it does not hold."""
_HELD_OUT = "held-out"


@dataclass(frozen=True)
class Drawn:
    """Points uniform in a box; those of the same entropy lie alike in each box."""

    low: Triple
    high: Triple
    count: int
    entropy: tuple[int, ...]

    @property
    def values(self) -> NDArray[np.float64]:
        """Shape (count, 3), rounded to float32, as which goals are seen and stored."""
        generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(self.entropy)))
        low, high = np.array(self.low), np.array(self.high)
        drawn: NDArray[np.float64] = low + (high - low) * generator.random((self.count, 3))
        return drawn.astype(np.float32).astype(np.float64)

    @property
    def edges(self) -> tuple[NDArray[np.float64], ...]:
        """Bounds of the regions along each axis."""
        return tuple(np.linspace(low, high, REGIONS + 1) for low, high in zip(self.low, self.high, strict=True))


@dataclass(frozen=True)
class Protocol:
    """What a policy is judged on.

    Args:
        name: never to mean anything else.
        summary: one line.
        scenario: rules, settings and start; its conditions are the first of ``conditions``.
        drawn: the goals: a box, or a grid. Where there are sub-goals, the starts: altitude in m, true airspeed in m/s,
            heading in degrees.
        conditions: goal i is flown in ``conditions[i % len(conditions)]``, with its own seed of gusts and noise.
        sub_goals: goals one after another within an episode, the same in all; none for one goal an episode.
    """

    name: str
    summary: str
    scenario: Scenario
    drawn: Drawn | GoalGrid
    conditions: tuple[Conditions, ...] = (STILL,)
    sub_goals: tuple[Triple, ...] = ()

    def __len__(self) -> int:
        return len(self._points)

    @functools.cached_property
    def _points(self) -> NDArray[np.float64]:
        points = self.drawn.goals if isinstance(self.drawn, GoalGrid) else self.drawn.values
        points.flags.writeable = False
        return points

    @property
    def goals(self) -> NDArray[np.float64]:
        """Shape (N, 3), in outside units; the last one of sub-goals."""
        return np.tile(self.sub_goals[-1], (len(self), 1)) if self.sub_goals else self._points

    @property
    def starts(self) -> NDArray[np.float64] | None:
        """Shape (N, 3): altitude in m, true airspeed in m/s, heading in degrees; None where all start alike."""
        return self._points if self.sub_goals else None

    @property
    def seeds(self) -> NDArray[np.int64]:
        """What each episode is seeded with in an evaluation with seed 0, shape (N,)."""
        return self.episode_seeds(0)

    def episode_seeds(self, seed: int) -> NDArray[np.int64]:
        """What each episode is seeded with, shape (N,): the same for every policy and every protocol.

        Raises:
            ValueError: for a negative seed.
        """
        if seed < 0:
            raise ValueError(f"seeds must not be negative, got {seed}")
        words = np.random.SeedSequence((_EPISODES, seed)).generate_state(len(self), np.uint64)
        return (words >> np.uint64(64 - _SEED_BITS)).astype(np.int64)

    @property
    def edges(self) -> tuple[NDArray[np.float64], ...] | None:
        """Bounds of the regions of the goal space along each axis; None for every value of a grid on its own."""
        return self.drawn.edges if isinstance(self.drawn, Drawn) and not self.sub_goals else None

    @functools.cached_property
    def scenarios(self) -> tuple[Scenario, ...]:
        """One for each of the conditions."""
        return tuple(dataclasses.replace(self.scenario, conditions=each) for each in self.conditions)

    @functools.cached_property
    def hash(self) -> str:
        """sha256 of all that the protocol is, but for its name and summary."""
        document = {
            "scenarios": [scenario.to_json() for scenario in self.scenarios],
            "sub_goals": self.sub_goals,
            "points_sha256": hashlib.sha256(self._points.astype("<f8").tobytes()).hexdigest(),
            "seeds_sha256": hashlib.sha256(self.seeds.astype("<i8").tobytes()).hexdigest(),
        }
        return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def named_protocol(name: str) -> Protocol:
    """One of `PROTOCOLS`.

    Raises:
        ValueError: for an unknown name; says which are known.
    """
    if name not in PROTOCOLS:
        close = difflib.get_close_matches(name, PROTOCOLS, n=1)
        hint = f"; did you mean {close[0]}?" if close else "."
        raise ValueError(f"unknown protocol {name!r}{hint} Known are {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]


def held_out(protocol: Protocol, submission_sha256: str, announced_seed: int) -> Protocol:
    """The same protocol with goals that nobody could know: drawn from a submission's hash and a seed announced later.

    Of a grid, a thousand goals are drawn from the box around it.

    Raises:
        ValueError: for a hash that is not 64 hexadecimal digits.
    """
    try:
        digest = bytes.fromhex(submission_sha256)
    except ValueError:
        digest = b""
    if len(digest) != hashlib.sha256().digest_size:
        raise ValueError(f"a submission's sha256 has 64 hexadecimal digits, got {submission_sha256!r}")
    known = f"{protocol.hash}:{digest.hex()}:{announced_seed}"
    entropy = (int.from_bytes(hashlib.sha256(known.encode()).digest(), "big"),)
    drawn = protocol.drawn
    if isinstance(drawn, GoalGrid):
        low, high = drawn.goals.min(axis=0).tolist(), drawn.goals.max(axis=0).tolist()
        drawn = Drawn((low[0], low[1], low[2]), (high[0], high[1], high[2]), _LARGE, entropy)
    else:
        drawn = dataclasses.replace(drawn, entropy=entropy)
    name = f"{protocol.name}-{_HELD_OUT}-{digest.hex()[:8]}-{announced_seed}"
    return dataclasses.replace(protocol, name=name, drawn=drawn)


def _box(task: str, stream: int, count: int = _LARGE) -> Drawn:
    goals = TASKS[task].goals
    return Drawn(goals.low, goals.high, count, (stream,))


def _on_task(task: str) -> list[Protocol]:
    """The protocols that every task has."""
    scenario = Scenario(TASKS[task].task)
    end_to_end = dataclasses.replace(scenario, settings=sim.Settings("end_to_end"))
    box = TASKS[task].goals
    where = " × ".join(f"[{low:g}, {high:g}]" for low, high in zip(box.low, box.high, strict=True))
    return [
        Protocol(f"{task}-1k-v0", f"1,000 goals uniform in {where}", scenario, _box(task, _TEST)),
        Protocol(f"{task}-end-to-end-1k-v0", "the same, commanding the surfaces", end_to_end, _box(task, _TEST)),
        Protocol(
            f"{task}-validation-v0", "1,000 other goals, to choose policies by", scenario, _box(task, _VALIDATION)
        ),
        Protocol(
            f"{task}-sets-validation-v0",
            "the same, under the rules that the sets of learned flights are kept by",
            LEARNED,
            _box(task, _VALIDATION),
        ),
        Protocol(
            f"{task}-end-to-end-validation-v0",
            "1,000 other goals, commanding the surfaces",
            end_to_end,
            _box(task, _VALIDATION),
        ),
    ]


_HARD = Scenario(TASKS["hard"].task)


def _held_for(steps: int) -> Protocol:
    """The paper's non-Markovian variants: inside the bands for so many steps."""
    scenario = dataclasses.replace(_HARD, task=make_task(_HARD.task, reach_steps=steps))
    plural = "steps in a row" if steps > 1 else "step"
    return Protocol(
        f"hard-nmr{steps}-1k-v0", f"reached after {steps} {plural} in the bands", scenario, _box("hard", _TEST)
    )


def _conditions(**values: float) -> Conditions:
    """Conditions by column name, in outside units."""
    return Conditions(*sim.make_conditions(**values)[0].tolist())


_WIND_MPS, _GUST_MPS, _OFFSET = 10.0, 3.0, 0.15
_COMPASS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
_ACTUATOR = {"actuator_time_constant_s": 0.0495, "actuator_rate_limit_degps": 60.0, "engine_time_constant_s": 1.0}
"""First-order lag of 20.2 rad/s and 60 deg/s as for the F-16's elevator (Stevens and Lewis, "Aircraft Control and
Simulation", 2nd ed., section 3.5), and an engine that takes a second."""

_WINDS = tuple({"wind_north_mps": _WIND_MPS * north, "wind_east_mps": _WIND_MPS * east} for north, east in _COMPASS)
_EVERYTHING = {"gust_intensity_mps": _GUST_MPS, "delay_steps": 1.0, "sensor_noise": 1.0} | _ACTUATOR

_DISTURBED: dict[str, tuple[str, tuple[Conditions, ...]]] = {
    "wind": (
        "steady wind of 10 m/s, in turn to the north, east, south and west",
        tuple(_conditions(**w) for w in _WINDS),
    ),
    "gusts": ("Dryden gusts of 3 m/s (rms)", (_conditions(gust_intensity_mps=_GUST_MPS),)),
    "density": (
        "air 15 % denser and thinner in turn",
        tuple(_conditions(density_offset=x) for x in (_OFFSET, -_OFFSET)),
    ),
    "mass": ("mass 15 % larger and smaller in turn", tuple(_conditions(mass_offset=x) for x in (_OFFSET, -_OFFSET))),
    "actuator": (
        "surfaces lag by 0.05 s and move by 60 deg/s at most, the engine lags by 1 s",
        (_conditions(**_ACTUATOR),),
    ),
    "delay": ("commands take effect 1 and 2 steps late in turn", tuple(_conditions(delay_steps=x) for x in (1.0, 2.0))),
    "noise": ("sensor noise", (_conditions(sensor_noise=1.0),)),
    "all": (
        "all of these at once, delay 1 step, mass and density off to either side",
        tuple(
            _conditions(**wind, **_EVERYTHING, mass_offset=mass, density_offset=density)
            for wind, mass, density in zip(
                _WINDS, (_OFFSET, _OFFSET, -_OFFSET, -_OFFSET), (_OFFSET, -_OFFSET, _OFFSET, -_OFFSET), strict=True
            )
        ),
    ),
}


def _robust(what: str) -> Protocol:
    """The goals of hard-1k-v0 in conditions that the paper leaves out (its Appendix N)."""
    summary, conditions = _DISTURBED[what]
    scenario = dataclasses.replace(_HARD, conditions=conditions[0])
    return Protocol(f"robust-{what}-1k-v0", summary, scenario, _box("hard", _TEST), conditions)


PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {
        protocol.name: protocol
        for protocol in (
            *(protocol for task in ("normal", "medium", "hard") for protocol in _on_task(task)),
            Protocol("hard-grid-v0", "the paper's grid, all 50,715 goals", _HARD, PAPER_GRID),
            *map(_held_for, (1, 10, 20, 30)),
            Protocol(
                "turn-climb-v0",
                "three sub-goals in a row (Fig. 5), from 1,000 starts",
                _HARD,
                Drawn((3000.0, 150.0, -60.0), (7000.0, 250.0, 60.0), _LARGE, (_TEST,)),
                sub_goals=TURN_CLIMB,
            ),
            *map(_robust, _DISTURBED),
        )
    }
)
"""Every protocol by name."""
