"""The previous plan as input of the search: routes, stops, pads and steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.dispatch.flight_kernels import CHARGE, FLY
from skyway.planner.dispatch.improve import Before
from skyway.planner.dispatch.result import PHASES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.orders.fitting import Work
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.dispatch.result import Step


def before(
    work: Work, laid: Laid, kept: Mapping[str, Sequence[Step]], promised: Mapping[str, datetime]
) -> Before | None:
    """Return the previous plan by numbers of drones, orders and places; None if there is none."""
    if not kept and not promised:
        return None
    order = {one.id: number for number, one in enumerate(work.orders)}
    place = {work.scenario.network.stations[node].id: number for number, node in enumerate(laid.places)}
    routes: dict[int, list[int]] = {}
    halts: dict[tuple[int, int], tuple[int, float]] = {}
    rows: dict[int, NDArray[np.float64]] = {}
    for number, drone in enumerate(work.vehicles):
        steps = kept.get(drone.id, ())
        routes[number] = list(
            dict.fromkeys(order[one.order] for one in steps if one.order in order and one.phase != "home")
        )
        last: str | None = None
        for one in steps:
            here, last = place.get(one.origin, -1), one.order or last
            if one.kind == "charge" and last in order and here >= 0 and laid.problem.flights.pads[here]:
                halts[order[last], PHASES.index(one.phase)] = here, one.soc_end
        if (
            all(one.order is None or one.order in order for one in steps)
            and {one.origin for one in steps} | {one.destination for one in steps} <= place.keys()
        ):
            rows[number] = np.array([_row(one, order, place, laid) for one in steps]).reshape(-1, 10)
    return Before(routes, halts, {order[one]: at.timestamp() for one, at in promised.items() if one in order}, rows)


def _row(one: Step, order: Mapping[str, int], place: Mapping[str, int], laid: Laid) -> tuple[float, ...]:
    """Return a step as a row of a trace."""
    here, flights = place[one.origin], laid.problem.flights
    pad = -1 if one.pad is None or one.pad > flights.pads[here] else int(flights.first_pad[here]) + one.pad - 1
    return (
        FLY if one.kind == "fly" else CHARGE,
        -1 if one.order is None else order[one.order],
        PHASES.index(one.phase),
        here,
        place[one.destination],
        one.begin.timestamp(),
        one.end.timestamp(),
        one.soc_begin,
        one.soc_end,
        pad,
    )
