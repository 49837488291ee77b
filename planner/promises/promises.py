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
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.request import DEFAULT_EPSILON, DEFAULT_RESERVE_SOC
from skyway.planner.promises.flown_kernels import BELOW_SOC, Steps, World, flown
from skyway.planner.promises.worlds import checked_ratio, members_of, others_of, power_shares, ratios_of, winds_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.dispatch.result import DispatchPlan, Route
    from skyway.planner.parameters.planner import PlannerParameters

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
) -> DispatchPlan:  # fmt: skip
    """Return a plan whose orders have their `Outlook`, and which says how many landings are below the reserve.

    It is flown in so many worlds as the setting `worlds` says; with 0 it is returned as it is. `by` has when orders are promised, their due times by default.
    With `windows` no charge begins before it was planned to, as where pads are booked.
    """
    if not parameters.dispatch.worlds or not plan.served:
        return plan
    done = fly_plan(work, plan.routes, plan.depart, forecast, parameters, reserve=reserve, seed=seed, holds=holds, seen=seen, windows=windows)  # fmt: skip
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
) -> Flown:  # fmt: skip
    """Fly the routes of a plan in many worlds: the same ones for the same seed, whatever the routes are."""
    laid = lay_out_problem(work, depart, forecast, parameters, reserve=reserve, margins=False)
    pads = np.array([work.scenario.network.stations[node].pads for node in laid.places], dtype=np.int64)
    flights = laid.problem.flights._replace(pads=pads, first_pad=np.cumsum(pads) - pads)
    weigh = parameters.dispatch
    winds = winds_of(work, laid, depart, forecast, parameters, weigh.members)
    streams = [np.random.default_rng((seed, stream)) for stream in range(3)]
    member = members_of(winds.probability, weigh.worlds, streams[0])
    steps = steps_of(work, laid, routes, windows=windows, margin=weigh.margin)
    owner = np.repeat(np.arange(len(steps.soc)), np.diff(steps.first))
    ratio = ratios_of(work, owner, weigh.worlds, streams[1])
    others = others_of(work, laid, depart, weigh.worlds, streams[2], seen=seen, holds=holds)
    delivered_s = np.full((weigh.worlds, len(work.orders)), np.inf)
    lowest = np.full((weigh.worlds, len(steps.kind)), np.nan)
    for number in range(weigh.worlds):
        wind = winds.time_s[member[number]], winds.need[member[number]]
        world = World(*wind, ratio[number], others.come_s, others.lasts_s, others.begin[number])
        flown(flights, steps, world, delivered_s[number], lowest[number])
    landed = np.isfinite(lowest)
    return Flown(delivered_s, int(landed.sum()), int((lowest[landed] < reserve - BELOW_SOC).sum()))


def steps_of(work: Work, laid: Laid, routes: Sequence[Route], *, windows: bool = False, margin: float = USUAL.dispatch.margin, epsilon: float = DEFAULT_EPSILON) -> Steps:  # fmt: skip
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
            if one.kind == "charge" and windows:
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
        checked=np.array([checked_ratio(USUAL_ERRORS.energy_of(work.scenario.drone(one.type)), margin, epsilon) for one in work.vehicles]),
    )  # fmt: skip
