"""What each order of a plan is promised: when it is expected to be there, and with which probability by when it is due."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import from_posix
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.planner.dispatch.flight_kernels import CHARGE, FLY
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.dispatch.result import Outlook
from skyway.planner.problem.request import DEFAULT_RESERVE_SOC
from skyway.planner.promises.flown_kernels import BELOW_SOC, Steps, World, flown
from skyway.planner.promises.worlds import (
    asked_of,
    checks_of,
    landings_of,
    members_of,
    others_of,
    power_shares,
    ratios_of,
    times_of,
    winds_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.dispatch.result import DispatchPlan, Route
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.promises.flown_kernels import Checked
    from skyway.planner.promises.worlds import Winds

EARLY_S = 1.0
"""A charge may begin so much before its window."""


@dataclass(frozen=True)
class Flown:
    """A plan as it was flown in all worlds."""

    delivered_s: NDArray[np.float64]
    """Shape (worlds, orders): POSIX seconds; infinite where an order was not delivered."""
    landings: int
    below: int
    """Landings, and those below the reserve."""


def promised(
    work: Work, plan: DispatchPlan, forecast: WindEnsemble, parameters: PlannerParameters, *, reserve: float = DEFAULT_RESERVE_SOC,
    seed: int = 0, holds: Sequence[Hold] = (), seen: PadsSeen = NOTHING_SEEN, by: Mapping[str, datetime] | None = None, windows: bool = False,
    margin_of: Mapping[str, DepartureMargin] | None = None, in_air_s: Mapping[str, float] | None = None,
) -> DispatchPlan:  # fmt: skip
    """Return a plan whose orders have their `Outlook`, and which says how many landings are below the reserve.

    It is flown in so many worlds as the setting `worlds` says; with 0 it is returned as it is. `by` has when orders are promised, their due times by default.
    With `windows` no charge, and no part of a route, begins before it was planned to, as where pads are booked and
    workers are given each part when it is due. `margin_of` has what the check before a take-off wants of each type of drone, the usual margin by default;
    `in_air_s` has the drones that are in the air until they are available, and for how long: that time is not certain.
    """
    if not parameters.dispatch.worlds or not plan.served:
        return plan
    done = fly_plan(work, plan.routes, plan.depart, forecast, parameters, reserve=reserve, seed=seed, holds=holds, seen=seen, windows=windows, margin_of=margin_of, in_air_s=in_air_s)  # fmt: skip
    number = {one.id: place for place, one in enumerate(work.orders)}
    due = {one.id: one.due for one in work.orders} | dict(by or {})
    answers = [
        replace(one, outlook=outlook(done.delivered_s[:, number[one.order]], due[one.order].timestamp()))
        if one.status == "served"
        else one
        for one in plan.answers
    ]
    return replace(plan, answers=tuple(answers), below_reserve=done.below / max(done.landings, 1))


def outlook(delivered_s: NDArray[np.float64], by_s: float) -> Outlook:
    """Return what is to be expected of an order from when it was delivered in each world; a quantile is that of the worlds, the next above."""
    early, late = np.quantile(delivered_s, (0.5, 0.95), method="inverted_cdf")
    chance = float((delivered_s <= by_s + 1e-6).mean())
    return Outlook(
        by=from_posix(by_s), chance=chance,
        p50=from_posix(float(early)) if math.isfinite(early) else None, p95=from_posix(float(late)) if math.isfinite(late) else None,
    )  # fmt: skip


def fly_plan(
    work: Work, routes: Sequence[Route], depart: datetime, forecast: WindEnsemble, parameters: PlannerParameters, *,
    reserve: float = DEFAULT_RESERVE_SOC, seed: int = 0, holds: Sequence[Hold] = (), seen: PadsSeen = NOTHING_SEEN, windows: bool = False,
    margin_of: Mapping[str, DepartureMargin] | None = None, in_air_s: Mapping[str, float] | None = None,
) -> Flown:  # fmt: skip
    """Fly the routes of a plan in many worlds: the same ones for the same seed, whatever the routes are."""
    laid = lay_out_problem(work, depart, forecast, parameters, reserve=reserve, margins=False)
    pads = np.array([work.scenario.network.stations[node].pads for node in laid.places], dtype=np.int64)
    flights = laid.problem.flights._replace(pads=pads, first_pad=np.cumsum(pads) - pads)
    weigh = parameters.dispatch
    winds = winds_of(work, laid, depart, forecast, parameters, weigh.members)
    streams = [np.random.default_rng((seed, stream)) for stream in range(6)]
    member = members_of(winds.probability, weigh.worlds, streams[0])
    steps = steps_of(work, laid, routes, winds, windows=windows, checked=checks_of(work, weigh.margin, margin_of))
    owner = np.repeat(np.arange(len(steps.soc)), np.diff(steps.first))
    ratio = ratios_of(work, owner, weigh.worlds, streams[1])
    times = times_of(owner, weigh.worlds, streams[3], parameters)
    later_s = landings_of(work, in_air_s or {}, weigh.worlds, streams[5], parameters)
    asked = asked_of(work, owner, weigh.worlds, streams[4], margin_of)
    others = others_of(work, laid, depart, weigh.worlds, streams[2], seen=seen, holds=holds)
    delivered_s = np.full((weigh.worlds, len(work.orders)), np.inf)
    lowest = np.full((weigh.worlds, len(steps.kind)), np.nan)
    for number in range(weigh.worlds):
        at = member[number]
        world = World(
            winds.time_s[at], winds.need[at], ratio[number], times.pace[number], times.more_s[number], times.charging[number], asked[number],
            others.come_s, others.lasts_s, others.begin[number],
        )  # fmt: skip
        flown(
            flights, steps._replace(from_s=steps.from_s + later_s[number]), world, delivered_s[number], lowest[number]
        )
    landed = np.isfinite(lowest)
    return Flown(delivered_s, int(landed.sum()), int((lowest[landed] < reserve - BELOW_SOC).sum()))


def steps_of(work: Work, laid: Laid, routes: Sequence[Route], winds: Winds, *, checked: Checked, windows: bool = False) -> Steps:  # fmt: skip
    """Lay the routes of a plan out as arrays; drones without one have no steps."""
    network = work.scenario.network
    place = {network.stations[node].id: number for number, node in enumerate(laid.places)}
    order = {one.id: number for number, one in enumerate(work.orders)}
    fleet, modes = laid.problem.fleet, laid.problem.orders.mode
    of = {route.drone: route for route in routes}
    rows: list[tuple[int, int, int, int, float, int, float, float]] = []
    shares = power_shares(work, laid)
    first = [0]
    for number, vehicle in enumerate(work.vehicles):
        steps = of[vehicle.id].steps if vehicle.id in of else ()
        begun: set[str] = set()
        last = {
            one.order: at for at, one in enumerate(steps) if one.order is not None and one.phase == "with the package"
        }
        for at, one in enumerate(steps):
            not_before_s, delivers, mode, share = -math.inf, -1, int(fleet.empty_mode[number]), 1.0
            if one.order is not None and one.phase == "with the package":
                mode, share = (
                    int(modes[fleet.type[number], order[one.order]]),
                    shares[fleet.type[number], order[one.order]],
                )
                if one.order not in begun:
                    begun.add(one.order)
                    not_before_s = float(laid.problem.orders.ready_s[order[one.order]])
                if last[one.order] == at:
                    delivers = order[one.order]
            before = steps[at - 1] if at else None
            begins = before is None or (before.kind == "fly" and (before.order, before.phase) != (one.order, one.phase))
            if windows and (one.kind == "charge" or begins):
                not_before_s = max(not_before_s, one.begin.timestamp() - EARLY_S)
            kind_of = FLY if one.kind == "fly" else CHARGE
            rows.append(
                (kind_of, place[one.origin], place[one.destination], mode, one.soc_end, delivers, not_before_s, share)
            )
        first.append(len(rows))
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    kind, place_of, to, mode, delivers = table[:, [0, 1, 2, 3, 5]].astype(np.int64).T.copy()
    return Steps(
        first=np.array(first), kind=kind, place=place_of, to=to, mode=mode,
        up_to=table[:, 4].copy(), not_before_s=table[:, 6].copy(), delivers=delivers, mass=table[:, 7].copy(), soc=fleet.soc, from_s=fleet.from_s, type=fleet.type, scale=fleet.scale,
        checked=checked, far_m=winds.far_m[place_of, to], fixed_s=winds.fixed_s,
    )  # fmt: skip
