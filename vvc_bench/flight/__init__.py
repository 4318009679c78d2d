"""One flight: flown, held as a value, judged against its goal, and written to files.

>>> from vvc_bench import flight, sim
>>> settings = sim.Settings()
>>> state = sim.start(settings)
>>> flown = flight.fly(settings, state, lambda state: [0.0, 1.0, 0.3], seconds=2)
>>> flown.states.shape, flown.commands.shape
((21, 42), (20, 3))
>>> list(flight.to_frame(flown).columns[:3])
['time_s', 'airspeed_mps', 'angle_of_attack_deg']
"""

from vvc_bench.flight.files import FORMATS, available_formats, find_format, write_flight
from vvc_bench.flight.goal import direction_errors, goal_errors, time_to_reach
from vvc_bench.flight.recording import Flight, Pilot, fly, to_frame

__all__ = [
    "FORMATS",
    "Flight",
    "Pilot",
    "available_formats",
    "direction_errors",
    "find_format",
    "fly",
    "goal_errors",
    "time_to_reach",
    "to_frame",
    "write_flight",
]
