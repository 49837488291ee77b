"""Kernels of the required SoC of a flight, given the information state at take-off.

A flight must expect the forecast seen from that moment: each member m weighted by its likeness to the wind measured now
and shifted by its own residual, which fades with the time h since then, smoothed, with gusts about it:

    r_m    = measured - w_m,     wind of member m later: w_m + r_m exp(-h / tau)     (`information_kernels`)
    p_m    ~ share_m exp(-|r_m|^2 / (2 sigma^2))                                     (`chances`)
    time of a flight in member m ~ Normal(T_m, D_m^2), D_m from gusts and smoothing  (`slow_land`)
    energy of it ~ Normal(E_m, (c D_m)^2 + (d E_m)^2),  E_m = k + c T_m              (`flight_energy`)
    energy E: sum of p_m P(energy of it > E) = epsilon sum of p_m

with w_m the wind of member m, c the SoC that a second of flight takes, k what a flight takes beyond that, and d the
standard deviation of the ratio of a flight's energy to the model's (`planner.robust.information_kernels.energy_belief_after`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import NEVER, land, slot_end, slot_of
from skyway.models.flight.rules import SegmentWind
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.robust.information_kernels import MIN_CHANCE, chances, residuals
from skyway.planner.robust.normal_kernels import exceeded_by
from skyway.planner.robust.uncertain_wind_kernels import gust_mean, slow_land

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.robust.information_kernels import Known

GRID_S = 600.0
"""What a flight needs is computed for take-offs within so long together; the most of both ends counts."""


@compiled
def _worst_first(
    air: SegmentWind,
    segments: NDArray[np.int64],
    first: int,
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    fade: NDArray[np.float64],
    chance: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Members that count, those with the strongest wind against the way as a whole first.

    By the wind along the sum of the segments (as vectors), summed over the sites, in the slot of the take-off and the
    next one. `north` and `east` are their residuals, shape (members, sites), which fade by `fade`, shape (slots,), from
    slot to slot.
    """
    # The way as a whole.
    to_north, to_east = 0.0, 0.0
    for segment in segments:
        to_north += air.distance_m[segment] * air.cos_bearing[segment]
        to_east += air.distance_m[segment] * air.sin_bearing[segment]
    # The less wind along the way, the worse.
    which, score = np.empty(len(chance), dtype=np.int64), np.empty(len(chance))
    count = 0
    for m in range(len(chance)):
        if chance[m] > MIN_CHANCE:
            which[count], score[count] = m, 0.0
            for k in range(min(2, len(fade))):
                slot = min(first + k, air.north.shape[1] - 1)
                for site in range(north.shape[1]):
                    score[count] += to_north * (air.north[m, slot, site] + north[m, site] * fade[k])
                    score[count] += to_east * (air.east[m, slot, site] + east[m, site] * fade[k])
            count += 1
    return which[:count][np.argsort(score[:count])]


@compiled
def flight_energy(
    known: Known,
    row: int,
    segments: NDArray[np.int64],
    time_s: float,
    wind_north: NDArray[np.float64],
    wind_east: NDArray[np.float64],
    cost: tuple[float, float],
    deviation: float,
) -> tuple[float, float]:
    """Energy, as SoC, that a flight taking off at `time_s` exceeds with the probability epsilon only.

    `wind_north` and `wind_east`, shape (sites,), are measured in the slot of `time_s`. Members over the limits do not
    count (nobody would fly); without any other, never. Also returns how long the slowest flight lasts that it was
    computed from, s: as long as that ends in the same slot, the energy is the same.

    Only the `worst_members` members are flown, twice each: as they are, for T_m, and with the uncertain part `steady_sigmas`
    deviations against the flight, for D_m. O(`worst_members` x segments x slots of the flight).

    Takes a row of `Known.share`, segments of its air, one wind a site, and a finite time.

    Parameters
    ----------
    row : int
        Of `Known.share`.
    segments : ndarray of int
        Flown in order.
    cost : (c, k)
        SoC of a second of flight, and of a flight beyond that.
    deviation : float
        Standard deviation of a flight's energy as a share of the model's.
    """
    air = known.air
    first = slot_of(air, time_s)
    count = int(math.ceil(2.0 * 3600.0 / air.slot_s)) + 1
    members, slots, sites = air.north.shape
    # Residuals r_m, how they fade, and p_m; `seen` is the wind of one member at a time, as seen from now.
    fade = np.exp(-np.arange(count) * air.slot_s / known.tau_s)
    residual_north, residual_east = residuals(known, first, wind_north, wind_east)
    north, east = np.empty((1, count, sites)), np.empty((1, count, sites))
    shut = np.empty((count, air.shut.shape[1]), dtype=np.bool_)
    for k in range(count):
        shut[k] = air.shut[min(first + k, slots - 1)]
    seen = SegmentWind(
        air.start_s + first * air.slot_s,
        air.slot_s,
        north,
        east,
        air.weight,
        air.cos_bearing,
        air.sin_bearing,
        air.distance_m,
        air.airspeed_mps,
        air.wind_limit_mps,
        air.max_ground_speed_mps,
        air.climb_s,
        air.descent_s,
        air.shut_of,
        shut,
    )
    chance = chances(known, row, residual_north, residual_east)
    order = _worst_first(air, segments, first, residual_north, residual_east, fade, chance)
    energy, spread, share = np.empty(members + 1), np.empty(members + 1), np.empty(members + 1)
    flying, total, mildest, longest = 0, 0.0, 0, 0.0
    seen_enough = 0
    for m in order:
        if flying >= known.worst_members:
            break
        seen_enough += 1
        # Its wind: w_m + r_m exp(-h / tau).
        for k in range(count):
            slot = min(first + k, slots - 1)
            for site in range(sites):
                north[0, k, site] = air.north[m, slot, site] + residual_north[m, site] * fade[k]
                east[0, k, site] = air.east[m, slot, site] + residual_east[m, site] * fade[k]
        # T_m and D_m, as energy.
        down = land(seen, 0, segments, time_s)
        if down == NEVER:
            longest = NEVER
            continue
        flight = down - time_s
        slow = slow_land(known, seen, 0, segments, time_s, gust_mean(known, flight)) - down
        longest = max(longest, flight, flight + slow)
        energy[flying] = cost[1] + cost[0] * flight
        spread[flying] = max(math.hypot(cost[0] * slow / known.steady_sigmas, deviation * energy[flying]), 1e-9)
        share[flying] = chance[m]
        total += chance[m]
        if energy[flying] < energy[mildest]:
            mildest = flying
        flying += 1
    if flying == 0:
        return NEVER, NEVER
    # Members that are not flown need no more than the mildest that is.
    rest = 0.0
    for m in order[seen_enough:]:
        rest += chance[m]
    energy[flying], spread[flying], share[flying] = energy[mildest], spread[mildest], rest  # they need no more than it
    flying += 1
    total += rest
    need = exceeded_by(known.epsilon * total, total, energy[:flying], spread[:flying], share[:flying])
    return need, float(longest)


