"""The two tables of a dataset: their columns, and flights as these columns and back.

Names, units and meanings come from `vvc_bench.sim.fields`. Transitions and goals have outside units; the states that
episodes start from have inside ones, as only these give the same flight again, bit for bit.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes, Scenario
from vvc_bench.rollout.episodes import PER_EPISODE, PER_TRANSITION
from vvc_bench.sim.fields import Field, Goal, Observation, State, SurfaceCommand, columns, fields_of
from vvc_bench.tasks import termination

if TYPE_CHECKING:
    import pyarrow as pa

ROWS_OF_A_GROUP = 16_384
"""A row group ends with the first episode that begins so many rows after the group's nominal start, or later."""

Values = dict[str, NDArray[Any]]


class Column(NamedTuple):
    """What is known of one column."""

    type: str
    """As NumPy and Arrow both name it."""
    unit: str
    meaning: str
    few_values: bool = False
    """So few distinct ones that a dictionary is smaller."""


OBSERVED = tuple(columns(Observation))
DEFLECTIONS = tuple(columns(SurfaceCommand))
LOAD_FACTOR = tuple(columns(State))[State._fields.index("load_factor")]


def transition_columns(scenario: Scenario) -> dict[str, Column]:
    """Columns of the table of transitions, in order."""
    flown = {name: columns(State)[name] for name in (*DEFLECTIONS, LOAD_FACTOR)}
    return {
        "episode": Column("int32", "", "episode that the transition belongs to", few_values=True),
        "step": Column("int32", "", "steps of the episode before this one"),
        **_outside(columns(Observation), "float32", "seen before the action: "),
        **_outside(columns(scenario.settings.command_fields), "float32", "action: ", "action_"),
        "reward": Column("float32", "", "reward of the step"),
        "terminated": Column("bool", "", "the task ended the episode with this step"),
        "truncated": Column("bool", "", "the episode was cut off after this step"),
        "events": Column("uint8", "", "why the episode ended with this step: bits of Event", few_values=True),
        **_outside(flown, "float32", "flown in the step: "),
    }


def episode_columns(scenario: Scenario) -> dict[str, Column]:
    """Columns of the table of episodes, in order."""
    goals = {
        name: column._replace(few_values=True)
        for name, column in _outside(columns(Goal), "float64", "", "goal_").items()
    }
    return {
        "episode": Column("int32", "", "index of the episode"),
        **goals,
        "seed": Column("int64", "", "seed of gusts and sensor noise"),
        "source": Column("str", "", "where the flight came from", few_values=True),
        "length": Column("int32", "", "transitions of the episode"),
        "first_transition": Column("int64", "", "row of its first transition"),
        "row_group": Column("int32", "", "row group that holds its transitions"),
        "outcome": Column("str", "", "event that ended the episode, or none", few_values=True),
        "final_events": Column("uint8", "", "every event of its last step: bits of Event", few_values=True),
        "return": Column("float64", "", "sum of its rewards"),
        **_outside(columns(Observation), "float32", "seen at the end: ", "final_"),
        **_start_columns(scenario),
    }


def _outside(fields: Mapping[str, Field], kind: str, meaning: str, prefix: str = "") -> dict[str, Column]:
    return {
        prefix + name: Column(kind, field.unit.outside or field.unit.inside, meaning + field.meaning)
        for name, field in fields.items()
    }


def _start_columns(scenario: Scenario) -> dict[str, Column]:
    """A state row in inside units, the commands on their way at its end among them."""
    known = {"start_" + name: field for name, field in fields_of(State).items()}
    commands: type[tuple[float, ...]] = scenario.settings.command_fields
    for slot in range(int(scenario.conditions.delay_steps)):
        known |= {f"start_delayed_{slot}_{name}": field for name, field in fields_of(commands).items()}
    return {
        "_".join(filter(None, (name, _suffix(field)))): Column("float64", field.unit.inside, "start: " + field.meaning)
        for name, field in known.items()
    }


