"""Flights of ours as the paper's public code would have written them down."""

import numpy as np
import pandas as pd
import pyarrow as pa

from vvc_bench.datasets.recordings import ACTIONS, GOALS, STATES
from vvc_bench.experts import APPENDIX_C
from vvc_bench.goals import grid
from vvc_bench.rollout import Episodes, Scenario, fly_law
from vvc_bench.tasks import TASKS, make_task

TASK = make_task(
    TASKS["hard"].task,
    rules="demonstration",
    direction_band_deg=1,
    step_limit=600,
    terminations=("reach_target", "crash", "time_limit"),
)
SCENARIO = Scenario(TASK)
NAMES = ["time", *STATES, *ACTIONS, "a_rud"]


def fly() -> Episodes:
    """Flights that the aircraft here repeats bit for bit."""
    return fly_law(SCENARIO, grid([160, 200, 260], [-20, 0, 15], [-60, -10, 0, 45]).goals, APPENDIX_C).episodes


def flights(flown: Episodes) -> list[pd.DataFrame]:
    """One table for each flight, as the public code would have logged it: rows hold the state after the action."""
    states = flown.next_observations.astype(float)
    tables = []
    for start, stop in zip(flown.offsets[:-1], flown.offsets[1:], strict=True):
        time = np.round(np.arange(stop - start) * 0.1, 2)
        rows = np.column_stack([time, states[start:stop], flown.actions[start:stop], np.zeros(stop - start)])
        tables.append(pd.DataFrame(rows, columns=NAMES))
    return tables


def files(flown: Episodes) -> dict[str, str]:
    """The same as files, with an index of the goals flown."""
    written = {}
    index = ["v,mu,chi,length", "300,85,170,0"]
    for goal, table in zip(flown.goals, flights(flown), strict=True):
        name = "_".join(str(int(number)) for number in goal)
        written[f"traj_{name}.csv"] = table.to_csv(index=False)
        index.append(f"{','.join(str(int(number)) for number in goal)},{len(table)}")
    return written | {"res.csv": "\n".join(index)}


def long_table(flown: Episodes, *, goals: bool = True, time: bool = True) -> pa.Table:
    tables = flights(flown)
    for goal, table in zip(flown.goals, tables, strict=True):
        if goals:
            table[list(GOALS[0])] = goal
    whole = pd.concat(tables, ignore_index=True)
    return pa.Table.from_pandas(whole if time else whole.drop(columns="time"), preserve_index=False)
