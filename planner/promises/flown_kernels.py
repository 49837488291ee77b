"""Kernel that flies the plan of a fleet in one world, in order of time: pads are taken first come, first served, by our drones and by others.

The rules are those of a supervised flight. A charge goes on to what was planned, and to what the check before the next take-off wants: the
reserve and q E, with E the energy of that flight in the wind of now and q the ratio to it that all but a share epsilon of flights stay below. Who has less at a take-off
charges first; who cannot have it, or whom the wind keeps on the ground, looks again after `AGAIN_S`. A flight takes r E, r the ratio drawn, and the time
g + k T: T that in the air by the wind of now, k the factor and g the time on the ground and of manoeuvres drawn; a charge its time times the factor drawn.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.dispatch.flight_kernels import CHARGE, interpolated, slot_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import Flights

AGAIN_S = 600.0
LONGEST_S = 12 * 3600.0
"""So long after the beginning nobody looks again."""
SLACK_SOC = 1e-6
BELOW_SOC = 0.005
"""A landing so little below the reserve is none: charges are told in whole percent."""


class Checked(NamedTuple):
    """Ratio of the energy that the check before a take-off counts with to the model's: `share` + `pace_mps` / ground speed, within two limits; shape (drones,) each."""

    share: NDArray[np.float64]
    pace_mps: NDArray[np.float64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]


class Steps(NamedTuple):
    """What all drones of a plan do, one drone after another."""

    first: NDArray[np.int64]
    """Shape (drones + 1,): steps of drone d are first[d] : first[d + 1]."""
    kind: NDArray[np.int64]
    place: NDArray[np.int64]
    to: NDArray[np.int64]
    mode: NDArray[np.int64]
    """Shape (steps,) each: fly or charge, from where, to where, and as which mode of the flights."""
    up_to: NDArray[np.float64]
    """Shape (steps,): charge with which a charge was planned to end."""
    not_before_s: NDArray[np.float64]
    """Shape (steps,): when the package is ready that is taken up before a step; -inf where none is."""
    delivers: NDArray[np.int64]
    """Shape (steps,): order that is delivered with a step; -1 where none is."""
    mass: NDArray[np.float64]
    """Shape (steps,): power with the package over that of the mode, which is the next heavier class."""
    soc: NDArray[np.float64]
    from_s: NDArray[np.float64]
    type: NDArray[np.int64]
    scale: NDArray[np.float64]
    """Shape (drones,) each, as of `problem.Fleet`."""
    checked: Checked
    """What the check before a take-off counts with."""
    far_m: NDArray[np.float64]
    """Shape (steps,): length of the shortest way of a flight."""
    fixed_s: float
    """Time in the air beyond that way."""


class World(NamedTuple):
    """One realization of what is not known."""

    time_s: NDArray[np.float64]
    need: NDArray[np.float64]
    """Shape (modes, slots, places, places) each: time of flights in the air, and what the model says of their energy."""
    ratio: NDArray[np.float64]
    """Shape (steps,): energy over the model's."""
    pace: NDArray[np.float64]
    more_s: NDArray[np.float64]
    """Shape (steps,) each: factor of the time in the air, and time besides."""
    charging: NDArray[np.float64]
    """Shape (steps,): factor of the time of a charge."""
    asked: NDArray[np.float64]
    """Shape (steps,): deviation of the ratio that the check counts with."""
    come_s: NDArray[np.float64]
    lasts_s: NDArray[np.float64]
    begin: NDArray[np.int64]
    """Others at the pads: those of place p are begin[p] : begin[p + 1], in order of coming."""


@compiled
def pad_free_s(free_s: NDArray[np.float64], low: int, high: int) -> int:
    """Pad of a place that is free first."""
    best = low
    for pad in range(low + 1, high):
        if free_s[pad] < free_s[best]:
            best = pad
    return best


@compiled
def take_pad(flights: Flights, world: World, free_s: NDArray[np.float64], come: NDArray[np.int64], place: int, time_s: float, lasts_s: float) -> float:  # fmt: skip
    """Take the first pad that is free, behind all others who have come; returns when."""
    low, high = flights.first_pad[place], flights.first_pad[place] + flights.pads[place]
    while come[place] < world.begin[place + 1] and world.come_s[come[place]] <= time_s:
        pad = pad_free_s(free_s, low, high)
        free_s[pad] = max(free_s[pad], world.come_s[come[place]]) + world.lasts_s[come[place]]
        come[place] += 1
    pad = pad_free_s(free_s, low, high)
    begin_s: float = max(free_s[pad], time_s)
    free_s[pad] = begin_s + lasts_s
    return begin_s


