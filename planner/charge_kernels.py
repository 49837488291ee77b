"""Compiled charging by what is known at each stop: how much the next flight needs, and flying by that rule.

At a stop the drone leaves as soon as its charge is enough for the next flight in all but a share epsilon of what it must
expect. What it must expect is the forecast seen from that moment: each member weighted by its likeness to the wind
measured now and shifted by its own residual, which fades as exp(-horizon / tau) (model.md, section 9), then gusts about
it, then the error of the energy model, which the first flight tells.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.compiled import compiled
from models.flight import Air
from models.flight_kernels import NEVER, land, next_opening, slot_end, slot_of, wind_on
from models.wind import MIN_GROUND_SPEED_MPS
from planner.course_kernels import (
    PAD,
    READY,
    SOC_DOWN,
    SOC_OFF,
    TAKE_OFF,
    TOUCH_DOWN,
    expected_pad,
    sampled_pad,
    sampled_spot,
)
from planner.evaluation_kernels import LATERAL, gusty_land
from planner.profile_kernels import interpolate
from planner.room_kernels import Room, is_room

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from planner.course_kernels import Hops, Queues, Waits
    from planner.evaluation_kernels import Sky
    from planner.room_kernels import Present

GRID_S = 600.0
"""What a flight needs is worked out for take-offs within so long together; the most of both ends counts."""
LEARNED = 0.005
"""What is left of the energy error once a flight has shown it."""
LEAST_CHANCE = 1e-9
"""Likeness below which a member does not count."""
LOOK_S = 120.0
"""A drone that finds no room at the next station looks again after so long."""
WORST = 12
"""Members, of those with the strongest wind against the way, whose flights are worked out; the others are taken to need
what the mildest of these does, which is no less than they need."""
STEADY = 3.0
"""Standard deviations of what is unsure at which the time that it costs is worked out; it is taken as linear in them."""
_ROUNDS = 14  # of bisection: the charge is found to 1e-4 of the spread
_CHANGES = 500  # times a stay is looked at again


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
        Of gusts, see `planner.evaluation_kernels.Sky`.
    energy_error : float
        A vehicle may need this share more than the model says.
    epsilon : float
        Share of flights that may need more than is charged for.
    margin : float
        Calibrated: multiplies the energy that a flight needs beyond that.
    full : bool
        Every charge is to 100 %, whatever is needed.
    """

    air: Air
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


class Stop(NamedTuple):
    """A stay before a flight, as `_leave` sees it.

    Attributes
    ----------
    now_s, soc : float
        Landing, and charge then.
    pad_s : float
        When it can have a pad.
    not_before_s : float
        It stays until then.
    landing : float
        Least charge at the end of the flight.
    error : float
        Of the vehicle's energy: the flight may take this share more.
    plugged, at_once, first : bool
        It takes a pad whether or not it needs one; it cannot stay; it is where the delivery begins.
    """

    now_s: float
    soc: float
    pad_s: float
    not_before_s: float
    landing: float
    error: float
    plugged: bool
    at_once: bool
    first: bool


