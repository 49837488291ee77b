"""Deviates that are functions of a key and a counter, against whole numbers of Python and distributions of scipy."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import expon, kstest, norm

from skyway.models.jit.random_kernels import exponential, mixed, normals, numbers
from tests.plain_deviates import GOLDEN, MASK, plain_exponential, plain_normals, scrambled


def test_numbers_are_those_that_were_published():
    """The first outputs of SplitMix64 for the seed 1234567, as of its reference implementation."""
    state = 1234567
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [int(mixed(np.uint64((state + k * GOLDEN) & MASK))) for k in range(1, 5)] == published


@given(st.integers(0, MASK), st.integers(0, 2**40))
def test_deviates_are_quantiles_of_the_numbers(key, counter):
    assert np.abs(np.array(normals(np.uint64(key), counter)) - plain_normals(key, counter)).max() < 1e-6
    assert math.isclose(exponential(np.uint64(key), counter), plain_exponential(key, counter), rel_tol=1e-12)


def test_numbers_of_several_counters_are_those_of_each():
    counters = np.array([0, 7, -1, 2**40])
    found = numbers(np.uint64(99), counters)
    assert [int(one) for one in found] == [scrambled(99, counter) for counter in counters.tolist()]


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
