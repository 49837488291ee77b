"""Kernels of random numbers: functions of a key and a counter, any of them at any time, in any order; and, for searches, of a state that is an array.

SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014) scrambles key + counter x `GOLDEN`. Normal
deviates are quantiles: Wichura, "Algorithm AS 241: the percentage points of the normal distribution", Applied Statistics 37 (1988).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S32, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(32), np.uint64(11)
_LOW = np.uint64(0xFFFFFFFF)


@compiled_lean
def mixed(z: np.uint64) -> np.uint64:
    """Scramble 64 bits (the finaliser of SplitMix64)."""
    z = (z ^ (z >> _S30)) * MIX_1
    z = (z ^ (z >> _S27)) * MIX_2
    return z ^ (z >> _S31)


@compiled_lean
def _number(key: np.uint64, counter: int) -> np.uint64:
    """Return the 64 bits of a key and a counter."""
    return mixed(key + np.uint64(counter) * GOLDEN)


@compiled
def numbers(key: np.uint64, counters: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return the 64 bits of a key and each of some counters, shape (counters,).

    Takes any key and counters.
    """
    out = np.empty(len(counters), dtype=np.uint64)
    for k in range(len(counters)):
        out[k] = _number(key, counters[k])
    return out


@compiled_lean
def exponential(key: np.uint64, counter: int) -> float:
    """Return a standard exponential deviate: -ln U, U uniform in (0, 1), 53 bits."""
    bits = _number(key, counter) >> _S11
    return -math.log((np.float64(bits) + 0.5) / 9007199254740992.0)


@compiled_lean
def normals(key: np.uint64, counter: int) -> tuple[float, float]:
    """Return two independent standard normal deviates, from the two halves of one number: within 6.4 of 0."""
    bits = _number(key, counter)
    return _quantile((np.float64(bits >> _S32) + 0.5) / 4294967296.0), _quantile(
        (np.float64(bits & _LOW) + 0.5) / 4294967296.0
    )


@compiled_lean
def _quantile(p: float) -> float:
    """Standard normal quantile of a probability in (0, 1), to 1e-7 (PPND7 of AS 241)."""
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        above = ((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179
        return q * above / (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0)
    r = math.sqrt(-math.log(min(p, 1.0 - p)))
    if r <= 5.0:
        r -= 1.6
        z = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) / (
            (0.12021132975 * r + 0.73700164250) * r + 1.0
        )
    else:
        r -= 5.0
        z = (((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150) / (
            (0.012258202635 * r + 0.24197894225) * r + 1.0
        )
    return z if q > 0.0 else -z


@compiled_lean
def uniform(random: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1), the next one of a state."""
    random[0] += GOLDEN
    return float(mixed(random[0]) >> _S11) * 2.0**-53


@compiled_lean
def below(random: NDArray[np.uint64], count: int) -> int:
    """Return one of 0 .. count - 1, by the next number of a state."""
    return int(uniform(random) * count)