@compiled
def expected_winds(
    known: Known, first: int, wind_north: NDArray[np.float64], wind_east: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Members from slot `first` on as seen with the wind measured in it, or as they are where nobody measures.

    Returns
    -------
    north, east : ndarray, shape (members, count, sites)
        Shifted members.
    miss : ndarray, shape (members,)
        Mean square of the residual of one component, m2/s2.
    """
    air = known.air
    members, slots, sites = air.north.shape
    north, east = np.empty((members, count, sites)), np.empty((members, count, sites))
    miss = np.zeros(members)
    fade = np.exp(-np.arange(count) * air.slot_s / known.tau_s)
    for m in range(members):
        for site in range(sites):
            dn = wind_north[site] - air.north[m, first, site] if known.measured else 0.0
            de = wind_east[site] - air.east[m, first, site] if known.measured else 0.0
            miss[m] += (dn * dn + de * de) / (2.0 * sites)
            for k in range(count):
                slot = min(first + k, slots - 1)
                north[m, k, site] = air.north[m, slot, site] + dn * fade[k]
                east[m, k, site] = air.east[m, slot, site] + de * fade[k]
    return north, east, miss


@compiled
def gust_mean(known: Known, flight_s: float) -> float:
    """Standard deviation of the mean of a flight's gusts, as a share of the wind.

    The mean of an Ornstein-Uhlenbeck process of time constant tau over T has the variance
    2 tau / T (1 - tau / T (1 - exp(-T / tau))) of one value.
    """
    x = known.gust_time_s / max(flight_s, 1.0)
    return known.gust_sd * math.sqrt(2.0 * x * (1.0 - x * (1.0 - math.exp(-1.0 / x))))


@compiled
def slow_land(known: Known, air: Air, member: int, segments: NDArray[np.int64], depart_s: float, gust: float) -> float:
    """Touch-down of a flight through wind that is worse all the way than the member says, by `STEADY` deviations.

    Of the wind itself after the hour of the take-off, and of the mean of gusts, `gust` as a share of the wind. Whether the
    flight is flyable is `land`'s to say.
    """
    now = depart_s + air.climb_s
    first = slot_of(air, depart_s)
    for segment in segments:
        left = air.distance_m[segment]
        slot = slot_of(air, now)
        while True:
            north, east = wind_on(air, member, slot, segment)
            along = north * air.cos_bearing[segment] + east * air.sin_bearing[segment]
            across = east * air.cos_bearing[segment] - north * air.sin_bearing[segment]
            speed = along + math.sqrt(max(air.airspeed_mps * air.airspeed_mps - across * across, 0.0))
            unsure = known.sigma_mps * known.smoothing
            unsure *= math.sqrt(1.0 - math.exp(-2.0 * (slot - first) * air.slot_s / known.tau_s))
            speed -= STEADY * math.hypot(gust * math.hypot(along, LATERAL * across), unsure)
            speed = min(max(speed, MIN_GROUND_SPEED_MPS), air.max_ground_speed_mps)
            end = slot_end(air, slot)
            if now + left / speed <= end:
                now += left / speed
                break
            left -= speed * (end - now)
            now = end
            slot += 1
    return now + air.descent_s


@compiled
def _worst_first(
    air: Air,
    segments: NDArray[np.int64],
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    chance: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Members that count, those with the strongest wind against the way as a whole first."""
    to_north, to_east = 0.0, 0.0
    for segment in segments:
        to_north += air.distance_m[segment] * air.cos_bearing[segment]
        to_east += air.distance_m[segment] * air.sin_bearing[segment]
    score = np.empty(len(chance))
    for m in range(len(chance)):
        score[m] = NEVER
        if chance[m] > LEAST_CHANCE:
            score[m] = 0.0
            for k in range(min(2, north.shape[1])):
                for site in range(north.shape[2]):
                    score[m] += to_north * north[m, k, site] + to_east * east[m, k, site]
    order = np.argsort(score)
    count = 0
    while count < len(order) and score[order[count]] < NEVER:
        count += 1
    return order[:count]


@compiled
def flight_energy(
    known: Known,
    row: int,
    segments: NDArray[np.int64],
    time_s: float,
    wind_north: NDArray[np.float64],
    wind_east: NDArray[np.float64],
    cost: tuple[float, float],
) -> float:
    """Energy, as SoC, that a flight taking off at `time_s` exceeds with the probability epsilon only.

    `wind_north` and `wind_east`, shape (sites,), are measured in the slot of `time_s`. Members over the limits do not
    count (nobody would fly); without any other, never.
    """
    air = known.air
    first = slot_of(air, time_s)
    count = int(math.ceil(2.0 * 3600.0 / air.slot_s)) + 1
    members = air.north.shape[0]
    north, east, miss = expected_winds(known, first, wind_north, wind_east, count)
    seen = Air(
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
    least = NEVER
    for m in range(members):
        if known.share[row, m] > 0.0:
            least = min(least, miss[m])
    chance = np.zeros(members)
    for m in range(members):
        chance[m] = known.share[row, m] * math.exp(-0.5 * (miss[m] - least) / (known.sigma_mps * known.sigma_mps))
    order = _worst_first(air, segments, north, east, chance)
    energy, spread, share = np.empty(members + 1), np.empty(members + 1), np.empty(members + 1)
    flying, total, low, high, mildest = 0, 0.0, NEVER, 0.0, 0
    seen_enough = 0
    for m in order:
        if flying >= WORST:
            break
        seen_enough += 1
        down = land(seen, m, segments, time_s)
        if down == NEVER:
            continue
        flight = down - time_s
        slow = slow_land(known, seen, m, segments, time_s, gust_mean(known, flight)) - down
        energy[flying] = cost[1] + cost[0] * flight
        spread[flying] = max(cost[0] * slow / STEADY, 1e-9)
        share[flying] = chance[m]
        total += chance[m]
        if energy[flying] < low:
            low, mildest = energy[flying], flying
        high = max(high, energy[flying] + 6.0 * spread[flying])
        flying += 1
    if flying == 0:
        return NEVER
    rest = 0.0
    for m in order[seen_enough:]:
        rest += chance[m]
    energy[flying], spread[flying], share[flying] = energy[mildest], spread[mildest], rest  # they need no more than it
    flying += 1
    total += rest
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        beyond = 0.0
        for m in range(flying):
            beyond += share[m] * 0.5 * math.erfc((middle - energy[m]) / spread[m] * math.sqrt(0.5))
        if beyond > known.epsilon * total:
            low = middle
        else:
            high = middle
    return float(high)


@compiled
def _energy_about(
    known: Known,
    row: int,
    truth: Air,
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


@compiled
def _energy_at(
    known: Known,
    row: int,
    truth: Air,
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
    if 0 <= key < len(table) and not math.isnan(table[key]):
        return float(table[key])
    need = flight_energy(known, row, segments, time_s, truth.north[member, slot], truth.east[member, slot], cost)
    if 0 <= key < len(table):
        table[key] = need
    return need


@compiled
def _leave(
    known: Known,
    row: int,
    truth: Air,
    member: int,
    segments: NDArray[np.int64],
    cost: tuple[float, float],
    stop: Stop,
    curve: tuple[NDArray[np.float64], NDArray[np.float64]],
    room: tuple[Room, int, Queues, Present, int],
    table: NDArray[np.float64],
) -> tuple[float, float, float, float, float]:
    """Find when the drone leaves a stop by the rule: (pad or landing, ready but for the wind, take-off, charge, need).

    The take-off is infinite where the rule never lets it leave.
    """
    curve_s, curve_soc = curve
    u = interpolate(stop.soc, curve_soc, curve_s)
    at = max(stop.now_s, stop.not_before_s)
    ready = at
    charging = stop.plugged
    for _ in range(_CHANGES):
        base = _energy_about(known, row, truth, member, segments, at, cost, table)
        wanted = stop.landing + (1.0 + stop.error) * (1.0 + known.margin) * base
        if known.full and not stop.first:
            wanted = max(wanted, curve_soc[-1])
        charging = charging or wanted > stop.soc
        level = stop.soc
        if charging and at > stop.pad_s:
            level = interpolate(u + at - stop.pad_s, curve_s, curve_soc)
        if level >= wanted - 1e-9 or stop.at_once:
            opening = next_opening(truth, member, segments, at)
            if opening == NEVER:
                break
            flight = max(base - cost[1], 0.0) / cost[0]
            looks, hop, queues, there, entry = room
            if opening > at + 1e-6:
                at = opening
            elif looks.most < 1.0 and not stop.at_once and not is_room(looks, hop, queues, there, entry, at, flight):
                at += LOOK_S
            else:
                return stop.pad_s if charging else stop.now_s, min(ready, at), at, level, base
            continue
        reached = NEVER
        if wanted <= curve_soc[-1]:
            reached = stop.pad_s + interpolate(wanted, curve_soc, curve_s) - u
            ready = max(reached, at)
        edge = slot_end(truth, slot_of(truth, at))
        if reached <= edge:
            at = max(reached, at + 1e-3)
        elif edge == NEVER:
            break
        else:
            at = edge
    return stop.now_s, ready, NEVER, stop.soc, 0.0


def need_tables(truth: Air, hops: int) -> NDArray[np.float64]:
    """Return tables for `fly_by_need` in which nothing is known yet."""
    members, slots, _ = truth.north.shape
    return np.full((members, hops, 2 * int(slots * truth.slot_s / GRID_S) + 4), np.nan)


@compiled
def fly_by_need(
    known: Known,
    landing: NDArray[np.float64],
    sky: Sky,
    truth: Air,
    member: NDArray[np.int64],
    row: NDArray[np.int64],
    hops: Hops,
    queues: Queues,
    waits: Waits,
    start: tuple[float, float],
    cost: tuple[float, float],
    room: Room,
    there: Present,
    tables: NDArray[np.float64],
    learned: bool,
    plugged: bool,
    at_once: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fly a sequence of hops in several runs, charging by what is known at each stop.

    Parameters
    ----------
    known : Known
        The rule.
    landing : ndarray, shape (hops,)
        Least charge at the end of each: the reserve, and at the last the way on.
    sky, truth, member
        What is true in each run: see `planner.course_kernels.fly_under`.
    row : ndarray of int, shape (runs,)
        Row of `Known.share` of each run.
    hops, queues, waits, start, cost
        As there; `Hops.charge_to` is not read.
    room, there : Room, Present
        Of the stations at the ends of the hops, and who is at those before them; looked at where queues are sampled.
    tables : ndarray, shape (members, hops, points)
        Needs found so far, NaN where not yet; written to. They hold for the same truth, flights and forecast, whatever
        the margin. See `need_tables`.
    learned : bool
        The vehicle's error of energy is known from the start.
    plugged, at_once : bool
        At the first stop, see `Stop`.

    Returns
    -------
    course : ndarray, shape (runs, hops, 6)
        As `fly_under`; infinite from the hop on that is never flown.
    strain : ndarray, shape (runs, hops)
        Energy that the flight took as a share of what the rule without its margin charges for; 0 where not flown.
    """
    count = len(landing)
    runs = len(member)
    out = np.full((runs, count, 6), NEVER)
    strain = np.zeros((runs, count))
    sampled = len(queues.offset) > 1
    nobody = Room(room.pads, room.spots, room.arrivals_per_s, room.services_per_s, 1.0)
    for run in range(runs):
        now, soc = start
        error = sky.energy[run] - 1.0 + LEARNED if learned else known.energy_error
        for hop in range(count):
            segments = hops.segments[hops.offset[hop] : hops.offset[hop + 1]]
            entry = sky.queue[run] * count + hop
            joined = now  # a drone that hovers for a spot keeps its place in the queue
            if hop > 0 and sampled:
                spot = sampled_spot(queues, entry, now)
                soc -= sky.energy[run] * cost[0] * (spot - now)
                out[run, hop - 1, TOUCH_DOWN], out[run, hop - 1, SOC_DOWN] = spot, soc
                now = spot
            pad = max(now, sampled_pad(queues, entry, joined)) if sampled else expected_pad(waits, hop, now)
            first = hop == 0
            stop = Stop(
                now, soc, pad, hops.not_before_s[hop], landing[hop], error, plugged and first, at_once and first, first
            )
            curve = hops.curve_s[hop], hops.curve_soc[hop]
            looks = room if sampled and hop < count - 1 else nobody
            pad, ready, off, level, base = _leave(
                known,
                row[run],
                truth,
                member[run],
                segments,
                cost,
                stop,
                curve,
                (looks, hop, queues, there, entry + 1),
                tables[member[run], hop],
            )
            if off == NEVER:
                break
            out[run, hop, PAD], out[run, hop, READY] = pad, ready
            out[run, hop, TAKE_OFF], out[run, hop, SOC_OFF] = off, level
            now = gusty_land(truth, member[run], segments, off, sky.gust_key[run], sky.gust_sd, sky.gust_time_s)
            used = sky.energy[run] * (cost[1] + cost[0] * (now - off))
            soc = level - used
            out[run, hop, TOUCH_DOWN], out[run, hop, SOC_DOWN] = now, soc
            strain[run, hop] = used / ((1.0 + error) * base) if base > 0.0 else 0.0
            error = sky.energy[run] - 1.0 + LEARNED
    return out, strain