@compiled_lean
def energy_about(
    known: Known,
    row: int,
    truth: SegmentWind,
    member: int,
    segments: NDArray[np.int64],
    time_s: float,
    cost: tuple[float, float],
    deviation: float,
    table: NDArray[np.float64],
) -> float:
    """Look up, or compute and keep, what a flight may need that takes off about a time, as SoC.

    The most of both ends of the interval of `GRID_S` that holds the time, in the wind that is true in its slot.

    Parameters
    ----------
    known, row, segments, cost, deviation
        As of `flight_energy`.
    truth, member : SegmentWind, int
        The wind that is measured.
    table : ndarray, shape (points,)
        Of this member and leg, see `required_soc_tables`.
    """
    slot = slot_of(truth, time_s)
    k = int((time_s - truth.start_s) // GRID_S)
    need = _energy_at(known, row, truth, member, segments, cost, deviation, table, slot, 2 * k + 1)
    return max(need, _energy_at(known, row, truth, member, segments, cost, deviation, table, slot, 2 * k + 2))


@compiled_lean
def next_change(truth: SegmentWind, time_s: float) -> float:
    """First time after one from which on `energy_about` may say something else, POSIX seconds."""
    over = truth.start_s + (int((time_s - truth.start_s) // GRID_S) + 1) * GRID_S
    return min(over, slot_end(truth, slot_of(truth, time_s)))


@compiled_lean
def _energy_at(
    known: Known,
    row: int,
    truth: SegmentWind,
    member: int,
    segments: NDArray[np.int64],
    cost: tuple[float, float],
    deviation: float,
    table: NDArray[np.float64],
    slot: int,
    point: int,
) -> float:
    """What a flight needs at the beginning of interval k (point 2 k + 1) or at its end (2 k + 2), as SoC.

    Kept in the table; where the next interval begins in the same slot, its beginning serves for this end.
    """
    # When the point is, and where it is kept; at the end of a slot, a second before it.
    interval = (point - 1) // 2
    time_s = truth.start_s + interval * GRID_S
    key = point
    if point == 2 * interval + 2:
        time_s += GRID_S
        if slot_of(truth, time_s) == slot:
            key = point + 1  # the next interval begins in the same wind
        else:
            time_s -= 1.0
    points = len(table) - 2 * truth.north.shape[1]  # behind them two values of each slot
    if 0 <= key < points and not math.isnan(table[key]):
        return float(table[key])
    north, east = truth.north[member, slot], truth.east[member, slot]
    # What the flight needs at the beginning of the slot holds as long as it ends in the slot.
    begin = points + 2 * slot
    if math.isnan(table[begin]):
        at = truth.start_s + slot * truth.slot_s
        table[begin], table[begin + 1] = flight_energy(known, row, segments, at, north, east, cost, deviation)
    if time_s + table[begin + 1] <= slot_end(truth, slot):
        need = table[begin]
    else:
        need, _ = flight_energy(known, row, segments, time_s, north, east, cost, deviation)
    if 0 <= key < points:
        table[key] = need
    return float(need)


def required_soc_tables(truth: SegmentWind, legs: int) -> NDArray[np.float64]:
    """Return tables for `fly_by_required_soc` in which nothing is known yet.

    For each point of `GRID_S` what a flight needs, and then for each slot what it needs at its beginning and how long
    it may last; see `flight_energy`.
    """
    members, slots, _ = truth.north.shape
    return np.full((members, legs, 2 * int(slots * truth.slot_s / GRID_S) + 4 + 2 * slots), np.nan)
