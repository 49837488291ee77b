"""The order of a mission's independent parts, chosen so that the whole ends first: `--reorder`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.recharge.reordered import Turn
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.planner.fixed_route.order_bound import bound_of_orders
from skyway.planner.fixed_route.order_search import ITERATIONS, best_order
from skyway.recharge.cutting import ROUNDED, cut
from skyway.recharge.order_tables import tables_of
from skyway.recharge.problem import sure_ratio_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.recharge.work import Picture
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.order_tables import OrderTables
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeOptions

SAME_M = 0.1
"""A picture is where it was within this."""
MOST_TOLD = 3


@dataclass(frozen=True, slots=True)
class OrderTold:
    """What is told of an order.

    Attributes
    ----------
    units : int
        Parts of the mission that stay as they are.
    moved : int
        How many of them are not where they were, or are flown from their end.
    before_s : float or None
        When the mission ends in its own order; None where that cannot be flown.
    bound_s : float
        No order ends before.
    looked_at, planned : int
        Orders that were bounded, and planned exactly.
    kept : tuple of str
        Why the order is not freer.
    """

    units: int
    moved: int
    before_s: float | None
    bound_s: float
    looked_at: int
    planned: int
    kept: tuple[str, ...]


def with_best_order(
    ready: Prepared, options: RechargeOptions, *, iterations: int = ITERATIONS
) -> tuple[Recharged, OrderTold]:
    """Cut a mission whose independent parts may be put in another order, and flown from their ends; the better of that and its own order.

    An `InputError` says that nothing may be moved, or why neither can be cut.
    """
    tables = independent(ready, options)
    own: Recharged | None = None
    refusal: InputError | None = None
    try:
        own = cut(ready, options)
    except InputError as error:
        refusal = error
    free = tables.free
    begin = [2 * number for number in range(free.units)]
    best = best_order(free, [begin], iterations=iterations, seed=options.seed)
    kept = list(told(tables))
    found, tour = own, begin
    if list(best.tours[0]) != begin:
        try:
            other = cut(in_order(ready, tables, best.tours[0]), options)
        except InputError as error:
            if own is None:
                raise
            kept.append(f"the best order is not flown: {error.faults[0].problem}")
        else:
            if not same_pictures(tables.writer.work.pictures, other.problem.work.pictures):
                kept.append("order kept: pictures would not be where they were")
            elif own is None or other.plan.end_s < own.plan.end_s:
                found, tour = other, list(best.tours[0])
    if found is None:
        raise refusal or InputError("no order of the mission can be flown")
    moved = sum(one != other for one, other in zip(tour, begin, strict=True))
    bound = min(bound_of_orders(tables.free), found.plan.end_s)
    before_s = None if own is None else own.plan.end_s
    return found, OrderTold(free.units, moved, before_s, bound, best.looked_at, best.planned, tuple(kept))


def independent(ready: Prepared, options: RechargeOptions, *, drones: int = 1) -> OrderTables:
    """Return the units of a mission; an `InputError` says that there are none, or that none may be moved."""
    tables = tables_of(ready, options, ROUNDED * sure_ratio_of(options), drones=drones)
    field = "--reorder" if drones == 1 else "--drones"
    if tables is None:
        raise InputError(
            "no parts of the mission are surely independent: none is a line of pictures, or a place with a picture or a stay",
            field=field,
            remedy=f"leave {field} out",
        )
    if not tables.division.is_free or (drones > 1 and tables.free.units < 2):
        why = tables.division.kept[0] if tables.division.kept else "it has one part only"
        raise InputError(f"no parts of the mission are surely independent: {why}", field=field, remedy=f"leave {field} out")
    return tables


def in_order(ready: Prepared, tables: OrderTables, tour: Sequence[int]) -> Prepared:
    """Return the mission with its units in an order."""
    written = tables.writer.reordered([Turn(turn // 2, turn % 2 == 1) for turn in tour])
    return replace(ready, document=replace(ready.document, mission=written.mission))


def told(tables: OrderTables) -> tuple[str, ...]:
    """Return why the order is not freer, in a few lines."""
    kept = tables.division.kept
    more = (f"order kept: {len(kept) - MOST_TOLD} more reasons of these kinds",) if len(kept) > MOST_TOLD else ()
    return (*kept[:MOST_TOLD], *more)


def same_pictures(before: Sequence[Picture], after: Sequence[Picture]) -> bool:
    """Whether as many pictures are taken, each within `SAME_M` of one that was, whatever their order."""
    if len(before) != len(after):
        return False
    if not before:
        return True
    from scipy.spatial import KDTree

    places = [np.array([(one.lat, one.lon) for one in pictures]) for pictures in (before, after)]
    lat0, lon0 = places[0].mean(axis=0)
    planes = [np.column_stack(geodesy.local_offsets_m(one[:, 0], one[:, 1], lat0, lon0)) for one in places]
    return all(
        float(np.max(KDTree(one).query(other)[0])) <= SAME_M for one, other in (planes, planes[::-1])
    )
