"""Kernels of the M/M/c queue: its distribution over time, and the waits that follow from it.

With c pads, arrivals at a rate a (per s) and departures at a rate b from each busy pad, the number n of drones present
is a birth-death chain. Uniformized with the rate r = a + c b, it jumps r times a second on average, by the stochastic
matrix P:

    (p P)[n] = (1 - u - n d) p[n] + u p[n - 1] + (n + 1) d p[n + 1]     for n < c
    (p P)[n] = u p[n - 1] + c d p[n + 1]                                for n >= c

with u = a / r and d = b / r, and p(t + s) = sum over j of w_j p(t) P^j, where w_j = exp(-r s) (r s)^j / j!.

The line has no limit, so states are dropped where they no longer matter: after each step the highest states
are cut while their total stays under a budget. The window of states thus follows the probability, also
through hours with more load than the pads can serve.

Source: Grassmann, "Transient solutions in Markovian queueing systems", Computers & Operations Research 4 (1977);
Stewart, "Introduction to the Numerical Solution of Markov Chains" (1994), section 8.2.
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
    """Fill `weight` with Poisson probabilities that sum to 1; return how many.

    w_0 = exp(-m), w_j = w_(j-1) m / j, m = `jumps`; they end beyond the mean, once below 1e-14, and are scaled to sum
    to 1.
    """
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
    """One jump of the uniformized chain: `after` = `current` P on states below `size`.

    Adds `weight` times that to `total`. `current`, `after` and `total` have shape (states,) and hold at least one state
    more than `size`; `rates` are (u, d).
    """
    up, down = rates
    low = min(pads, size)
    # States with a free pad: n of them leave at the rate n d.
    for n in range(low):
        value = (1.0 - up - n * down) * current[n] + (n + 1) * down * current[n + 1]
        if n > 0:
            value += up * current[n - 1]
        after[n] = value
        total[n] += weight * value
    if size <= pads:
        return
    # States with all pads busy: 1 - u - c d = 0, every jump leads to another state. Slices are vectorised.
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
    """Spread a distribution over a Poisson number of jumps: sum over j of w_j p P^j.

    Also returns the mass cut off its upper end. The state is (p, two work arrays, number of states in use); `rates` are
    (u, d), `weight` the w_j. The highest states are cut while their total is below `cut`. O(states x jumps).
    """
    total, current, after, top = state
    count = len(weight)
    # Each jump reaches one state further up.
    if top + count + 2 > len(total):
        size = 2 * (top + count)
        grown = np.zeros(size)
        grown[:top] = total[:top]
        total, current, after = grown, np.zeros(size), np.zeros(size)
    # j = 0: no jump.
    for n in range(top + count + 1):
        current[n] = total[n]
        after[n] = 0.0
        total[n] *= weight[0]
    # j = 1, 2, ...: p P^j from p P^(j-1).
    for j in range(1, count):
        _jump(current, after, total, pads, rates, top + j, weight[j])
        current, after = after, current
    top += count - 1
    # Cut the upper end.
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
    """Compute the distributions of the number of drones present at some times.

    Takes a distribution, rates from 0 up and ascending times from `begin_s` on, all finite; `models.queues.waiting_times`
    checks them.

    Parameters
    ----------
    initial : ndarray, shape (states,)
        Probabilities of 0, 1, 2, ... drones at `begin_s`.
    pads : int
        c, at least 1.
    arrivals, services : ndarray, shape (slots,)
        Rates a and b, per s, constant within a slot; the last slot has no end.
    slot_s : float
        Length of a slot, s.
    begin_s, times_s : float, ndarray of shape (times,)
        Seconds since the first slot began.
    cut : float
        Mass that each step may lose.

    Returns
    -------
    ndarray, shape (times, states)
        Rows sum to 1 but for what was cut.
    float
        Mass lost in all; -1 says that the line grew beyond `MAX_STATES`.
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
        # Forward to the time asked for, slot by slot: the rates are constant within each.
        while now < times_s[i]:
            until = times_s[i]
            ends = False
            if slot < last and (slot + 1) * slot_s <= until:
                until = (slot + 1) * slot_s
                ends = True
            # Uniformize with r, in pieces of `MAX_JUMPS` expected jumps at most.
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
        # Note the row; rows grow with the line.
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
    """Mean times until the k-th departure, seen `duration` before `means`, while all pads stay busy.

    In a piece of s seconds N departures are Poisson with mean c b s. With M_k the mean time until the k-th,

        M_k(t) = E[min(k, N)] / (c b) + sum over j < k of P(N = j) M_(k-j)(t + s):

    the first part is the expected time within the piece (departures counted up to the k-th come at the rate c b), and
    E[min(k, N)] = sum over i = 1..k of P(N >= i).

    `means` are M_0 = 0, M_1, ... in s, shape (kinds,); `service` is b, per s; `weight` is working space.
    """
    pieces = math.ceil(pads * service * duration / MAX_JUMPS)
    count = _poisson_weights(pads * service * duration / max(pieces, 1), weight)
    for _ in range(pieces):
        before = np.zeros_like(means)
        # The time within the piece.
        inside = 0.0  # expected departures within the piece, not counting beyond the k-th
        over = 1.0  # probability of more than k - 1 departures
        for k in range(1, len(means)):
            if k - 1 < count:
                over = max(over - weight[k - 1], 0.0)
                inside += over
            else:
                over = 0.0
            before[k] = inside / (pads * service)
        # The time after it, if only j < k have left.
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
    """Compute the mean wait of an arrival at each of `times_s`, s; after the last slot its rate continues.

    An arrival that finds c + k - 1 drones needs the k-th departure from pads that are all busy until then: W(t) = sum
    over k >= 1 of p[c + k - 1](t) M_k(t), with M_k of `_earlier` computed backwards in time; after the last slot M_k
    = k / (c b).

    Takes rates above 0 and ascending times from the first slot on; `models.queues.waiting_times` checks them.

    Parameters
    ----------
    distribution : ndarray, shape (times, states)
        p at `times_s`, of `transient_distributions`.
    pads, services, slot_s, times_s
        As there.
    """
    points, states = distribution.shape
    waits = np.zeros(points)
    kinds = max(states - pads + 1, 1)
    weight = np.empty(_MAX_TERMS)
    slot = len(services) - 1
    # M_k under the last rate, from which to go back.
    means = np.arange(kinds) / (pads * services[slot])
    now = max(times_s[points - 1], slot * slot_s)
    constant = np.all(services[min(int(times_s[0] / slot_s), slot) :] == services[slot])
    for i in range(points - 1, -1, -1):
        # Back to the time asked for, slot by slot; not needed where the rate never changes.
        while now > times_s[i] and not constant:
            back = times_s[i]
            if slot > 0 and slot * slot_s >= now:
                slot -= 1
                continue
            back = max(back, slot * slot_s)
            means = _earlier(means, pads, services[slot], now - back, weight)
            now = back
        # W(t).
        for k in range(1, kinds):
            waits[i] += distribution[i, pads + k - 1] * means[k]
    return waits
