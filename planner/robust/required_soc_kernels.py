"""Kernels of the required SoC of a flight, given the information state at take-off.

A flight must expect the forecast seen from that moment: each member m weighted by its likeness to the wind measured now
and shifted by its own residual, which fades with the time h since then, smoothed, with gusts about it:

    r_m    = measured - w_m,     wind of member m later: w_m + r_m exp(-h / tau)     (`residuals`)
    p_m    ~ share_m exp(-|r_m|^2 / (2 sigma^2))                                     (`chances`)
    time of a flight in member m ~ Normal(T_m, D_m^2), D_m from gusts and smoothing  (`slow_land`)
    energy of it ~ Normal(E_m, (c D_m)^2 + (d E_m)^2),  E_m = k + c T_m              (`flight_energy`)
    energy E: sum of p_m P(energy of it > E) = epsilon sum of p_m

with w_m the wind of member m, c the SoC that a second of flight takes, k what a flight takes beyond that, and d the
standard deviation of the ratio of a flight's energy to the model's (`energy_belief_after`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import (
    NEVER,
    along_across,
    cross,
    forward_mps,
    land,
    segment_speed,
    slot_end,
    slot_of,
    slots_of,
    wind_on,
)
from skyway.models.flight.rules import SegmentWind
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS
from skyway.planner.robust.normal_kernels import capped, exceeded_by
from skyway.planner.schedule.gust_kernels import LATERAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

GRID_S = 600.0
"""What a flight needs is worked out for take-offs within so long together; the most of both ends counts."""
MIN_CHANCE = 1e-9
"""Likeness below which a member does not count."""


class Known(NamedTuple):
    """What a drone knows when it decides, and how careful it is."""

    air: SegmentWind
    """Segments and the members of the forecast."""
    share: NDArray[np.float64]
    """Shape (rows, members). Probability of each member; a row for each truth, so that a truth can be left out of its
    own forecast."""
    measured: bool
    """The wind of the hour is measured at the sites; else the members stay as they are."""
    sigma_mps: float
    tau_s: float
    """Standard deviation and correlation time of a member's residual."""
    smoothing: float
    """The wind after the hour of the take-off is less sure than the few members say: each stands for a normal
    distribution about it, of this share of the standard deviation that a residual has gained by then."""
    gust_sd: float
    gust_time_s: float
    """Of gusts, see `planner.schedule.gust_kernels.Disturbance`."""
    energy_mean: float
    energy_between: float
    energy_within: float
    """What is believed of the ratio of measured to modelled energy before the first leg: mean, and variances of the
    part that persists and of that which is fresh on each leg (`models.drones.energy_belief`)."""
    epsilon: float
    """Share of flights that may need more than is charged for."""
    margin: float
    """Calibrated: multiplies the energy that a flight needs beyond that."""
    full: bool
    """Every charge is to 100 %, whatever is needed."""
    worst_members: int
    steady_sigmas: float
    """See `planner.parameters.robust.RobustParameters`."""


@compiled_lean
def energy_belief_after(known: Known, seen: float, legs: int) -> tuple[float, float]:
    """Ratio of energy to the model's to expect of the next leg, after `legs` legs with the mean ratio `seen`.

    Returns the mean, and the standard deviation as a share of the mean before the first leg. With that mean m and the variances
    v (persists) and w (fresh), K = v / (v + w / legs), 0 before the first leg:

        m + K (seen - m),     sqrt((1 - K) v + w) / m

    Takes any finite ratio, and no legs or more.
    """
    gain = 0.0
    if legs > 0 and known.energy_between > 0.0:
        gain = known.energy_between / (known.energy_between + known.energy_within / legs)
    unsure = (1.0 - gain) * known.energy_between + known.energy_within
    return known.energy_mean + gain * (seen - known.energy_mean), math.sqrt(unsure) / known.energy_mean


