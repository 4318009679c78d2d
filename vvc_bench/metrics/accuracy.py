"""How near to their goals flights end, and what they were rewarded with."""

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Goal, Observation

_GOAL = [Observation._fields.index(name) for name in Goal._fields]
_AZIMUTH = Goal._fields.index("azimuth")


def final_errors(episodes: Episodes, seconds: float = 1.0) -> NDArray[np.float64]:
    """Mean absolute errors over each episode's last second: the accuracy columns of the paper's Table 1.

    The reports that count are those made after steps, the final one included and the start not; a shorter episode
    counts whole.

    Args:
        episodes: E flights.
        seconds: how long "the last second" is.

    Returns:
        Shape (E, 3): |Δv| in m/s, |Δμ| and |Δχ| in degrees, the azimuth's by the shorter way round.
    """
    ends, lengths = episodes.offsets[1:], episodes.lengths
    window = np.minimum(max(1, round(seconds * episodes.scenario.settings.frequency_hz)), lengths)
    total = _errors(episodes.final_observations, episodes.goals)
    for back in range(1, int(window.max(initial=0))):
        inside = np.flatnonzero(window > back)
        total[inside] += _errors(episodes.observations[ends[inside] - back], episodes.goals[inside])
    return total / window[:, None]


def _errors(seen: NDArray[np.float32], goals: NDArray[np.float64]) -> NDArray[np.float64]:
    errors = np.abs(seen[:, _GOAL].astype(np.float64) - goals)
    errors[:, _AZIMUTH] = np.minimum(errors[:, _AZIMUTH], 360.0 - errors[:, _AZIMUTH])
    return errors


def returns(episodes: Episodes) -> NDArray[np.float64]:
    """Sum of each episode's rewards, shape (E,)."""
    first = episodes.offsets[:-1]
    return np.add.reduceat(episodes.rewards.astype(np.float64), first) if len(first) else np.zeros(0)