def _suffix(field: Field) -> str:
    """A field's inside unit as the end of a column's name: ``rad``, ``radps``; nothing for plain numbers."""
    return field.unit.inside.replace("/", "p").lower() if field.unit.outside else ""


class Layout(NamedTuple):
    """Which columns hold each array of `Episodes`."""

    transitions: dict[str, tuple[str, ...]]
    episodes: dict[str, tuple[str, ...]]


def layout(scenario: Scenario) -> Layout:
    """Where each array of `Episodes` is stored; all other columns follow from these."""
    actions = tuple("action_" + name for name in columns(scenario.settings.command_fields))
    transitions = (OBSERVED, actions, ("reward",), ("events",), DEFLECTIONS, (LOAD_FACTOR,))
    goals = tuple("goal_" + name for name in columns(Goal))
    final = tuple("final_" + name for name in OBSERVED)
    episodes = (goals, ("seed",), ("source",), tuple(_start_columns(scenario)), final)
    return Layout(
        dict(zip(PER_TRANSITION, transitions, strict=True)),
        dict(zip(PER_EPISODE, episodes, strict=True)),
    )


def transition_values(episodes: Episodes) -> Values:
    """The table of transitions."""
    terminated, truncated = episodes.ends
    steps = np.arange(len(episodes.rewards)) - np.repeat(episodes.offsets[:-1], episodes.lengths)
    values = {
        "episode": episodes.transition_episodes().astype(np.int32),
        "step": steps.astype(np.int32),
        "terminated": terminated,
        "truncated": truncated,
        **_split(episodes, layout(episodes.scenario).transitions),
    }
    return {name: values[name] for name in transition_columns(episodes.scenario)}


def episode_values(episodes: Episodes) -> Values:
    """The table of episodes."""
    names = {
        events: termination(episodes.scenario.task, events) or "none"
        for events in np.unique(episodes.final_events).tolist()
    }
    first = episodes.offsets[:-1]
    values = {
        "episode": np.arange(len(episodes), dtype=np.int32),
        "length": episodes.lengths.astype(np.int32),
        "first_transition": first.astype(np.int64),
        "row_group": row_groups(episodes.offsets),
        "outcome": np.array([names[events] for events in episodes.final_events.tolist()], dtype=np.str_),
        "final_events": episodes.final_events,
        "return": np.add.reduceat(episodes.rewards.astype(np.float64), first) if len(first) else np.zeros(0),
        **_split(episodes, layout(episodes.scenario).episodes),
    }
    return {name: values[name] for name in episode_columns(episodes.scenario)}


def row_groups(offsets: NDArray[np.int64]) -> NDArray[np.int32]:
    """Which row group each episode is in, shape (E,)."""
    _, group = np.unique(offsets[:-1] // ROWS_OF_A_GROUP, return_inverse=True)
    return group.astype(np.int32)


def arrays_of(values: Mapping[str, NDArray[Any]], stored: Mapping[str, tuple[str, ...]]) -> dict[str, Any]:
    """Arrays of `Episodes` from one of the tables, as `layout` says; they may be views of its columns."""
    return {attribute: _joined([values[name] for name in names]) for attribute, names in stored.items()}


def _split(episodes: Episodes, stored: dict[str, tuple[str, ...]]) -> Values:
    values: Values = {}
    for attribute, names in stored.items():
        array = np.atleast_2d(getattr(episodes, attribute).T)
        values |= dict(zip(names, np.ascontiguousarray(array), strict=True))
    return values


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.stack(parts, axis=1)


def arrow_schema(known: Mapping[str, Column]) -> "pa.Schema":
    """The same for Arrow, unit and meaning as metadata of each field."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field(name, column.type, nullable=False, metadata={"unit": column.unit, "meaning": column.meaning})
            for name, column in known.items()
        ]
    )
