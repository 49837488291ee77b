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
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import S_PER_H
from skyway.models.queues.load import hours_of_week
from skyway.models.queues.settled_kernels import budget, unseen
from skyway.models.queues.transient_kernels import MAX_STATES, expected_waits, transient_distributions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.load import PadLoad

    Floats: TypeAlias = NDArray[np.float64]

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
    not_seen = [station for station in stations if pads[station] and station not in busy]
    if not_seen:  # worked out together and kept for `settled`: one by one it takes several times as long
        _unseen(load, not_seen, [int(pads[station]) for station in not_seen], math.floor(start_s / S_PER_H) * S_PER_H)
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
    return _unseen(load, [station], [pads], first_s)[0]


def present_at(
    load: PadLoad, stations: Sequence[int], pads: Sequence[int], start_s: float
) -> list[NDArray[np.float64]]:
    """Probabilities of at most 0, 1, 2, … drones at each of some unobserved stations with pads, at any time; see `settled`."""
    return [np.cumsum(found) for found in _unseen(load, stations, pads, start_s)]


_KEPT: dict[tuple[bytes, str, int, float], NDArray[np.float64]] = {}
_MAX_KEPT = 50_000  # half a kilobyte each


def _unseen(load: PadLoad, stations: Sequence[int], pads: Sequence[int], time_s: float) -> list[NDArray[np.float64]]:
    """Probabilities of 0, 1, 2, … drones at stations that nobody has seen; kept by time, load and number of pads."""
    keys = []
    for station, count in zip(stations, pads, strict=True):
        rates = load.arrivals_per_s[station].tobytes() + load.mean_charging_s[station].tobytes()
        keys.append((hashlib.blake2b(rates, digest_size=16).digest(), load.timezone, count, time_s))
    found = {key: _KEPT[key] for key in keys if key in _KEPT}
    missing = {key: place for place, key in enumerate(keys) if key not in found}
    if missing:
        places = list(missing.values())
        which, counts = np.array(stations)[places], np.array(pads, dtype=np.int64)[places]
        for key, share in zip(missing, _worked_out(load, which, counts, time_s), strict=True):
            share.flags.writeable = False
            found[key] = share
        if len(_KEPT) + len(missing) > _MAX_KEPT:
            _KEPT.clear()
        _KEPT.update({key: found[key] for key in missing})
    return [found[key] for key in keys]


def _worked_out(
    load: PadLoad, stations: NDArray[np.int64], pads: NDArray[np.int64], time_s: float
) -> list[NDArray[np.float64]]:
    """Compute what `_unseen` returns."""
    arrivals, charging = load.arrivals_per_s[stations], load.mean_charging_s[stations]
    offered = (arrivals * charging).mean(axis=1)
    plan = np.zeros((len(stations), 2), dtype=np.int64)
    plan[:, 1] = WARM_UP_H
    calm = offered < SETTLED * pads
    spare = np.sqrt(pads) - np.sqrt(np.minimum(offered, pads))
    relaxation_s = charging.max(axis=1) / np.minimum(np.where(calm, spare, 1.0) ** 2, 1.0)
    hours = np.clip(np.ceil(FORGOTTEN * relaxation_s / S_PER_H), MIN_SETTLING_H, MAX_SETTLING_H)
    ratio = np.clip(offered / pads, 1e-3, SETTLED)
    states = pads + np.ceil(math.log(_NOBODY) / np.log(ratio)) + 1
    plan[calm] = np.column_stack((states, hours))[calm].astype(np.int64)
    first_s, before = math.floor(time_s / S_PER_H) * S_PER_H, int(plan[:, 1].max())
    week = hours_of_week(load.timezone, first_s - before * S_PER_H, before + 2 + TAIL_H)
    offset, share = unseen(arrivals, charging, pads, (offered, plan), (week, before), time_s - first_s)
    if (np.diff(offset) == 0).any():
        raise _too_long()
    return [share[low:high].copy() for low, high in pairwise(offset.tolist())]


def _run(
    pads: int,
    rates: tuple[NDArray[np.float64], NDArray[np.float64]],
    initial: NDArray[np.float64],
    begin_s: float,
    times_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Distributions at times since the first hour of the rates, shape (times, states)."""
    arrivals, charging = rates
    cut = budget(arrivals, charging, pads, float(times_s[-1] - begin_s), len(times_s))
    distribution, lost = transient_distributions(
        initial.copy(), pads, arrivals, 1.0 / charging, S_PER_H, begin_s, times_s, cut
    )
    if lost < 0.0:
        raise _too_long()
    return np.asarray(distribution)


def _too_long() -> InputError:
    remedy = "check the arrivals and the charging times"
    return InputError(f"the line grows beyond {MAX_STATES} drones", field="load", remedy=remedy)
