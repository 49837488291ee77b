"""Deviates that are functions of a key and a counter, against whole numbers of Python and distributions of scipy."""

import math
from statistics import NormalDist

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import expon, kstest, norm

from skyway.models.jit.random_kernels import exponential, mixed, normals

MASK = 2**64 - 1


def scrambled(key: int, counter: int) -> int:
    """SplitMix64: Steele, Lea and Flood (2014)."""
    z = (key + counter * 0x9E3779B97F4A7C15) & MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def test_numbers_are_those_that_were_published():
    """The first outputs of SplitMix64 for the seed 1234567, as of its reference implementation."""
    golden, state = 0x9E3779B97F4A7C15, 1234567
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [int(mixed(np.uint64((state + k * golden) & MASK))) for k in range(1, 5)] == published


@given(st.integers(0, MASK), st.integers(0, 2**40))
def test_deviates_are_quantiles_of_the_numbers(key, counter):
    bits = scrambled(key, counter)
    expected = [NormalDist().inv_cdf((half + 0.5) / 2.0**32) for half in (bits >> 32, bits & 0xFFFFFFFF)]
    assert np.abs(np.array(normals(np.uint64(key), counter)) - expected).max() < 1e-6
    assert math.isclose(exponential(np.uint64(key), counter), -math.log(((bits >> 11) + 0.5) / 2.0**53), rel_tol=1e-12)


def test_deviates_have_their_distributions_and_are_independent():
    pairs = np.array([normals(np.uint64(key), counter) for key in (0, 1, 2**63) for counter in range(7000)])
    assert kstest(pairs[:, 0], norm.cdf).pvalue > 1e-3
    assert kstest(pairs[:, 1], norm.cdf).pvalue > 1e-3
    lags = [np.corrcoef(pairs[lag:, 0], pairs[: len(pairs) - lag, 1])[0, 1] for lag in range(4)]
    lags += [np.corrcoef(pairs[lag:, 0], pairs[: len(pairs) - lag, 0])[0, 1] for lag in range(1, 4)]
    assert np.abs(lags).max() < 4.0 / len(pairs) ** 0.5
    times = np.array([exponential(np.uint64(5), counter) for counter in range(20_000)])
    assert (times > 0.0).all()
    assert kstest(times, expon.cdf).pvalue > 1e-3
