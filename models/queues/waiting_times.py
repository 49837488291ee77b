"""Waiting for a pad: the transient M/M/c queue of a station.

Drones wait in one line without limit and are served first come, first served. Other drones arrive as a
Poisson process and leave a pad at a rate 1 / mean charging time each; both rates are constant within an
hour. The number of drones present is then a birth-death chain, whose probabilities follow from its state now
by uniformization (Grassmann 1977; Stewart, *Numerical Solution of Markov Chains*, 1994, section 8.2): a
Poisson-weighted sum of powers of a stochastic matrix, in which nothing is subtracted and mass is kept.

The line has no limit: its upper end is cut where it no longer matters, under a budget which is set so that
the mass lost over a whole run is below `LOST_MASS`.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import S_PER_H
from skyway.models.queues.transient_kernels import (
    MAX_JUMPS,
    MAX_STATES,
    expected_waits,
    transient_distributions,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.load import PadLoad

    Floats: TypeAlias = NDArray[np.float64]

LOST_MASS = 1e-9
"""Probability that a whole run may lose by truncating the line."""
WARM_UP_H = 168
"""Hours simulated from an empty station if the pads were not observed and the load of the week is too high for a
long run."""
SETTLED = 0.98
"""Mean utilisation of the week from which on there is no long run to begin with, or convergence to it is too slow."""
FORGOTTEN = 7.0
"""Otherwise a station that was not observed begins with the long run of the week's mean load, followed by this many of its
relaxation times under the load of the hours: exp(-7) of the difference is left. A relaxation time is
1 / (sqrt(pads) - sqrt(offered load))^2 charging times, but no less than one."""
MIN_SETTLING_H, MAX_SETTLING_H = 12, 672
_NOBODY = 1e-12  # probability of still more drones, at which the long run is truncated
TAIL_H = 24
"""Hours after a horizon whose charging times still matter to drones that wait at its end."""
STEP_S = 600.0
"""Distance of the points at which waits are forecast."""


def erlang_c(pads: int, offered_load: float) -> float:
    """Probability that an arrival must wait, in the long run (Erlang's C formula).

    The offered load is the arrival rate times the mean charging time, from 0 up; from `pads` on every arrival waits.
    """
    if offered_load >= pads:
        return 1.0
    blocked = 1.0  # Erlang's B formula by its recursion, which never overflows
    for servers in range(1, pads + 1):
        blocked = offered_load * blocked / (servers + offered_load * blocked)
    return blocked / (1.0 - offered_load / pads * (1.0 - blocked))


def stationary(pads: int, offered_load: float, states: int) -> NDArray[np.float64]:
    """Long-run probabilities of the first states of the unlimited queue, shape (states,).

    The offered load, arrival rate times mean charging time, is below `pads`; the probability of the other states is missing from
    the sum.
    """
    waits = erlang_c(pads, offered_load)
    ratio = offered_load / pads
    number = np.arange(states)
    tail = waits * (1.0 - ratio) * ratio ** np.maximum(number - pads, 0.0)
    if offered_load == 0.0:
        return np.where(number == 0, 1.0, 0.0)
    factorials = np.array([math.lgamma(n + 1.0) for n in range(pads)])
    log_weight = np.arange(pads) * math.log(offered_load) - factorials
    weight = np.exp(log_weight - log_weight.max())
    head = (1.0 - waits) * weight / weight.sum()
    result = tail.copy()
    result[: min(pads, states)] = head[:states]
    return result


@dataclass(frozen=True, eq=False)
class PadQueue:
    """Queue of one station, given the information at an instant."""

    pads: int
    """At least 1."""
    start_s: float
    """The instant, POSIX seconds."""
    first_s: float
    """When the first hour of the rates begins, POSIX seconds."""
    arrivals_per_s: NDArray[np.float64]
    mean_charging_s: NDArray[np.float64]
    """Shape (hours,) each. Rates of other drones, hour after hour; the rates of the last hour hold afterwards."""
    busy: int | None = None
    """Drones seen at `start_s`: that many pads are busy, and the line is empty unless it exceeds the pads. None: not
    observed, so the station begins as `unseen` at `first_s` and runs through the hours until `start_s`."""
    unseen: NDArray[np.float64] = field(default_factory=lambda: np.ones(1), repr=False)
    """Shape (any,). Probabilities of 0, 1, 2, … drones at `first_s` without an observation; an empty station by
    default."""

    def distribution(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the probabilities of 0, 1, 2, … drones on the pads and in the line, shape (times, states).

        Times are instants from `start_s` on, POSIX seconds, ascending. An `InputError` refuses a line beyond
        `MAX_STATES`.
        """
        begin_s, initial = 0.0, self.unseen
        if self.busy is not None:
            begin_s, initial = self.start_s - self.first_s, np.zeros(self.busy + 1)
            initial[-1] = 1.0
        return _run(self.pads, (self.arrivals_per_s, self.mean_charging_s), initial, begin_s, times_s - self.first_s)

    def forecast(self, hours: float) -> WaitForecast:
        """Forecast the waits over a horizon from `start_s` on, at points `STEP_S` apart."""
        grid = self.start_s + STEP_S * np.arange(_points(hours), dtype=np.float64)
        states = self.distribution(grid)
        times = grid - self.first_s
        wait = expected_waits(states, self.pads, 1.0 / self.mean_charging_s, S_PER_H, times)
        # Exact values never let a later arrival start earlier; this removes violations by rounding and truncation.
        wait = np.maximum.accumulate(times + wait) - times
        free = np.minimum(states[:, : self.pads].sum(axis=1), 1.0)
        return WaitForecast(np.maximum(wait, 0.0), free)


class WaitForecast(NamedTuple):
    """Waiting for a pad at one station, for arrivals at points `STEP_S` apart.

    Between the points everything is linear, before and after them constant, so that t + E[W](t) never decreases: a
    later arrival is not expected to start earlier.
    """

    wait_s: NDArray[np.float64]
    """Shape (times,). Expected wait of a drone that arrives at each point, seconds."""
    p_free: NDArray[np.float64]
    """Shape (times,). Probability that it finds a free pad."""


def _points(hours: float) -> int:
    """Points of a grid over a horizon."""
    return math.ceil(hours * S_PER_H / STEP_S) + 1


def forecast_waits(
    load: PadLoad,
    pads: NDArray[np.int64],
    stations: Sequence[int],
    start_s: float,
    hours: float,
    busy: Mapping[int, int],
) -> dict[int, WaitForecast]:
    """Forecast the waits at several stations, by node; those with the same load, pads and start share one forecast.

    The start state matters: at utilisation 0.9 for some 76 charging times. `busy` has the drones seen at `start_s`,
    POSIX seconds (see `PadQueue`). If the pads were not seen, the start is the state to which a weekly repeating load leads
    (see `settled`). If `pads`, shape (nodes,), are 0, as at a delivery target, nobody recharges, so nobody waits.
    An `InputError` refuses a line that grows beyond `MAX_STATES`.
    """
    shared: dict[tuple[int, int | None, bytes, bytes], WaitForecast] = {}
    result = {}
    for station in stations:
        count, known = int(pads[station]), busy.get(station)
        if count == 0:
            result[station] = WaitForecast(np.zeros(_points(hours)), np.ones(_points(hours)))
            continue
        key = (count, known, load.arrivals_per_s[station].tobytes(), load.mean_charging_s[station].tobytes())
        if key not in shared:
            shared[key] = station_queue(load, station, count, start_s, hours, known).forecast(hours)
        result[station] = shared[key]
    return result


def station_queue(
    load: PadLoad, station: int, pads: int, start_s: float, hours: float, busy: int | None = None
) -> PadQueue:
    """Build the queue of one station from a load.

    The rates are those of the horizon and `TAIL_H` hours after it; where `busy` is None, the pads were not seen.
    """
    first_s = math.floor(start_s / S_PER_H) * S_PER_H
    arrivals, charging = load.hourly(station, first_s, math.ceil(hours) + 1 + TAIL_H)
    if busy is not None:
        return PadQueue(pads, start_s, first_s, arrivals, charging, busy)
    return PadQueue(pads, start_s, first_s, arrivals, charging, unseen=settled(load, station, pads, first_s))


def settled(load: PadLoad, station: int, pads: int, first_s: float) -> NDArray[np.float64]:
    """Probabilities of 0, 1, 2, … drones at an unobserved station, at the beginning of an hour of UTC.

    They are computed once for each hour, load and number of pads, and are read-only. The station begins with the long
    run of the week's mean load and runs through the load of the preceding hours, until the initial state no longer matters
    (`FORGOTTEN`). With more load on average than `SETTLED`, it begins empty, `WARM_UP_H` before: such a line grows from
    week to week.

    Source of the relaxation time: E. A. van Doorn, "Conditions for exponential ergodicity and bounds for the decay
    parameter of a birth-death process", Advances in Applied Probability 17 (1985).
    """
    return _kept(("settled", first_s), load, station, pads, lambda: _settled(load, station, pads, first_s))


def present_at(load: PadLoad, station: int, pads: int, start_s: float) -> NDArray[np.float64]:
    """Probabilities of at most 0, 1, 2, … drones at an unobserved station, at any time; see `settled`."""

    def found() -> NDArray[np.float64]:
        queue = station_queue(load, station, pads, start_s, 1)
        return np.cumsum(queue.distribution(np.array([start_s]))[0])

    return _kept(("present", start_s), load, station, pads, found)


_KEPT: dict[tuple[bytes, str, int, tuple[str, float]], NDArray[np.float64]] = {}
_MAX_KEPT = 50_000  # half a kilobyte each


def _kept(
    what: tuple[str, float], load: PadLoad, station: int, pads: int, work_out: Callable[[], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Store the result for a time, a load and a number of pads."""
    rates = load.arrivals_per_s[station].tobytes() + load.mean_charging_s[station].tobytes()
    key = (hashlib.blake2b(rates, digest_size=16).digest(), load.timezone, pads, what)
    found = _KEPT.get(key)
    if found is None:
        if len(_KEPT) >= _MAX_KEPT:
            _KEPT.clear()
        found = work_out()
        found.flags.writeable = False
        _KEPT[key] = found
    return found


def _settled(load: PadLoad, station: int, pads: int, first_s: float) -> NDArray[np.float64]:
    arrivals, charging = load.arrivals_per_s[station], load.mean_charging_s[station]
    offered = float(np.mean(arrivals * charging))
    begin, warm_up = np.ones(1), WARM_UP_H
    if offered < SETTLED * pads:
        relaxation_s = float(charging.max()) / min((math.sqrt(pads) - math.sqrt(offered)) ** 2, 1.0)
        warm_up = min(max(math.ceil(FORGOTTEN * relaxation_s / S_PER_H), MIN_SETTLING_H), MAX_SETTLING_H)
        ratio = max(offered / pads, 1e-3)
        begin = stationary(pads, offered, pads + math.ceil(math.log(_NOBODY) / math.log(ratio)) + 1)
        begin /= begin.sum()
    rates = load.hourly(station, first_s - warm_up * S_PER_H, warm_up)
    found = _run(pads, rates, begin, 0.0, np.array([warm_up * S_PER_H]))[0]
    return np.asarray(found[: np.flatnonzero(found)[-1] + 1] / found.sum())


def _run(
    pads: int,
    rates: tuple[NDArray[np.float64], NDArray[np.float64]],
    initial: NDArray[np.float64],
    begin_s: float,
    times_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Distributions at times since the first hour of the rates, shape (times, states)."""
    arrivals, charging = rates
    jumps = (arrivals.max() + pads / charging.min()) * (times_s[-1] - begin_s)
    steps = jumps / MAX_JUMPS + len(times_s) + (times_s[-1] - begin_s) / S_PER_H + 2.0
    cut = 0.5 * LOST_MASS / steps
    distribution, lost = transient_distributions(
        initial.copy(), pads, arrivals, 1.0 / charging, S_PER_H, begin_s, times_s, cut
    )
    if lost < 0.0:
        remedy = "check the arrivals and the charging times"
        raise InputError(f"the line grows beyond {MAX_STATES} drones", field="load", remedy=remedy)
    return np.asarray(distribution)
