"""Kernels of the required SoC of a flight, given the information state at take-off.

What it must expect is the forecast seen from that moment: each member weighted by its likeness to the wind measured now
and shifted by its own residual, which fades as exp(-horizon / tau) (model.md, section 9), smoothed, with gusts about it.
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
from skyway.planner.schedule.gust_kernels import LATERAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

GRID_S = 600.0
"""What a flight needs is worked out for take-offs within so long together; the most of both ends counts."""
MIN_CHANCE = 1e-9
"""Likeness below which a member does not count."""
WORST = 12
"""Members, of those with the strongest wind against the way, whose flights are worked out; the others are taken to need
what the mildest of these does, which is no less than they need."""
STEADY = 3.0
"""Standard deviations of what is unsure at which the time that it costs is worked out; it is taken as linear in them."""
SURE = 6.5
"""Standard deviations beyond which nothing is expected: 4e-11."""
_CLOSE = 1e-3  # share of epsilon to which the chance is met that a flight needs more
_STRAIGHT, _ROUNDS = 10, 40  # rounds of that search by false position, and all


class Known(NamedTuple):
    """What a drone knows when it decides, and how careful it is.

    Attributes
    ----------
    air : Air
        Segments and the members of the forecast.
    share : ndarray, shape (rows, members)
        Probability of each member; a row for each truth, so that a truth can be left out of its own forecast.
    measured : bool
        The wind of the hour is measured at the sites; else the members stay as they are.
    sigma_mps, tau_s : float
        Standard deviation and correlation time of a member's residual.
    smoothing : float
        The wind after the hour of the take-off is less sure than the few members say: each stands for a normal
        distribution about it, of this share of the standard deviation that a residual has gained by then.
    gust_sd, gust_time_s : float
        Of gusts, see `planner.schedule.gust_kernels.Disturbance`.
    energy_error : float
        A vehicle may need this share more than the model says.
    epsilon : float
        Share of flights that may need more than is charged for.
    margin : float
        Calibrated: multiplies the energy that a flight needs beyond that.
    full : bool
        Every charge is to 100 %, whatever is needed.
    """

    air: SegmentWind
    share: NDArray[np.float64]
    measured: bool
    sigma_mps: float
    tau_s: float
    smoothing: float
    gust_sd: float
    gust_time_s: float
    energy_error: float
    epsilon: float
    margin: float
    full: bool


@compiled
def residuals(
    known: Known, first: int, wind_north: NDArray[np.float64], wind_east: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much the wind measured in slot `first` is more than each member says, towards north and east, shape (members, sites).

    Nothing where nobody measures.
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
    """Probability of each member, but for a factor, given its residuals; shape (members,)."""
    members, sites = north.shape
    miss, out = np.zeros(members), np.zeros(members)
    least = NEVER
    for m in range(members):
        for site in range(sites):
            miss[m] += (north[m, site] * north[m, site] + east[m, site] * east[m, site]) / (2.0 * sites)
        if known.share[row, m] > 0.0:
            least = min(least, miss[m])
    for m in range(members):
        out[m] = known.share[row, m] * math.exp(-0.5 * (miss[m] - least) / (known.sigma_mps * known.sigma_mps))
    return out


@compiled_lean
def gust_mean_variance(x: float) -> float:
    """Variance of the mean of a flight's gusts as a share of that of one, for a time constant of x times the flight.

    The mean of an Ornstein-Uhlenbeck process of time constant tau over T has 2 tau / T (1 - tau / T (1 - exp(-T / tau))).
    """
    return 2.0 * x * (1.0 - x * (1.0 - math.exp(-1.0 / x)))


@compiled_lean
def gust_mean(known: Known, flight_s: float) -> float:
    """Standard deviation of the mean of a flight's gusts, as a share of the wind.

    Takes any length of flight; what is not above 0 has the gust of a moment.
    """
    return known.gust_sd * math.sqrt(gust_mean_variance(known.gust_time_s / max(flight_s, 1.0)))


@compiled_lean
def wind_felt(air: SegmentWind, member: int, slot: int, segment: int) -> tuple[float, float, float]:
    """Ground speed (equations 1-5), and what gusts of the strength of the wind itself change it by; m/s, without limits.

    With the wind (a, c) along and across the way, a gust of the shares x along the wind and y across it makes it
    (a + a x - c y, c + c x + a y); the ground speed a + sqrt(S^2 - c^2) then changes by (a - c t) x - (c + a t) y to first
    order, t = c / sqrt(S^2 - c^2) being the tangent of the crab angle. Returned are the ground speed, a - c t, and c + a t times
    `LATERAL`.
    """
    north, east = wind_on(air, member, slot, segment)
    along, across = along_across(north, east, air.cos_bearing[segment], air.sin_bearing[segment])
    forward = forward_mps(air.airspeed_mps, across)
    crab = across / max(forward, MIN_GROUND_SPEED_MPS)
    return along + forward, along - across * crab, LATERAL * (across + along * crab)


@compiled_lean
def capped(mean: float, deviation: float, most: float) -> float:
    """Mean of what is normally distributed but never above a limit: of min(most, X)."""
    if mean + SURE * deviation <= most:
        return mean
    if deviation <= 0.0:
        return most
    off = (most - mean) / deviation
    below = 0.5 * math.erfc(-off * math.sqrt(0.5))
    density = math.exp(-0.5 * off * off) / math.sqrt(2.0 * math.pi)
    return mean * below + most * (1.0 - below) - deviation * density


@compiled_lean
def wind_variance(known: Known, ahead_s: float) -> float:
    """Of a component of the wind about what a member says, some time after the hour that was measured, m2/s2."""
    unsure = known.sigma_mps * known.smoothing
    return unsure * unsure * (1.0 - math.exp(-2.0 * ahead_s / known.tau_s))


@compiled_lean
def _slow_speed(wind: tuple[Known, SegmentWind, int, int, float], slot: int, segment: int) -> float:
    """Ground speed of `slow_land` as `models.flight.kernels.cross` takes it, in (known, air, member, slot of the take-off, gust)."""
    known, air, member, first, gust = wind
    speed, with_wind, across_wind = wind_felt(air, member, slot, segment)
    felt = math.hypot(with_wind, across_wind)
    square = gust * gust * felt * felt
    if slot > first:
        square += wind_variance(known, (slot - first) * air.slot_s)
    about = felt * math.sqrt(max(known.gust_sd * known.gust_sd - gust * gust, 0.0))
    return max(capped(speed - STEADY * math.sqrt(square), about, air.max_ground_speed_mps), MIN_GROUND_SPEED_MPS)


@compiled_lean
def slow_land(
    known: Known, air: SegmentWind, member: int, segments: NDArray[np.int64], depart_s: float, gust: float
) -> float:
    """Touch-down of a flight through wind that is worse all the way than the member says, by `STEADY` deviations.

    Of the wind itself after the hour of the take-off, and of the mean of gusts, `gust` as a share of the wind. About their mean
    gusts come and go: where the ground speed is capped, lulls slow a flight and squalls from behind give nothing back. Whether
    the flight is flyable is `land`'s to say.
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
    """Ground speeds with a gust against every flight, `gust` as a share of the wind, shape (slots, segments); 0 where closed.

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

    `north` and `east` are their residuals, shape (members, sites), which fade by `fade` from slot to slot.
    """
    to_north, to_east = 0.0, 0.0
    for segment in segments:
        to_north += air.distance_m[segment] * air.cos_bearing[segment]
        to_east += air.distance_m[segment] * air.sin_bearing[segment]
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


