"""What a leg needs before it is begun: charge that keeps the reserve, a divert station for every point of it, and wind that lets it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, percent, probability, speed_text, zone_clock
from skyway.models.base.units import from_posix
from skyway.planner.online.options import along_way
from skyway.planner.reach.diverts import divert_cover

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.planner.online.following import Step
    from skyway.planner.online.information import Information
    from skyway.planner.online.policy import OnlinePolicy
    from skyway.planner.problem.problem import Problem
    from skyway.planner.reach.reach import Place, Reach

STEPS = 1000
"""Into which the charge is divided."""


@dataclass(frozen=True, slots=True)
class Gated:
    """What the gate says of a leg."""

    names: tuple[str, ...]
    """Stations of the whole leg, from where it stands."""
    soc: float | None = None
    """Least charge; None where no charge does."""
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


class DepartureGate:
    """Checks legs before they are begun, from what is known on the ground."""

    def __init__(self, policy: OnlinePolicy, info: Information) -> None:
        self._policy, self._info = policy, info
        self._reserve = policy.request.reserve_soc
        """What the landing at the end of the leg that is checked keeps."""

    @cached_property
    def _reach(self) -> Reach:
        return self._policy.reach(
            self._info.near_forecast or self._info.forecast, self._info.belief.next_flight(), watched=self._info.watched,
            roughness=self._info.roughness,
        )  # fmt: skip

    def check(self, step: Step, p: Problem, time_s: float | None = None) -> Gated:
        """Check the leg of a step as far as it must be sure of it: to the first station where it can land if need be."""
        network, at_s = p.network, self._take_off_s(step, p) if time_s is None else time_s
        names = (
            network.stations[p.origin].id,
            *(network.stations[int(network.head[one])].id for one in step.segments),
        )
        sure = names[: 1 + (step.sure or len(step.segments))]
        way = self._reach.way(sure[0], sure[1:-1], sure[-1])
        reach = self._reach.where_flown(way, at_s)
        self._reserve = self._policy.request.reserve_soc + self._policy.way_on_soc(self._info, sure[-1])
        least = self._keeps_reserve(reach, way, at_s)
        if least is None:
            chance = self._p_below_reserve(reach, way, at_s, 1.0)
            on = " (the reserve, and the way on from there)" if self._reserve > self._policy.request.reserve_soc else ""
            why = f"even fully charged it lands below {percent(self._reserve)}{on} at {sure[-1]} with probability {probability(chance)}"
            return Gated(names, why=f"the leg to {sure[-1]} is not flown: {why}")
        covered = self._covered(
            reach, way, at_s, max(least, step.charge if step.turn_back is not None else 0.0), sure[-1]
        )
        if isinstance(covered, float):
            why = f"from {distance_text(covered)} on no divert station stays in reach, even fully charged"
            return Gated(names, why=f"the leg to {sure[-1]} is not flown: {why}")
        soc, diverts = covered
        held, figures = self._not_landed_at(p, step, at_s) or self._held(way, at_s, sure[-1])
        hopeless = len(sure) < len(names) and self._hopeless(names, at_s, max(soc, step.charge))
        return Gated(names, soc, diverts, held=held, figures=figures, hopeless=hopeless)

    def _take_off_s(self, step: Step, p: Problem) -> float:
        """When it is charged as the step says, POSIX seconds."""
        charges = p.has_pads(p.origin) and step.charge > self._info.soc
        return self._info.time_s + (p.charge_time_s(p.origin, self._info.soc, step.charge) if charges else 0.0)

    def _hopeless(self, names: tuple[str, ...], at_s: float, soc: float) -> bool:
        """Whether a whole leg most probably breaks the reserve."""
        way = self._reach.way(names[0], names[1:-1], names[-1])
        reach = self._reach.where_flown(way, at_s)
        return self._p_below_reserve(reach, way, at_s, soc) > self._policy.parameters.p_hopeless

    def _p_below_reserve(self, reach: Reach, way: list[Place], at_s: float, soc: float) -> float:
        flown = reach.to_the_end(way, at_s, climbs=True)
        return float(reach.p_below(soc, flown.soc[:, None], self._reserve, flown.doubt[:, None])[0])

    def later(self, step: Step, p: Problem) -> float | None:
        """How much later a leg can be begun by the forecast, s; None where never."""
        for wait_s in self._policy.parameters.later_s:
            gated = self.check(step, p, self._info.time_s + wait_s)
            if gated.soc is not None:
                return wait_s
        return None

    def _keeps_reserve(self, reach: Reach, way: list[Place], at_s: float) -> float | None:
        """Least charge that is enough; None: no charge is.

        It keeps the reserve but for epsilon. A watched leg is most probably not turned: halfway, where it is turned last, what is still unknown of
        the wind then must not break the reserve but for epsilon; what is known of it by then, the rest of the doubt now, may be worse.
        """
        parameters, reserve = self._policy.parameters, self._reserve
        share = parameters.p_begin if self._info.watched else parameters.epsilon
        flown = reach.to_the_end(way, at_s, climbs=True)
        cost, doubt = flown.soc[:, None], flown.doubt[:, None]
        if self._info.watched:
            flown_s = 0.5 * float(reach.expected(flown.time_s))
            rest = reach.to_the_end(second_half(way), at_s + flown_s).doubt[:, None]
            cost = cost + NormalDist().inv_cdf(1.0 - parameters.epsilon) * rest
            doubt = np.sqrt(np.maximum(doubt**2 - rest**2, 0.0))
        low, high = 0, STEPS + 1
        while low < high:  # least charge that does
            middle = (low + high) // 2
            if float(reach.p_below(middle / STEPS, cost, reserve, doubt)[0]) <= share:
                high = middle
            else:
                low = middle + 1
        return low / STEPS if low <= STEPS else None

    def _covered(
        self, reach: Reach, way: list[Place], at_s: float, least: float, end: str
    ) -> tuple[float, tuple[str, ...]] | float:
        """Least charge from one on with which every point has a divert station, and these; or where the first gap is, m."""
        parameters = self._policy.parameters
        soc, gap_m = least, math.nan
        reserve = self._policy.request.reserve_soc
        floor, kept = reserve * parameters.divert_share, reserve if self._info.watched else 0.0
        while soc <= 1.0 + 1e-9:
            cover = divert_cover(
                reach, way, at_s, soc, floor_soc=floor, epsilon=parameters.epsilon, destination=end,
                not_at=self._info.unusable, reserve_soc=kept,
            )  # fmt: skip
            if cover.gap_m is None:
                return min(soc, 1.0), cover.stations
            gap_m = cover.gap_m
            soc = soc + parameters.more_soc if soc + parameters.more_soc < 1.0 or soc >= 1.0 else 1.0
        return gap_m

    def _not_landed_at(self, p: Problem, step: Step, at_s: float) -> tuple[str, dict[str, Any]] | None:
        """Why the leg would end, at its fastest, while nobody lands there: before the earliest delivery, or at a station that is closed; else None."""
        segments = step.segments[: step.sure or len(step.segments)]
        node = int(p.network.head[segments[-1]])
        barred, lands_s = p.no_landing(node), at_s + p.fastest_s(segments)
        opens_s = lands_s if barred is None else float(barred.put_off(np.array(lands_s), np.array(lands_s)))
        if opens_s <= lands_s + 1.0:
            return None
        opens = zone_clock(from_posix(opens_s), ZoneInfo(p.load.timezone))
        end = p.network.stations[node].id
        return f"wait: nobody is to land at {end} before {opens}", {"opens_posix_s": opens_s}

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
            f"wait for the wind: {speed_text(mean)} expected on the way to {end}, above {speed_text(limit)} with probability "
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
