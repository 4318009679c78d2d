"""How smoothly variables change in flight: s₁ and s₂ of the paper's eqs 23 and 24, as its Table 12 has them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vvc_bench.rollout import Episodes
from vvc_bench.sim.fields import Field, Observation, columns

_FULL_TURN = 360.0


class Smoothness(NamedTuple):
    """Both measures of every episode and variable; smaller is smoother."""

    columns: tuple[str, ...]
    """C variables: what was seen, or the components of the action, in outside units."""
    s1: NDArray[np.float64]
    """Shape (E, C), eq. 23, in the variable's unit."""
    s2: NDArray[np.float64]
    """Shape (E, C), eq. 24 divided by the length, in the variable's unit for each step."""


def observation_smoothness(episodes: Episodes, *, unwrapped: bool = False) -> Smoothness:
    """Smoothness of what was seen before each action.

    Args:
        episodes: E flights.
        unwrapped: follow bank, heading and azimuth past ±180°. Table 12 takes them as they are, so a flight to the
            south counts jumps of 360° that the aircraft never made.
    """
    known = columns(Observation)
    angles = [wraps(field) for field in known.values()] if unwrapped else [False] * len(known)
    return _smoothness(episodes, episodes.observations, tuple(known), angles)


def action_smoothness(episodes: Episodes) -> Smoothness:
    """Smoothness of the commands."""
    known = tuple(columns(episodes.scenario.settings.command_fields))
    return _smoothness(episodes, episodes.actions, known, [False] * len(known))


def wraps(field: Field) -> bool:
    """Whether a quantity goes round: an angle whose bounds are a full turn apart."""
    return field.unit.outside == "deg" and round((field.high - field.low) * field.unit.scale, 3) == _FULL_TURN


def frequency_weighted_amplitude(signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """s₁ of signals of one length: the mean over the spectrum of amplitude times frequency.

    With N samples the paper's own choices are: the first n = ⌊N/2⌋ bins of the discrete Fourier transform, the one at
    zero frequency among them; amplitude 2/N·|X|; frequencies from 0 to 1 in n equal parts, as a share of half the
    sampling rate (linspace(0, 1, n): the last bin is thus counted as that half, though it lies just below).

    Args:
        signals: shape (..., N).

    Returns:
        Shape (...,), in the signals' unit; 0 for fewer than four samples, which have no second bin.
    """
    samples = signals.shape[-1]
    bins = samples // 2
    if bins < 2:
        return np.zeros(signals.shape[:-1])
    amplitudes = np.abs(np.fft.rfft(signals)[..., :bins]) * (2.0 / samples)
    mean: NDArray[np.float64] = (amplitudes * np.linspace(0.0, 1.0, bins)).sum(axis=-1) / bins
    return mean


def mean_change(signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """s₂ of signals of one length, divided by it: the sum of the absolute changes from sample to sample over N.

    Args:
        signals: shape (..., N).

    Returns:
        Shape (...,), in the signals' unit for each step.
    """
    change: NDArray[np.float64] = np.abs(np.diff(signals)).sum(axis=-1) / signals.shape[-1]
    return change


def _smoothness(
    episodes: Episodes, values: NDArray[np.float32], names: tuple[str, ...], unwrapped: list[bool]
) -> Smoothness:
    """Both measures; episodes of one length go through the transform together."""
    lengths = episodes.lengths
    s1, s2 = np.zeros((len(episodes), len(names))), np.zeros((len(episodes), len(names)))
    for length in np.unique(lengths):
        same = np.flatnonzero(lengths == length)
        rows = episodes.offsets[same][:, None] + np.arange(length)
        signals = np.moveaxis(values[rows].astype(np.float64), -1, 1)  # episode, variable, time
        if any(unwrapped):
            signals[:, unwrapped] = np.unwrap(signals[:, unwrapped], period=_FULL_TURN)
        signals = np.ascontiguousarray(signals)
        s1[same], s2[same] = frequency_weighted_amplitude(signals), mean_change(signals)
    return Smoothness(names, s1, s2)