@compiled_lean
def _deviations(chance: float) -> float:
    """Standard deviations that a normal deviate exceeds with a chance up to a half, to 5e-4 (Abramowitz and Stegun, 26.2.23)."""
    t = math.sqrt(-2.0 * math.log(chance))
    return t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))


@compiled_lean
def _exceeded_by(
    least: float,
    total: float,
    mean: NDArray[np.float64],
    spread: NDArray[np.float64],
    share: NDArray[np.float64],
) -> float:
    """Find the value that a mixture of normal distributions, of weight `total`, exceeds with the weight `least` only.

    None of its parts alone may exceed it with more, and where each does so with its share, so does the mixture: between
    these bounds the logarithm of the weight is all but straight, and is followed by false position (the Illinois rule).
    """
    lowest, low, high = NEVER, -NEVER, -NEVER
    most = _deviations(min(least / total, 0.5)) + 1e-3
    for m in range(len(mean)):
        lowest, high = min(lowest, mean[m]), max(high, mean[m] + most * spread[m])
        if 2.0 * least < share[m]:
            low = max(low, mean[m] + (_deviations(least / share[m]) - 1e-3) * spread[m])
    low = max(low, lowest)
    below, above, side = math.nan, math.nan, 0
    x = low
    for done in range(_ROUNDS):
        beyond = 0.0
        for m in range(len(mean)):
            off = (x - mean[m]) / spread[m]
            if off < SURE:
                beyond += share[m] * 0.5 * math.erfc(off * math.sqrt(0.5))
        miss = math.log(max(beyond, 1e-300) / least)
        if abs(miss) < _CLOSE:
            return x
        if miss > 0.0:
            low, below = x, miss
            above = above / 2.0 if side > 0 else above
            side = 1
        else:
            high, above = x, miss
            below = below / 2.0 if side < 0 else below
            side = -1
        if math.isnan(above):
            x = high
        elif math.isnan(below):
            x = low
        else:  # halved where parts are so narrow that the weight falls in steps
            x = low + (high - low) * (below / (below - above) if done < _STRAIGHT else 0.5)
    return high


