"""Kernel of stations that nobody has seen: how many drones are there after the load of the hours before, see `models.queues.waiting_times`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.models.queues.transient_kernels import MAX_JUMPS, transient_distributions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Integers: TypeAlias = NDArray[np.int64]

HOUR_S = 3600.0
LOST_MASS = 1e-9
"""Probability that a whole run may lose by cutting the line."""


@compiled
def budget(arrivals: Floats, charging: Floats, pads: int, span_s: float, times: int) -> float:
    """Mass that each step of a run over so many seconds, which stops at so many times, may lose.

    Takes rates from 0 up, charging times above 0.
    """
    jumps = (arrivals.max() + pads / charging.min()) * span_s
    mass: float = 0.5 * LOST_MASS / (jumps / MAX_JUMPS + times + span_s / HOUR_S + 2.0)
    return mass


@compiled
def erlang_c(pads: int, offered_load: float) -> float:
    """Probability that an arrival must wait, in the long run (Erlang's C formula).

    The offered load is the arrival rate times the mean charging time; from `pads` on everybody waits.

    Takes a load from 0 up.
    """
    if offered_load >= pads:
        return 1.0
    blocked = 1.0  # Erlang's B formula by its recursion, which never overflows
    for servers in range(1, pads + 1):
        blocked = offered_load * blocked / (servers + offered_load * blocked)
    return blocked / (1.0 - offered_load / pads * (1.0 - blocked))


@compiled
def stationary(pads: int, offered_load: float, states: int) -> Floats:
    """Long-run probabilities of 0, 1, 2, … drones of the queue without limit, shape (states,); what the other states have is missing.

    With a the offered load, c the pads and C of `erlang_c`:

        p_n = (1 - C) a^n / n! / (sum of a^k / k! over k < c)  for n < c,    C (1 - a / c) (a / c)^(n - c)  from there on

    Takes a load from 0 up, below `pads`, and a pad or more.
    """
    out = np.zeros(states)
    if offered_load == 0.0:
        out[0] = 1.0
        return out
    waits, ratio = erlang_c(pads, offered_load), offered_load / pads
    # The logarithm of a^n / n!, its greatest value and the sum over it.
    log, most = np.empty(pads), -math.inf
    for n in range(pads):
        log[n] = n * math.log(offered_load) - math.lgamma(n + 1.0)
        most = max(most, log[n])
    total = 0.0
    for n in range(pads):
        total += math.exp(log[n] - most)
    for n in range(states):
        if n < pads:
            out[n] = (1.0 - waits) * (math.exp(log[n] - most) / total)
        else:
            out[n] = waits * (1.0 - ratio) * ratio ** (n - pads)
    return out


@compiled
def unseen(
    arrivals: Floats,
    charging: Floats,
    pads: Integers,
    begins: tuple[Floats, Integers],
    hours: tuple[Integers, int],
    into_s: float,
) -> tuple[Integers, Floats]:
    """Compute the probabilities of 0, 1, 2, … drones at stations that nobody has seen, packed.

    Each station begins with `stationary` and lives through its hours until the hour of the time asked for, and through a part of that.

    Takes rates from 0 up, charging times above 0, a pad or more at each, and as many hours before the one asked for as any station lives through.

    Parameters
    ----------
    arrivals, charging : ndarray, shape (stations, 168)
        Arrivals per s and mean charging time, s, by the hour of the week.
    pads : ndarray of int, shape (stations,)
        Pads of each.
    begins : (offered, states)
        Shape (stations,) each: load of the long run that it begins with, and so many states of that; no states: it begins empty. And
        how many hours it lives through.
    hours : (hour_of_week, first)
        Hours of the week one after the other, and the index of that which is asked for.
    into_s : float
        Seconds of that hour, to be simulated as well.

    Returns
    -------
    offset, share : ndarray
        Those of station i are ``share[offset[i] : offset[i + 1]]``; none where the line grows beyond `MAX_STATES`.
    """
    offered, plan = begins
    week, first = hours
    stations = len(pads)
    offset = np.zeros(stations + 1, dtype=np.int64)
    share = np.empty(64 * max(stations, 1))
    for i in range(stations):
        states, lived = plan[i, 0], plan[i, 1]
        now = np.ones(1)
        if states > 0:
            now = stationary(pads[i], offered[i], states)
            now /= now.sum()
        # The hours before, then the one that is asked for.
        for part in range(2):
            low, high, span_s = first - lived, first, lived * HOUR_S
            if part == 1:
                low, high, span_s = first, len(week), into_s
            if span_s <= 0.0:
                continue
            come, take = np.empty(high - low), np.empty(high - low)
            for k in range(low, high):
                come[k - low], take[k - low] = arrivals[i, week[k]], charging[i, week[k]]
            cut = budget(come, take, pads[i], span_s, 1)
            rows, lost = transient_distributions(now, pads[i], come, 1.0 / take, HOUR_S, 0.0, np.array([span_s]), cut)
            if lost < 0.0:
                now = np.empty(0)
                break
            now = rows[0]
            if part == 0:
                top = len(now)
                while now[top - 1] <= 0.0:
                    top -= 1
                now = now[:top] / now[:top].sum()
        # Packed.
        size = offset[i] + len(now)
        if size > len(share):
            wider = np.empty(2 * size)
            wider[: offset[i]] = share[: offset[i]]
            share = wider
        share[offset[i] : size] = now
        offset[i + 1] = size
    return offset, share[: offset[stations]].copy()
