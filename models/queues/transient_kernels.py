"""Kernels of the M/M/c queue: its distribution over time, and the waits that follow from it.

The line has no limit, so states are dropped where they no longer matter: after each step the highest states
are cut while their total stays under a budget. The window of states thus follows the probability, also
through hours with more load than the pads can serve.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]

MAX_STATES = 20_000
"""A line that may grow beyond this many drones is an error of the input."""
MAX_JUMPS = 100.0
"""Expected jumps of one uniformization step; exp(-100) is far from underflow."""
_MAX_TERMS = 256


@compiled_lean
def _poisson_weights(jumps: float, weight: Floats) -> int:
    """Fill `weight` with Poisson probabilities that sum to 1; return how many."""
    term = math.exp(-jumps)
    weight[0] = term
    total = term
    count = 1
    while count < _MAX_TERMS and (count <= jumps or term > 1e-14):
        term *= jumps / count
        weight[count] = term
        total += term
        count += 1
    for j in range(count):
        weight[j] /= total
    return count


@compiled_lean
def _jump(
    current: Floats,
    after: Floats,
    total: Floats,
    pads: int,
    rates: tuple[float, float],
    size: int,
    weight: float,
) -> None:
    """One jump of the uniformized chain: `after` = `current` P on states below `size`; adds it to `total`."""
    up, down = rates
    low = min(pads, size)
    for n in range(low):
        value = (1.0 - up - n * down) * current[n] + (n + 1) * down * current[n + 1]
        if n > 0:
            value += up * current[n - 1]
        after[n] = value
        total[n] += weight * value
    if size <= pads:
        return
    rest = size - pads
    below = current[pads - 1 : size - 1]
    above = current[pads + 1 : size + 1]
    target = after[pads:size]
    summed = total[pads:size]
    out = pads * down
    for n in range(rest):
        value = up * below[n] + out * above[n]
        target[n] = value
        summed[n] += weight * value


@compiled
def _spread(
    state: tuple[Floats, Floats, Floats, int],
    pads: int,
    rates: tuple[float, float],
    weight: Floats,
    cut: float,
) -> tuple[tuple[Floats, Floats, Floats, int], float]:
    """Spread a distribution over a Poisson number of jumps; return it with the mass cut off its upper end.

    The state is (probabilities, two work arrays, number of states in use).
    """
    total, current, after, top = state
    count = len(weight)
    if top + count + 2 > len(total):
        size = 2 * (top + count)
        grown = np.zeros(size)
        grown[:top] = total[:top]
        total, current, after = grown, np.zeros(size), np.zeros(size)
    for n in range(top + count + 1):
        current[n] = total[n]
        after[n] = 0.0
        total[n] *= weight[0]
    for j in range(1, count):
        _jump(current, after, total, pads, rates, top + j, weight[j])
        current, after = after, current
    top += count - 1
    tail = 0.0
    while top > 1 and tail + total[top - 1] < cut:
        top -= 1
        tail += total[top]
        total[top] = 0.0
    return (total, current, after, top), tail


@compiled
def transient_distributions(
    initial: Floats,
    pads: int,
    arrivals: Floats,
    services: Floats,
    slot_s: float,
    begin_s: float,
    times_s: Floats,
    cut: float,
) -> tuple[Floats, float]:
    """Compute distributions at `times_s`, and the mass lost; -1 says that the line grew too long.

    Takes a distribution, rates from 0 up and ascending times from `begin_s` on, all finite; `models.queues.transient` checks them.
    """
    weight = np.empty(_MAX_TERMS)
    widest = len(initial)
    size = 2 * (widest + pads + _MAX_TERMS)
    start = np.zeros(size)
    start[:widest] = initial
    state = (start, np.zeros(size), np.zeros(size), widest)
    out = np.zeros((len(times_s), 64 + 2 * widest))
    lost = 0.0
    now = begin_s
    last = len(arrivals) - 1
    slot = min(int(begin_s / slot_s), last)
    for i in range(len(times_s)):
        while now < times_s[i]:
            until = times_s[i]
            ends = False
            if slot < last and (slot + 1) * slot_s <= until:
                until = (slot + 1) * slot_s
                ends = True
            rate = arrivals[slot] + pads * services[slot]
            jumps = rate * (until - now)
            pieces = math.ceil(jumps / MAX_JUMPS)
            count = _poisson_weights(jumps / max(pieces, 1), weight)
            for _ in range(pieces):
                state, tail = _spread(state, pads, (arrivals[slot] / rate, services[slot] / rate), weight[:count], cut)
                lost += tail
                if state[3] > MAX_STATES:
                    return out, -1.0
            now = until
            if ends:
                slot += 1
        top = state[3]
        widest = max(widest, top)
        if top > out.shape[1]:
            wider = np.zeros((len(times_s), 2 * top))
            wider[:i, : out.shape[1]] = out[:i]
            out = wider
        out[i, :top] = state[0][:top]
    return out[:, :widest].copy(), lost


@compiled
def _earlier(means: Floats, pads: int, service: float, duration: float, weight: Floats) -> Floats:
    """Mean times until the k-th departure, as seen `duration` before `means`, while all pads stay busy."""
    pieces = math.ceil(pads * service * duration / MAX_JUMPS)
    count = _poisson_weights(pads * service * duration / max(pieces, 1), weight)
    for _ in range(pieces):
        before = np.zeros_like(means)
        inside = 0.0  # expected departures within the piece, not counting beyond the k-th
        over = 1.0  # probability of more than k - 1 departures
        for k in range(1, len(means)):
            if k - 1 < count:
                over = max(over - weight[k - 1], 0.0)
                inside += over
            else:
                over = 0.0
            before[k] = inside / (pads * service)
        for j in range(count):
            share = weight[j]
            target = before[j + 1 :]
            source = means[1 : max(len(means) - j, 1)]
            for k in range(len(source)):
                target[k] += share * source[k]
        means = before
    return means


@compiled
def expected_waits(distribution: Floats, pads: int, services: Floats, slot_s: float, times_s: Floats) -> Floats:
    """Compute the mean wait of an arrival at each of `times_s`; after the last slot its rate goes on.

    Backwards in time: the mean time until the k-th departure from pads that are all busy, weighted with the
    probability that the arrival needs the k-th.

    Takes rates above 0 and ascending times from the first slot on; `models.queues.transient` checks them.
    """
    points, states = distribution.shape
    waits = np.zeros(points)
    kinds = max(states - pads + 1, 1)
    weight = np.empty(_MAX_TERMS)
    slot = len(services) - 1
    means = np.arange(kinds) / (pads * services[slot])
    now = max(times_s[points - 1], slot * slot_s)
    constant = np.all(services[min(int(times_s[0] / slot_s), slot) :] == services[slot])
    for i in range(points - 1, -1, -1):
        while now > times_s[i] and not constant:
            back = times_s[i]
            if slot > 0 and slot * slot_s >= now:
                slot -= 1
                continue
            back = max(back, slot * slot_s)
            means = _earlier(means, pads, services[slot], now - back, weight)
            now = back
        for k in range(1, kinds):
            waits[i] += distribution[i, pads + k - 1] * means[k]
    return waits