@compiled
def wanted_soc(flights: Flights, steps: Steps, world: World, drone: int, step: int, time_s: float) -> float:
    """Charge that the check wants before the next flight of a drone, from a step on; 0 where there is none."""
    for later in range(step, steps.first[drone + 1]):
        if steps.kind[later] != CHARGE:
            mode, slot, place, to = steps.mode[later], slot_at(flights, time_s), steps.place[later], steps.to[later]
            along_s = max(world.time_s[mode, slot, place, to] - steps.fixed_s, 1.0)
            ratio = steps.checked.share[drone] + steps.checked.pace_mps[drone] * along_s / max(steps.far_m[later], 1.0)
            ratio = min(max(ratio, steps.checked.least[drone]), steps.checked.most[drone]) + world.asked[later]
            need = world.need[mode, slot, place, to]
            wanted: float = flights.reserve + ratio * steps.scale[drone] * steps.mass[later] * need
            return wanted
    return 0.0


@compiled
def flown(
    flights: Flights, steps: Steps, world: World, delivered_s: NDArray[np.float64], lowest: NDArray[np.float64]
) -> None:  # fmt: skip
    """Fly a plan in a world.

    `delivered_s`, shape (orders,), infinite before, has when each order is delivered; `lowest`, shape (steps,), NaN before, the charge at
    each landing. A drone without charge is lost.

    Takes steps between places of the flights, and a world of as many modes, slots and places.
    """
    drones = len(steps.soc)
    soc, at = steps.soc.copy(), steps.first[:-1].copy()
    free_s = np.full(int(flights.pads.sum()), -np.inf)
    come = world.begin[:-1].copy()
    begin_s = steps.from_s.min() if drones else 0.0
    events = [(steps.from_s[drone], drone) for drone in range(drones) if steps.first[drone + 1] > steps.first[drone]]
    heapq.heapify(events)
    while len(events) > 0:
        time_s, drone = heapq.heappop(events)
        step = at[drone]
        if time_s < steps.not_before_s[step]:
            heapq.heappush(events, (steps.not_before_s[step], drone))
            continue
        place, mode, charges = steps.place[step], steps.mode[step], steps.kind[step] == CHARGE
        wanted = wanted_soc(flights, steps, world, drone, step, time_s)
        takes_s = 0.0
        if not charges:
            takes_s = world.more_s[step] + world.pace[step] * world.time_s[mode, slot_at(flights, time_s), place, steps.to[step]]  # fmt: skip
        short = wanted > soc[drone] + SLACK_SOC and flights.pads[place] > 0
        if not charges and (not takes_s < np.inf or (short and wanted > 1.0 + SLACK_SOC)):
            if time_s < begin_s + LONGEST_S:
                heapq.heappush(events, (time_s + AGAIN_S, drone))
            continue
        up_to = min(max(wanted, steps.up_to[step] if charges else 0.0), 1.0) if wanted < np.inf else steps.up_to[step]
        if (charges or short) and up_to > soc[drone] + SLACK_SOC:
            curve = flights.curve_of[steps.type[drone], place]
            level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
            lasts_s = world.charging[step] * (interpolated(level, at_s, up_to) - interpolated(level, at_s, soc[drone]))
            time_s = take_pad(flights, world, free_s, come, place, time_s, lasts_s) + lasts_s
            soc[drone] = up_to
            if not charges:  # the flight is looked at again then
                heapq.heappush(events, (time_s, drone))
                continue
        if not charges:
            need = world.need[mode, slot_at(flights, time_s), place, steps.to[step]]
            soc[drone] -= world.ratio[step] * steps.scale[drone] * steps.mass[step] * need
            time_s += takes_s
            lowest[step] = soc[drone]
            if soc[drone] < 0.0:
                continue
        if steps.delivers[step] >= 0:
            delivered_s[steps.delivers[step]] = time_s
        at[drone] = step + 1
        if step + 1 < steps.first[drone + 1]:
            heapq.heappush(events, (time_s, drone))
