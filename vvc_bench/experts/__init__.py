"""Pilots that need no training.

>>> from vvc_bench import sim
>>> from vvc_bench.experts import Goal, pid_commands
>>> settings = sim.Settings(control_mode="guidance")
>>> states = sim.start(settings, speed_mps=[200.0, 250.0])
>>> goals = [Goal(speed=220.0, path_angle=0.35, azimuth=-1.05)] * 2
>>> pid_commands(states, goals).shape
(2, 3)
"""

from vvc_bench.experts.pid import (
    APPENDIX_C,
    WEIGHT_COMPENSATED,
    PidParameters,
    pid_command,
    pid_commands,
)
from vvc_bench.experts.pursuit import PURSUIT, PursuitParameters, pursuit_command, pursuit_commands
from vvc_bench.sim.fields import Goal

__all__ = [
    "APPENDIX_C",
    "PURSUIT",
    "WEIGHT_COMPENSATED",
    "Goal",
    "PidParameters",
    "PursuitParameters",
    "pid_command",
    "pid_commands",
    "pursuit_command",
    "pursuit_commands",
]