@compiled
def flight_energy(
    known: Known,
    row: int,
    segments: NDArray[np.int64],
    time_s: float,
    wind_north: NDArray[np.float64],
    wind_east: NDArray[np.float64],
    cost: tuple[float, float],
) -> tuple[float, float]:
    """Energy, as SoC, that a flight taking off at `time_s` exceeds with the probability epsilon only.

    `wind_north` and `wind_east`, shape (sites,), are measured in the slot of `time_s`. Members over the limits do not
    count (nobody would fly); without any other, never. Also returns how long the slowest flight lasts that it was worked
    out from, s: as long as that ends in the same slot, the energy is the same.

    Takes a row of `Known.share`, segments of its air, one wind a site, and a finite time.
    """
    air = known.air
    first = slot_of(air, time_s)
    count = int(math.ceil(2.0 * 3600.0 / air.slot_s)) + 1
    members, slots, sites = air.north.shape
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
        if flying >= WORST:
            break
        seen_enough += 1
        for k in range(count):
            slot = min(first + k, slots - 1)
            for site in range(sites):
                north[0, k, site] = air.north[m, slot, site] + residual_north[m, site] * fade[k]
                east[0, k, site] = air.east[m, slot, site] + residual_east[m, site] * fade[k]
        down = land(seen, 0, segments, time_s)
        if down == NEVER:
            longest = NEVER
            continue
        flight = down - time_s
        slow = slow_land(known, seen, 0, segments, time_s, gust_mean(known, flight)) - down
        longest = max(longest, flight, flight + slow)
        energy[flying] = cost[1] + cost[0] * flight
        spread[flying] = max(cost[0] * slow / STEADY, 1e-9)
        share[flying] = chance[m]
        total += chance[m]
        if energy[flying] < energy[mildest]:
            mildest = flying
        flying += 1
    if flying == 0:
        return NEVER, NEVER
    rest = 0.0
    for m in order[seen_enough:]:
        rest += chance[m]
    energy[flying], spread[flying], share[flying] = energy[mildest], spread[mildest], rest  # they need no more than it
    flying += 1
    total += rest
    need = _exceeded_by(known.epsilon * total, total, energy[:flying], spread[:flying], share[:flying])
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
    table: NDArray[np.float64],
) -> float:
    """Look up, or work out and keep, what a flight may need that takes off about a time."""
    slot = slot_of(truth, time_s)
    k = int((time_s - truth.start_s) // GRID_S)
    need = _energy_at(known, row, truth, member, segments, cost, table, slot, 2 * k + 1)
    return max(need, _energy_at(known, row, truth, member, segments, cost, table, slot, 2 * k + 2))


@compiled_lean
def next_change(truth: SegmentWind, time_s: float) -> float:
    """First time after one from which on `energy_about` may say something else."""
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
    table: NDArray[np.float64],
    slot: int,
    point: int,
) -> float:
    """What a flight needs at point 2 k + 1, the beginning of interval k, or 2 k + 2, its end, kept where both are one."""
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
    begin = points + 2 * slot
    if math.isnan(table[begin]):
        at = truth.start_s + slot * truth.slot_s
        table[begin], table[begin + 1] = flight_energy(known, row, segments, at, north, east, cost)
    if time_s + table[begin + 1] <= slot_end(truth, slot):
        need = table[begin]
    else:
        need, _ = flight_energy(known, row, segments, time_s, north, east, cost)
    if 0 <= key < points:
        table[key] = need
    return float(need)


def required_soc_tables(truth: SegmentWind, legs: int) -> NDArray[np.float64]:
    """Return tables for `fly_by_required_soc` in which nothing is known yet.

    For each point of `GRID_S` what a flight needs, and then for each slot what it needs at its beginning and how long it
    may last; see `flight_energy`.
    """
    members, slots, _ = truth.north.shape
    return np.full((members, legs, 2 * int(slots * truth.slot_s / GRID_S) + 4 + 2 * slots), np.nan)
