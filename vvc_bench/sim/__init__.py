"""The reference aircraft: start it, step it, alone or by the thousand.

>>> from vvc_bench import sim
>>> settings = sim.Settings(control_mode="guidance", dynamics="reference", frequency_hz=10)
>>> state = sim.start(settings, altitude_m=5000, speed_mps=200, heading_deg=0)
>>> state = sim.step(state, [0.0, 1.0, 0.3], settings)
>>> print(f"{sim.State(*state).airspeed:.2f} m/s")
200.10 m/s
"""

from vvc_bench.sim.fields import (
    STILL,
    Conditions,
    Field,
    Goal,
    GuidanceCommand,
    State,
    SurfaceCommand,
    columns,
    fields_of,
)
from vvc_bench.sim.starting import make_conditions, start, start_from
from vvc_bench.sim.stepping import ControlMode, Dynamics, Settings, step, step_many

__all__ = [
    "STILL",
    "Conditions",
    "ControlMode",
    "Dynamics",
    "Field",
    "Goal",
    "GuidanceCommand",
    "Settings",
    "State",
    "SurfaceCommand",
    "columns",
    "fields_of",
    "make_conditions",
    "start",
    "start_from",
    "step",
    "step_many",
]
