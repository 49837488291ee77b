"""Kernels of random numbers whose state is an array: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@compiled_lean
def mixed(state: np.uint64) -> np.uint64:
    """Return the output of SplitMix64 for a state."""
    z = (state ^ (state >> _S30)) * MIX_1
    z = (z ^ (z >> _S27)) * MIX_2
    return z ^ (z >> _S31)


@compiled_lean
def uniform(random: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1)."""
    random[0] += GOLDEN
    return float(mixed(random[0]) >> _S11) * 2.0**-53


@compiled_lean
def below(random: NDArray[np.uint64], count: int) -> int:
    """Return one of 0 .. count - 1."""
    return int(uniform(random) * count)
