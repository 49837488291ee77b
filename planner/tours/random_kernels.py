"""Kernels of random numbers whose state is an array: SplitMix64, see `models.jit.random_kernels`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.models.jit.random_kernels import GOLDEN, mixed

if TYPE_CHECKING:
    from numpy.typing import NDArray

_S11 = np.uint64(11)


@compiled_lean
def uniform(random: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1)."""
    random[0] += GOLDEN
    return float(mixed(random[0]) >> _S11) * 2.0**-53


@compiled_lean
def below(random: NDArray[np.uint64], count: int) -> int:
    """Return one of 0 .. count - 1."""
    return int(uniform(random) * count)
