"""The named tasks: the paper's problems (its Table 6) and the public code's, each a value and a box of goals."""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.goals import UniformBox
from vvc_bench.sim.fields import checked_inside, columns
from vvc_bench.sim.task import ALL_EVENTS, FAILURES, Event, Penalty, Reward, Rules, Task


class Problem(NamedTuple):
    """A task, and where its goals come from unless something else is asked for."""

    task: Task
    goals: UniformBox


TASKS = {
    "normal": Problem(Task(), UniformBox((150.0, -10.0, -30.0), (250.0, 10.0, 30.0))),
    "medium": Problem(Task(), UniformBox((150.0, -30.0, -60.0), (250.0, 30.0, 60.0))),
    "hard": Problem(Task(), UniformBox((100.0, -85.0, -170.0), (300.0, 85.0, 170.0))),
    "flycraft": Problem(Task(rules=float(Rules.PUBLIC_CODE)), UniformBox((100.0, -90.0, -180.0), (300.0, 90.0, 180.0))),
}
"""``normal`` and ``hard`` are the paper's, ``medium`` is the step that its authors put between them, and ``flycraft``
has the public code's defaults."""

_CHOICES = {"reward": Reward, "penalty": Penalty, "rules": Rules}


def named_problem(name: str) -> Problem:
    """One of `TASKS`.

    Raises:
        ValueError: for an unknown name.
    """
    if name not in TASKS:
        raise ValueError(f"unknown task {name!r}; known are {', '.join(TASKS)}")
    return TASKS[name]


def make_task(task: Task, **changes: object) -> Task:
    """A variant of a task, by column name with its unit: ``make_task(task, reach_steps=30, direction_band_deg=1)``.

    ``reward``, ``penalty`` and ``rules`` also take their names (``"sparse"``), and ``terminations`` names of events
    (``("reach_target", "time_limit")``).

    Raises:
        ValueError: for an unknown field, a value out of bounds, or one that is not a number where one is needed.
    """
    known = columns(Task)
    values = task._asdict()
    for name, value in changes.items():
        if name not in known:
            raise ValueError(f"unknown task field {name!r}; known are {', '.join(known)}")
        inside = checked_inside(name, known[name], _number(name, value))
        values[Task._fields[list(known).index(name)]] = float(inside)
    return Task(**values)


def _number(name: str, value: object) -> float:
    """A task field's value as a number, from a number or from names."""
    try:
        if name in _CHOICES and isinstance(value, str):
            return float(_CHOICES[name][value.upper()])
        if name == "terminations" and isinstance(value, (list, tuple, set, frozenset)):
            chosen = Event(0)
            for event in value:
                chosen |= Event[event.upper()] if isinstance(event, str) else Event(event)
            return float(chosen)
        return float(value)  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError, AttributeError):
        choices = _CHOICES.get(name, Event if name == "terminations" else None)
        allowed = f"one of {', '.join(str(choice.name).lower() for choice in choices)}" if choices else "a number"
        raise ValueError(f"{name} must be {allowed}, got {value!r}") from None


@functools.cache
def termination(task: Task, events: int) -> str:
    """Name of the event that ended an episode, or "" for none: of several the one that decides the reward."""
    if task.rules != Rules.PUBLIC_CODE and events & FAILURES:
        events &= ~Event.TIME_LIMIT
    return (*event_names(events), "")[0]


def task_row(task: Task) -> NDArray[np.float64]:
    """A task as the kernels read it."""
    return np.array(task, dtype=np.float64)


@functools.cache
def event_names(events: int) -> tuple[str, ...]:
    """Names of the set bits, in the order of precedence: ``("crash", "extreme_state")``."""
    return tuple(str(event.name).lower() for event in Event if event in Event(int(events) & ALL_EVENTS))
