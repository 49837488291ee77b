"""Kernels that fly a route whose charges are decided at each stop.

At a stop the drone leaves at the first time t at which its charge is enough for the next flight in all but a share
epsilon of what it must expect (`planner.robust.required_soc_kernels`), with the ratio of its energy to the model's
that must be expected of it, of which each leg tells more:

    soc(t) >= landing + ratio (1 + margin) E(t),    soc(t) = F(F^-1(soc) + t - pad time) once it charges

with E(t) what a flight at t may need and F the charging curve from empty; and at which the wind lets it fly and there
is likely room at the station where it goes (`planner.robust.free_capacity_kernels`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER, next_opening, slot_end, slot_of
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.robust.free_capacity_kernels import FreeCapacity, is_room, next_look, others_at
from skyway.planner.robust.information_kernels import energy_belief_after
from skyway.planner.robust.required_soc_kernels import energy_about, next_change
from skyway.planner.schedule.profile_kernels import interpolate
from skyway.planner.schedule.schedule_kernels import (
    COLUMNS,
    PAD,
    READY,
    ROOM,
    SOC_LANDING,
    SOC_TAKE_OFF,
    TAKE_OFF,
    TOUCH_DOWN,
    sampled_pad,
    to_next_stop,
)
from skyway.planner.schedule.shut_kernels import closed_for, held_off, past_closures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind
    from skyway.planner.robust.free_capacity_kernels import Present
    from skyway.planner.robust.information_kernels import Known
    from skyway.planner.schedule.gust_kernels import Disturbance
    from skyway.planner.schedule.schedule_kernels import Legs, Queues
    from skyway.planner.schedule.shut_kernels import Shut

_CHANGES = 500  # times a stay is checked again


class Stop(NamedTuple):
    """A stay before a flight, as `_leave` sees it.

    Attributes
    ----------
    now_s, soc : float
        Landing, and charge then.
    pad_s : float
        When it can have a pad; infinite where there is none.
    landing : float
        Least charge at the end of the flight.
    ratio, deviation : float
        Multiple of the model's energy to expect of the flight; see `planner.robust.information_kernels.energy_belief_after`.
    at_once, first : bool
        It cannot stay; it is where the delivery begins.
    not_before_s : float
        It is not left before; -inf: at any time.
    """

    now_s: float
    soc: float
    pad_s: float
    landing: float
    ratio: float
    deviation: float
    at_once: bool
    first: bool
    not_before_s: float


@compiled_lean
def _leave(
    known: Known,
    row: int,
    truth: SegmentWind,
    member: int,
    segments: NDArray[np.int64],
    cost: tuple[float, float],
    stop: Stop,
    curve: tuple[NDArray[np.float64], NDArray[np.float64]],
    room: tuple[FreeCapacity, int, Queues, Present, int],
    table: NDArray[np.float64],
    shut: Shut,
) -> tuple[float, float, float, float, float, float]:
    """Find when the drone leaves a stop by the rule: (pad or landing, ready, take-off, charge, need, held for room).

    From when it is ready to the take-off it holds: for room at the next station so many seconds, else for wind that it
    may fly in or that its battery is enough for. The take-off is infinite where the rule never lets it leave; it was then held
    for room, above 0, or not. Times are POSIX seconds, `need` is E as SoC.

    Parameters
    ----------
    known, row, truth, member, segments, cost, table
        The rule and the flight, see `planner.robust.required_soc_kernels.energy_about`.
    stop : Stop
        The stay.
    curve : (curve_s, curve_soc)
        F, shape (points,) each.
    room : (FreeCapacity, leg, Queues, Present, entry)
        Who is at the next station, see `planner.robust.free_capacity_kernels.next_look`.
    shut : Shut
        When this station and the next one are closed: places leg and leg + 1.
    """
    curve_s, curve_soc = curve
    # F^-1 of the charge on landing; `at` is the time considered.
    u = interpolate(stop.soc, curve_soc, curve_s)
    here = room[1]
    at = max(stop.now_s, stop.not_before_s)
    ready = at
    for_room = 0.0
    charging = False
    for _ in range(_CHANGES):
        # What the flight may need by what is known now, and the charge wanted with error and margin.
        base = energy_about(known, row, truth, member, segments, at, cost, stop.deviation, table)
        wanted = stop.landing + stop.ratio * (1.0 + known.margin) * base
        if known.full and not stop.first:
            wanted = max(wanted, curve_soc[-1])
        charging = charging or wanted > stop.soc
        # The charge by now.
        level = stop.soc
        if charging and at > stop.pad_s:
            level = interpolate(u + at - stop.pad_s - closed_for(shut, here, stop.pad_s, at), curve_s, curve_soc)
        if level >= wanted - 1e-9 or stop.at_once:
            # Enough: leave, unless the wind or the next station is closed; then try again when that may have changed.
            opening = next_opening(truth, member, segments, at)
            if opening == NEVER:
                break
            flight = max(base - cost[1], 0.0) / cost[0]
            looks, leg, queues, there, entry = room
            begin = held_off(shut, here + 1, truth, segments, at, flight)
            if opening > at + 1e-6:
                at = opening
            elif begin > at + 1e-6 and not stop.at_once:
                for_room += begin - at
                at = begin
            elif (
                looks.most < 1.0
                and not stop.at_once
                and not is_room(looks, leg, others_at(queues, there, entry, at), at, flight)
            ):
                looked = next_look(looks, leg, queues, there, entry, at, flight, next_change(truth, at))
                for_room += looked - at
                at = looked
            else:
                pad = stop.pad_s if charging and at > stop.pad_s else stop.now_s
                return pad, min(ready, at), at, level, base, for_room
            continue
        # Not enough: go to when the charge is reached or the wind changes, whichever is first.
        reached = NEVER
        if wanted <= curve_soc[-1] and stop.pad_s < NEVER:
            reached = stop.pad_s + interpolate(wanted, curve_soc, curve_s) - u
            reached = past_closures(shut, here, stop.pad_s, reached)
            ready = max(reached, at)
            for_room = 0.0  # what it held before, it charged in
        edge = slot_end(truth, slot_of(truth, at))
        if reached <= edge:
            at = max(reached, at + 1e-3)
        elif edge == NEVER:
            break
        else:
            at = edge
    return stop.now_s, ready, NEVER, stop.soc, 0.0, for_room


@compiled
def fly_by_required_soc(
    known: Known,
    landing: NDArray[np.float64],
    disturbance: Disturbance,
    truth: SegmentWind,
    member: NDArray[np.int64],
    row: NDArray[np.int64],
    legs: Legs,
    queues: Queues,
    start: tuple[float, float],
    cost: tuple[float, float],
    room: FreeCapacity,
    there: Present,
    tables: NDArray[np.float64],
    at_once: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fly a sequence of legs in several runs, charging by what is known at each stop.

    The energy of each leg is measured; that of the next ones is judged by it (`energy_belief_after`). O(runs x legs), apart from needs
    that no table has yet.

    Takes members, rows and sets of queues that are there, and a segment or more for each leg;
    `planner.problem.kernel_inputs` checks them in `ChargePolicy.fly`.

    Parameters
    ----------
    known : Known
        The rule.
    landing : ndarray, shape (legs,)
        Least charge at the end of each: the reserve, and at the last the way on.
    disturbance, truth, member
        What is true in each run: see `planner.schedule.schedule_kernels.fly_under`.
    row : ndarray of int, shape (runs,)
        Row of `Known.share` of each run.
    legs, queues, start, cost
        As there; of `Legs` all but the charges are read.
    room, there : FreeCapacity, Present
        Of the stations at the ends of the legs, and who is at those before them.
    tables : ndarray, shape (members, legs, points)
        Needs found so far, NaN where not yet; written to. They hold for the same truth, flights and forecast, whatever
        the margin. See `required_soc_tables`.
    at_once : bool
        At the first stop, see `Stop`.

    Returns
    -------
    schedule : ndarray, shape (runs, legs, 7)
        As `fly_under`; infinite from the leg on that is never flown.
    energy_ratio : ndarray, shape (runs, legs)
        Energy that the flight took as a share of what the rule without its margin charges for; 0 where not flown.
    """
    count = len(landing)
    runs = len(member)
    sets = (len(queues.offset) - 1) // (count + 1)
    out = np.full((runs, count, COLUMNS), NEVER)
    energy_ratio = np.zeros((runs, count))
    for run in range(runs):
        now, soc = start
        joined = now
        seen = 0.0  # sum of the ratios of the legs so far
        for leg in range(count):
            segments = legs.segments[legs.offset[leg] : legs.offset[leg + 1]]
            entry = leg * sets + disturbance.queue[run]
            # The stop: when there is a pad, and when the rule lets the drone leave.
            pad = NEVER
            if legs.has_pads[leg]:
                pad = max(now, sampled_pad(queues, entry, joined))
            first = leg == 0
            expected, deviation = energy_belief_after(known, seen / max(leg, 1), leg)
            stop = Stop(
                now, soc, pad, landing[leg], expected, deviation, at_once and first, first, legs.not_before_s[leg]
            )
            curve = legs.curve_s[leg], legs.curve_soc[leg]
            pad, ready, off, level, base, for_room = _leave(
                known,
                row[run],
                truth,
                member[run],
                segments,
                cost,
                stop,
                curve,
                (room, leg, queues, there, entry + sets),
                tables[member[run], leg],
                legs.shut,
            )
            out[run, leg, ROOM] = for_room
            if off == NEVER:
                break
            out[run, leg, PAD], out[run, leg, READY] = pad, ready
            out[run, leg, TAKE_OFF], out[run, leg, SOC_TAKE_OFF] = off, level
            # The flight, in the true wind, with gusts and the vehicle's own energy, and hovering until there is a place.
            ratio = disturbance.energy[run, leg % disturbance.energy.shape[1]]
            now, joined, soc = to_next_stop(
                disturbance, run, ratio, truth, member[run], segments, off, level, cost, queues, entry + sets
            )
            out[run, leg, TOUCH_DOWN], out[run, leg, SOC_LANDING] = now, soc
            used = ratio * (cost[1] + cost[0] * (joined - off))
            # What the flight has shown of the vehicle.
            energy_ratio[run, leg] = used / (expected * base) if base > 0.0 else 0.0
            seen += ratio
    return out, energy_ratio