@compiled
def residuals(
    known: Known, first: int, wind_north: NDArray[np.float64], wind_east: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much the wind measured in slot `first` is more than each member says, shape (members, sites).

    r_m, towards north and east, m/s; 0 where nobody measures. The measured wind has shape (sites,).
    """
    air = known.air
    members, _, sites = air.north.shape
    north, east = np.zeros((members, sites)), np.zeros((members, sites))
    if known.measured:
        for m in range(members):
            for site in range(sites):
                north[m, site] = wind_north[site] - air.north[m, first, site]
                east[m, site] = wind_east[site] - air.east[m, first, site]
    return north, east


@compiled
def chances(known: Known, row: int, north: NDArray[np.float64], east: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of each member, but for a factor, given its residuals; shape (members,).

    p_m = share_m exp(-|r_m|^2 / (2 sigma^2)), |r_m|^2 the mean square of a component over the sites; the factor makes
    the likeliest member keep its share, so that nothing underflows.
    """
    members, sites = north.shape
    miss, out = np.zeros(members), np.zeros(members)
    least = NEVER
    for m in range(members):
        for site in range(sites):
            # |r_m|^2, and the least of those that count.
            miss[m] += (north[m, site] * north[m, site] + east[m, site] * east[m, site]) / (2.0 * sites)
        if known.share[row, m] > 0.0:
            least = min(least, miss[m])
    for m in range(members):
        out[m] = known.share[row, m] * math.exp(-0.5 * (miss[m] - least) / (known.sigma_mps * known.sigma_mps))
    return out


@compiled_lean
def gust_mean_variance(x: float) -> float:
    """Variance of the mean of a flight's gusts as a share of that of one, for a time constant of x times the flight.

    The mean of an Ornstein-Uhlenbeck process of time constant tau over T has, with x = tau / T,

        2 x (1 - x (1 - exp(-1 / x)))
    """
    return 2.0 * x * (1.0 - x * (1.0 - math.exp(-1.0 / x)))


@compiled_lean
def gust_mean(known: Known, flight_s: float) -> float:
    """Standard deviation of the mean of a flight's gusts, as a share of the wind; `flight_s` is how long it lasts.

    Takes any length of flight; what is not above 0 has the gust of a moment.
    """
    return known.gust_sd * math.sqrt(gust_mean_variance(known.gust_time_s / max(flight_s, 1.0)))


@compiled_lean
def wind_felt(air: SegmentWind, member: int, slot: int, segment: int) -> tuple[float, float, float]:
    """Ground speed (equations 1-5), and what gusts as strong as the wind itself change it by; m/s, without limits.

    With the wind (a, c) along and across the way, gusts of the shares x along the wind and y across it make it

        (a + a x - c y,  c + c x + a y)

    so that the ground speed v = a + sqrt(S^2 - c^2) changes by (a - c t) x - (c + a t) y to first order, with the
    tangent of the crab angle t = c / sqrt(S^2 - c^2). Returned are v, a - c t, and c + a t times `LATERAL`.
    """
    north, east = wind_on(air, member, slot, segment)
    along, across = along_across(north, east, air.cos_bearing[segment], air.sin_bearing[segment])
    forward = forward_mps(air.airspeed_mps, across)
    crab = across / max(forward, MIN_GROUND_SPEED_MPS)
    return along + forward, along - across * crab, LATERAL * (across + along * crab)


@compiled_lean
def wind_variance(known: Known, ahead_s: float) -> float:
    """Variance of a component of the wind about what a member says, `ahead_s` after the hour that was measured, m2/s2.

    (b sigma)^2 (1 - exp(-2 t / tau)): the variance that a residual has gained by then, times the square of b =
    `smoothing`.
    """
    unsure = known.sigma_mps * known.smoothing
    return unsure * unsure * (1.0 - math.exp(-2.0 * ahead_s / known.tau_s))


@compiled_lean
def _slow_speed(wind: tuple[Known, SegmentWind, int, int, float], slot: int, segment: int) -> float:
    """Ground speed of `slow_land` as `models.flight.kernels.cross` takes it, m/s.

    v - `steady_sigmas` sqrt(gust^2 f^2 + variance of the wind), v and f (what a gust of the wind's own strength does) of
    `wind_felt`; then the mean under the greatest ground speed, with the rest of the gusts, which vary about their mean.

    `wind` is (known, air, member, slot of the take-off, gust).
    """
    known, air, member, first, gust = wind
    speed, with_wind, across_wind = wind_felt(air, member, slot, segment)
    felt = math.hypot(with_wind, across_wind)
    # What is uncertain all the way: the mean gust and, after the hour of the take-off, the wind.
    square = gust * gust * felt * felt
    if slot > first:
        square += wind_variance(known, (slot - first) * air.slot_s)
    # What varies about that.
    about = felt * math.sqrt(max(known.gust_sd * known.gust_sd - gust * gust, 0.0))
    return max(
        capped(speed - known.steady_sigmas * math.sqrt(square), about, air.max_ground_speed_mps), MIN_GROUND_SPEED_MPS
    )


@compiled_lean
def slow_land(
    known: Known, air: SegmentWind, member: int, segments: NDArray[np.int64], depart_s: float, gust: float
) -> float:
    """Touch-down of a flight through wind that is worse all the way than the member says, by `Known.steady_sigmas` deviations.

    Of the wind itself after the hour of the take-off, and of the mean of gusts, `gust` as a share of the wind. About
    their mean gusts come and go: where the ground speed is capped, lulls slow a flight and squalls from behind give
    nothing back. Whether the flight is flyable, `land` decides.
    """
    now = depart_s + air.climb_s
    wind = known, air, member, slot_of(air, depart_s), gust
    for segment in segments:
        now = cross(_slow_speed, wind, slots_of(air), air.distance_m[segment], segment, now)
    return now + air.descent_s


@compiled
def careful_speeds(
    air: SegmentWind, member: int, slots: NDArray[np.int64], segments: NDArray[np.int64], gust: float
) -> NDArray[np.float64]:
    """Ground speeds with a gust against every flight, m/s, shape (slots, segments); 0 where closed.

    v - `gust` f, v and f of `wind_felt`, `gust` as a share of the wind.

    Takes a member, slots and segments of the air, any number of them, and a finite gust.
    """
    out = np.zeros((len(slots), len(segments)))
    for row in range(len(slots)):
        for column in range(len(segments)):
            if segment_speed(air, member, slots[row], segments[column]) > 0.0:
                speed, with_wind, across_wind = wind_felt(air, member, slots[row], segments[column])
                felt = math.hypot(with_wind, across_wind)
                out[row, column] = min(max(speed - gust * felt, MIN_GROUND_SPEED_MPS), air.max_ground_speed_mps)
    return out


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
    worked out from, s: as long as that ends in the same slot, the energy is the same.

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
    """Look up, or work out and keep, what a flight may need that takes off about a time, as SoC.

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
