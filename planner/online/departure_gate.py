"""Requirements on a leg before it begins: charge that keeps the reserve, a divert station for every point of it, and wind that allows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, percent, probability, speed_text, zone_clock
from skyway.models.base.units import from_posix
from skyway.models.base.views import counted
from skyway.planner.online.options import along_way
from skyway.planner.reach.diverts import DivertCover, PointFlights
from skyway.planner.reach.reach import SOC_SD
from skyway.planner.robust.free_capacity import no_place_probability, turned_for_room_probability

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.planner.online.following import Step
    from skyway.planner.online.information import Information
    from skyway.planner.online.policy import OnlinePolicy
    from skyway.planner.problem.problem import Problem
    from skyway.planner.reach.reach import Place, Reach

STEPS = 1000
"""Into which the charge is divided."""
MUCH = 0.95
"""Quantile of the energy of a flight that a charge must last for, for a stop to be left out."""
FINE_SOC = 0.01
"""So near to the least one is a charge with which every point has a divert station."""


@dataclass(frozen=True, slots=True)
class Gated:
    """Result of the departure gate for a leg."""

    names: tuple[str, ...]
    """Stations of the whole leg, from where it stands."""
    soc: float | None = None
    """Least charge; None where no charge does."""
    leg_soc: float = 0.0
    """Charge that would do if not every point had to have a divert station."""
    used_soc: float = 1.0
    """Charge that the leg takes on average, as far as it must be sure of it."""
    diverts: tuple[str, ...] = ()
    """Divert stations that every point has one of."""
    why: str = ""
    """Why no charge does."""
    held: str = ""
    """Why the wind most probably does not let it leave now; nothing where it does."""
    figures: Mapping[str, Any] = field(default_factory=dict)
    """What that is told by."""
    hopeless: bool = False
    """With the charge of the step the end of the leg most probably breaks the reserve: it would land before."""
    p_below: float = 0.0
    """Where no charge does: probability of landing below what is kept, fully charged; 1 where it lacks divert stations."""


class Later(NamedTuple):
    """When a leg that cannot be begun now can be."""

    wait_s: float | None
    """So much later by the forecast, s; None: at none of the times that are looked at."""
    may_open: bool = True
    """At one of them it more probably keeps the reserve than not: then the wind of that hour will tell."""


class _Taken(NamedTuple):
    """Charge that a leg takes, each of shape (members, 1)."""

    time_s: float
    """On average."""
    cost: NDArray[np.float64]
    """Without what is unknown of the wind ahead."""
    doubt: NDArray[np.float64]
    """Standard deviation of that."""
    rest: NDArray[np.float64]
    """The same of its second half alone, halfway."""
    energy_soc: float
    """Standard deviation halfway of what the second half takes in a known wind, and of the charge that is told then."""
    learnt: float = 0.0
    """Standard deviation of what the first half teaches of the energy of the flight, as a share of it."""


def _least(reach: Reach, below: tuple[NDArray[np.float64], float, NDArray[np.float64]], share: float) -> float | None:
    """Least charge with which something is below with no greater probability than a share; None: there is none."""
    low, high = 0, STEPS + 1
    while low < high:
        middle = (low + high) // 2
        if float(reach.p_below(middle / STEPS, *below)[0]) <= share:
            high = middle
        else:
            low = middle + 1
    return low / STEPS if low <= STEPS else None


class DepartureGate:
    """Checks of legs before they begin, from the information on the ground."""

    def __init__(self, policy: OnlinePolicy, info: Information, p: Problem) -> None:
        self._policy, self._info, self._problem = policy, info, p
        self._epsilon = policy.epsilon_of(info)
        self._kept: dict[str, float] = {}
        self._reserve = policy.request.reserve_soc
        """What the landing at the end of the leg that is checked keeps."""

    @cached_property
    def _reach(self) -> Reach:
        return self._policy.reach(
            self._info.near_forecast or self._info.forecast, self._info.belief.next_flight(), watched=self._info.watched,
            roughness=self._info.roughness,
        )  # fmt: skip

    @cached_property
    def _sigmas(self) -> float:
        """Standard deviations that a flight in the air must be able to lose: more is lost with epsilon."""
        return self._reach.belief.sigmas(1.0 - self._epsilon)

    def p_turned(self, step: Step) -> float:
        """Probability that a watched leg flown as a step prescribes turns back before the first station where it can land."""
        sure, reach, taken = self._leg(step)
        for_charge = float(reach.p_below(step.charge, *self._turned_below(taken, self._kept_at(sure[-1])))[0])
        if not self._info.measures_wind:
            for_charge = float(for_charge > self._epsilon)
        return 1.0 - (1.0 - for_charge) * (
            1.0 - self._p_no_room(sure, reach, taken, self._take_off_s(step), step.charge)
        )

    def charges(self, step: Step) -> list[float]:
        """Charges with which a watched leg is turned with some probabilities, the greatest probability first; those that a battery has."""
        sure, reach, taken = self._leg(step)
        below = self._turned_below(taken, self._kept_at(sure[-1]))
        shares = self._policy.parameters.turned_shares if self._info.measures_wind else (self._epsilon,)
        found = (_least(reach, below, share) for share in shares)
        return [one for one in found if one is not None]

    def kept_soc(self, step: Step) -> float:
        """Charge above the reserve that a leg must be expected to end with, to be flown on over the last station on its way where it can land; 0 where there is none.

        It is flown on where what is still unknown there breaks the reserve with epsilon at most.
        """
        return self._flown_on(step)[1] if step.last else 0.0

    def through_soc(self, step: Step) -> float:
        """Charge with which a leg is flown on over the last station on its way where it can land, also if it takes as much energy as one flight in twenty."""
        used_soc, kept_soc = self._flown_on(step)
        belief = self._reach.belief
        return self._policy.request.reserve_soc + kept_soc + used_soc * belief.quantile(MUCH) / belief.mean_ratio

    def _flown_on(self, step: Step) -> tuple[float, float]:
        """Charge that a leg takes on average, and `kept_soc`."""
        names, at_s = self._names(step), self._take_off_s(step)
        there, reach = self._way(names[: step.last + 1], at_s)
        flown = reach.to_the_end(there, at_s, climbs=True)
        rest = self._reach.way(names[step.last], names[step.last + 1 : -1], names[-1])
        onward = reach.to_the_end(rest, at_s + float(reach.expected(flown.time_s)))
        first_soc, rest_soc = float(reach.expected(flown.soc)), float(reach.expected(onward.soc))
        ratio = reach.belief.mean_ratio
        then = reach.belief.in_flight(first_soc * ratio, first_soc)
        wind_soc = ratio * float(reach.expected(onward.doubt))
        unknown = math.hypot(wind_soc, rest_soc * then.sd_between, SOC_SD)
        kept = self._sigmas * unknown + self._kept_at(names[-1]) - self._policy.request.reserve_soc
        return ratio * (first_soc + rest_soc), kept

    def _leg(self, step: Step) -> tuple[tuple[str, ...], Reach, _Taken]:
        """Stations of a leg as far as it must be sure of it, what can be flown there, and what that takes."""
        sure, at_s = self._sure(step, self._names(step)), self._take_off_s(step)
        way, reach = self._way(sure, at_s)
        return sure, reach, self._taken(reach, way, at_s)

    def _kept_at(self, station: str) -> float:
        """Charge that a landing keeps: the reserve, and what the way on from there takes."""
        if station not in self._kept:
            self._kept[station] = self._policy.request.reserve_soc + self._policy.way_on_soc(self._info, station)
        return self._kept[station]

    def _names(self, step: Step) -> tuple[str, ...]:
        """Stations of a whole leg, from where it stands."""
        network = self._problem.network
        stations = network.stations
        return stations[self._problem.origin].id, *(stations[int(network.head[one])].id for one in step.segments)

    @staticmethod
    def _sure(step: Step, names: tuple[str, ...]) -> tuple[str, ...]:
        """Those to the first at which it can land if need be."""
        return names[: 1 + (step.sure or len(step.segments))]

    def _way(self, names: tuple[str, ...], at_s: float) -> tuple[list[Place], Reach]:
        """A way over stations, and what can be flown where the wind lets it be flown."""
        way = self._reach.way(names[0], names[1:-1], names[-1])
        return way, self._reach.where_flown(way, at_s).measured_before(at_s - self._info.wind_measured_s)

    def charged(self, step: Step, at_least: float = 0.0) -> Gated:
        """Check the leg of a step at the take-off that the required charge leads to: while it charges, the wind measured before grows older."""
        gated = self.check(step, at_least=at_least)
        if step.turn_back is not None or not self._problem.has_pads(self._problem.origin):
            return gated
        before = max(step.charge, self._info.soc)
        while gated.soc is not None and before + FINE_SOC < gated.soc:
            before = gated.soc
            gated = self.check(replace(step, charge=before), at_least=before)
        return gated

    def check(self, step: Step, time_s: float | None = None, at_least: float = 0.0) -> Gated:
        """Check the leg of a step as far as it must be sure of it: to the first station where it can land if need be.

        No charge below `at_least` is asked about.
        """
        at_s = self._take_off_s(step) if time_s is None else time_s
        names = self._names(step)
        sure = self._sure(step, names)
        way, reach = self._way(sure, at_s)
        self._reserve = self._kept_at(sure[-1])
        taken = self._taken(reach, way, at_s)
        used_soc = self._mean_soc(reach, taken)
        least = self._keeps_reserve(reach, taken)
        if least is None:
            chance = self._p_below_reserve(reach, way, at_s, 1.0)
            on = (
                " (the reserve, and the charge for the flight on from there)"
                if self._reserve > self._policy.request.reserve_soc
                else ""
            )
            why = f"even fully charged the drone lands below {percent(self._reserve)}{on} at {sure[-1]} with probability {probability(chance)}"
            why = f"the leg to {sure[-1]} is not flown: {why}"
            return Gated(names, used_soc=used_soc, why=why, p_below=chance)
        covered = self._covered(
            reach, way, at_s, max(least, at_least, step.charge if step.turn_back is not None else 0.0), sure[-1]
        )
        if isinstance(covered, float):
            why = f"the leg to {sure[-1]} is not flown: from {distance_text(covered)} on no divert station is in reach, even fully charged"
            return Gated(names, used_soc=used_soc, why=why, p_below=1.0)
        soc, diverts = covered
        held, figures = (
            self._not_landed_at(step, at_s)
            or self._full(sure, reach, taken, at_s, max(soc, step.charge))
            or self._held(way, at_s, sure[-1])
        )
        hopeless = len(sure) < len(names) and self._hopeless(names, at_s, max(soc, step.charge))
        return Gated(names, soc, least, used_soc, diverts, held=held, figures=figures, hopeless=hopeless)

    @staticmethod
    def _mean_soc(reach: Reach, taken: _Taken) -> float:
        return reach.belief.mean_ratio * float(reach.expected(taken.cost[:, 0]))

    def _take_off_s(self, step: Step) -> float:
        """When it is charged as the step says, POSIX seconds."""
        p = self._problem
        charges = p.has_pads(p.origin) and step.charge > self._info.soc
        return self._info.time_s + (p.charge_time_s(p.origin, self._info.soc, step.charge) if charges else 0.0)

    def _hopeless(self, names: tuple[str, ...], at_s: float, soc: float) -> bool:
        """Whether a whole leg most probably breaks the reserve, also with `SOC_SD` more: the wind along it is taken otherwise than in the futures."""
        way, reach = self._way(names, at_s)
        return self._p_below_reserve(reach, way, at_s, soc + SOC_SD) > self._policy.parameters.p_hopeless

    def _p_below_reserve(self, reach: Reach, way: list[Place], at_s: float, soc: float) -> float:
        flown = reach.to_the_end(way, at_s, climbs=True)
        return float(reach.p_below(soc, flown.soc[:, None], self._reserve, flown.doubt[:, None])[0])

    def later(self, step: Step) -> Later:
        """Delay until a leg can start according to the forecast."""
        parameters, may_open = self._policy.parameters, False
        for wait_s in parameters.later_s:
            gated = self.check(step, self._info.time_s + wait_s)
            if gated.soc is not None:
                return Later(wait_s)
            may_open = may_open or gated.p_below <= parameters.p_hopeless
        return Later(None, may_open)

    def _keeps_reserve(self, reach: Reach, taken: _Taken) -> float | None:
        """Least charge that is enough; None: no charge is.

        It keeps the reserve but for epsilon, or, where the leg is watched, is turned with no greater probability than may be.
        """
        parameters = self._policy.parameters
        if self._info.watched:
            share = parameters.p_begin if self._info.measures_wind else self._epsilon
            return _least(reach, self._turned_below(taken, self._reserve), share)
        return _least(reach, (taken.cost, self._reserve, taken.doubt), self._epsilon)

    def _taken(self, reach: Reach, way: list[Place], at_s: float) -> _Taken:
        """What a leg takes."""
        flown = reach.to_the_end(way, at_s, climbs=True)
        time_s, cost, doubt = float(reach.expected(flown.time_s)), flown.soc[:, None], flown.doubt[:, None]
        if not self._info.watched:
            return _Taken(time_s, cost, doubt, np.zeros_like(doubt), 0.0)
        half_s = 0.5 * time_s
        by_then = self._reach.where_flown(way, at_s)
        rest = by_then.to_the_end(second_half(way), at_s + half_s).doubt
        half_soc = 0.5 * float(reach.expected(flown.soc))
        then = reach.belief.in_flight(half_soc * reach.belief.mean_ratio, half_soc)
        learnt = math.sqrt(max(reach.belief.sd_between**2 - then.sd_between**2, 0.0)) / reach.belief.mean_ratio
        return _Taken(time_s, cost, doubt, rest[:, None], math.hypot(half_soc * then.sd_between, SOC_SD), learnt)

    def _turned_below(self, taken: _Taken, reserve: float) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
        """For `Reach.p_below`: below which charge a leg is turned.

        It is turned where halfway, where that is done last, what is still unknown then breaks the reserve with more than epsilon: that must be
        left beside it, and what is known of the wind by then, the rest of the doubt now, is the doubt.
        Where the wind is not measured on the way, nothing more is known of it then: what is unknown now must break the reserve with epsilon
        at most, also where the first half teaches that the flight takes more energy, but for the share of flights that may be turned.
        """
        if not self._info.measures_wind:
            more = NormalDist().inv_cdf(1.0 - self._policy.parameters.p_begin) * taken.learnt
            return taken.cost * (1.0 + more), reserve, taken.doubt
        sigmas, ratio = self._sigmas, self._reach.belief.mean_ratio
        known = np.sqrt(np.maximum(taken.doubt**2 - taken.rest**2, 0.0))
        return taken.cost + sigmas * np.hypot(taken.rest, taken.energy_soc / ratio), reserve, known

    def _covered(
        self, reach: Reach, way: list[Place], at_s: float, least: float, end: str
    ) -> tuple[float, tuple[str, ...]] | float:
        """Least charge from one on with which every point has a divert station, and these; or where the first gap is, m."""
        parameters = self._policy.parameters
        reserve = self._policy.request.reserve_soc
        floor, kept = reserve * parameters.divert_share, reserve if self._info.watched else 0.0
        full = self._without_room(reach, way, at_s)
        flights = PointFlights(reach, way, at_s, end)

        def cover(soc: float) -> DivertCover:
            return flights.cover(soc, floor_soc=floor, epsilon=self._epsilon, full=full, reserve_soc=kept)

        found, low, soc = cover(least), least, least
        while found.gap_m is not None:
            if soc >= 1.0:
                return found.gap_m
            low, soc = soc, min(soc + parameters.more_soc, 1.0)
            found = cover(soc)
        while soc - low > FINE_SOC:
            middle = 0.5 * (low + soc)
            closer = cover(middle)
            if closer.gap_m is None:
                soc, found = middle, closer
            else:
                low = middle
        return soc, found.stations

    def _without_room(self, reach: Reach, way: list[Place], at_s: float) -> frozenset[str]:
        """Stations where a watched flight that is turned to them halfway may well find no place with half of its charge, by the drones there now."""
        info, scenario, most = self._info, self._policy.scenario, self._policy.parameters.p_no_room
        if not info.watched:
            return frozenset()
        lands_s = at_s + 0.5 * float(reach.expected(reach.to_the_end(way, at_s).time_s))
        hover_s = 0.5 * (1.0 - self._reserve) / reach.soc_per_s
        index, pads = scenario.network.index, scenario.network.pads
        present = {name: count for name, count in info.busy_pads.items() if pads[index[name]]}
        if info.station in present:
            present[info.station] += info.behind

        def chance(name: str) -> float:
            return no_place_probability(scenario, index[name], present[name], info.time_s, lands_s, hover_s)

        return frozenset(name for name in present if chance(name) > most)

    def _not_landed_at(self, step: Step, at_s: float) -> tuple[str, dict[str, Any]] | None:
        """Why the leg would end, at its fastest, while nobody lands there: before the earliest delivery, or at a station that is closed; else None."""
        p, segments = self._problem, step.segments[: step.sure or len(step.segments)]
        node = int(p.network.head[segments[-1]])
        barred, lands_s = p.no_landing(node), at_s + p.fastest_s(segments)
        opens_s = lands_s if barred is None else float(barred.put_off(np.array(lands_s), np.array(lands_s)))
        if opens_s <= lands_s + 1.0:
            return None
        opens = zone_clock(from_posix(opens_s), ZoneInfo(p.load.timezone))
        end = p.network.stations[node].id
        return f"landing at {end} is allowed only from {opens} on", {"opens_posix_s": opens_s}

    def _p_no_room(self, sure: tuple[str, ...], reach: Reach, taken: _Taken, at_s: float, soc: float) -> float:
        """Probability that a watched leg is turned halfway because it may well find no place at its end, by the drones there now."""
        scenario, end = self._policy.scenario, sure[-1]
        node = scenario.network.index[end]
        present = self._info.busy_pads.get(end) if scenario.network.pads[node] else None
        if present is None or not self._info.watched:
            return 0.0
        lands_soc = soc - self._mean_soc(reach, taken)
        hover_s = max(lands_soc - self._kept_at(end), 0.0) / reach.soc_per_s
        return turned_for_room_probability(
            scenario,
            node,
            present,
            self._info.time_s,
            at_s,
            at_s + taken.time_s,
            hover_s,
            self._policy.parameters.p_no_room,
        )

    def _full(
        self, sure: tuple[str, ...], reach: Reach, taken: _Taken, at_s: float, soc: float
    ) -> tuple[str, dict[str, Any]] | None:
        """Why a leg waits for room at its end; None where there most probably is some."""
        chance = self._p_no_room(sure, reach, taken, at_s, soc)
        if chance <= self._policy.parameters.p_begin:
            return None
        station = self._policy.scenario.network.stations[self._policy.scenario.network.index[sure[-1]]]
        others = counted(self._info.busy_pads[station.id], "other drone")
        reason = (
            f"too little free capacity at {station.id}: {others}, {counted(station.pads, 'pad')}, "
            f"{counted(station.holding_spots, 'holding spot')}; the flight would have to divert with probability {probability(chance)}"
        )
        return reason, {"p_no_room": chance}

    def _held(self, way: list[Place], at_s: float, end: str) -> tuple[str, dict[str, Any]]:
        """Why the wind most probably forbids to leave now."""
        places, reach = np.array(way), self._reach
        north, east = reach.winds(places[:, 0], places[:, 1], np.full(len(places), at_s))
        speed = np.hypot(north, east).max(axis=1)
        limit = reach.drone.wind_limit_mps
        p_over, mean = float(reach.wind.probability @ (speed > limit)), float(reach.wind.probability @ speed)
        if p_over <= self._policy.parameters.p_closed:
            return "", {}
        reason = (
            f"wind too strong on the way to {end}: {speed_text(mean)} expected, above the limit of {speed_text(limit)} with probability "
            f"{probability(p_over)}"
        )
        return reason, {"p_wind_over_limit": p_over, "wind_mps": mean}


def second_half(way: Sequence[Place]) -> list[Place]:
    """Return the points of a way from its middle on."""
    middle_m = 0.5 * sum(geodesy.distance_m(*a, *b) for a, b in pairwise(way))
    gone_m = 0.0
    for number, (a, b) in enumerate(pairwise(way)):
        gone_m += geodesy.distance_m(*a, *b)
        if gone_m > middle_m:
            return [along_way(way, middle_m), *way[number + 1 :]]
    return [way[-1], way[-1]]
