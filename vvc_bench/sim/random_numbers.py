"""Counter-based random numbers: a pure function of (seed, counter), so gusts do not depend on batch, order or threads.

Threefry-2x32 with 20 rounds (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011; Random123). All
words fit 32 bits inside a signed 64-bit integer, so that compiled and plain Python agree.
"""

import math

from vvc_bench.jit import kernel

_MASK = 0xFFFFFFFF
_PARITY = 0x1BD11BDA
_ROUNDS = 20
_ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)


@kernel
def threefry(key_0: int, key_1: int, counter_0: int, counter_1: int) -> tuple[int, int]:
    """Two random 32-bit words from two key words and two counter words."""
    key_2 = _PARITY ^ key_0 ^ key_1
    a = (counter_0 + key_0) & _MASK
    b = (counter_1 + key_1) & _MASK
    for turn in range(_ROUNDS):
        a = (a + b) & _MASK
        bits = _ROTATIONS[turn % 8]
        b = (((b << bits) | (b >> (32 - bits))) & _MASK) ^ a
        if turn % 4 == 3:
            key_0, key_1, key_2 = key_1, key_2, key_0
            a = (a + key_0) & _MASK
            b = (b + key_1 + (turn + 1) // 4) & _MASK
    return a, b


@kernel
def standard_normals(seed: int, counter: int) -> tuple[float, float]:
    """Two independent standard normal numbers (Box–Muller) for one seed and counter, each from 0 to 2⁵³."""
    a, b = threefry(seed & _MASK, seed >> 32, counter & _MASK, counter >> 32)
    radius = math.sqrt(-2.0 * math.log((a + 1.0) / (_MASK + 1.0)))
    angle = 2.0 * math.pi * (b / (_MASK + 1.0))
    return radius * math.cos(angle), radius * math.sin(angle)
