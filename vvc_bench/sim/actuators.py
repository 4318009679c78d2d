"""What lies between a command and a deflection: nothing by default, else a first-order lag and a rate limit."""

import math

from vvc_bench.jit import kernel
from vvc_bench.sim.fields import Conditions, SurfaceCommand
from vvc_bench.sim.interpolation import clip


@kernel
def _follow(position: float, command: float, time_constant: float, rate_limit: float, time_step: float) -> float:
    if time_constant > 0.0:
        command = position + (command - position) * (1.0 - math.exp(-time_step / time_constant))
    if rate_limit > 0.0:
        command = position + clip(command - position, -rate_limit * time_step, rate_limit * time_step)
    return command


@kernel
def deflect(
    position: SurfaceCommand, command: SurfaceCommand, conditions: Conditions, time_step: float
) -> SurfaceCommand:
    """Deflections and throttle after ``time_step`` seconds of following a command held constant."""
    lag, limit = conditions.actuator_time_constant, conditions.actuator_rate_limit
    if lag == 0.0 and limit == 0.0 and conditions.engine_time_constant == 0.0:
        return command
    return SurfaceCommand(
        _follow(position.aileron, command.aileron, lag, limit, time_step),
        _follow(position.elevator, command.elevator, lag, limit, time_step),
        _follow(position.rudder, command.rudder, lag, limit, time_step),
        _follow(position.throttle, command.throttle, conditions.engine_time_constant, 0.0, time_step),
    )
