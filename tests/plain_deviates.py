"""Deviates of a key and a counter in whole numbers of Python: what `models.jit.random_kernels` is judged by."""

import itertools
import math
from collections.abc import Iterator
from statistics import NormalDist

MASK = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


def scrambled(key: int, counter: int) -> int:
    """SplitMix64: Steele, Lea and Flood (2014)."""
    z = (key + counter * GOLDEN) & MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def plain_exponential(key: int, counter: int) -> float:
    return -math.log(((scrambled(key, counter) >> 11) + 0.5) / 2.0**53)


def plain_exponentials(key: int) -> Iterator[float]:
    return (plain_exponential(key, counter) for counter in itertools.count())


def plain_normals(key: int, counter: int) -> list[float]:
    """Quantiles of the two halves of a number, by the standard library."""
    bits = scrambled(key, counter)
    return [NormalDist().inv_cdf((half + 0.5) / 2.0**32) for half in (bits >> 32, bits & 0xFFFFFFFF)]
