"""The order of a mission's independent parts that ends first: `--reorder`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.missions.recharge.reordered import Turn
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.planner.fixed_route.order_bound import bound_of_orders
from skyway.planner.fixed_route.order_search import best_order
from skyway.recharge.cutting import ROUNDED
from skyway.recharge.order.tables import tables_of
from skyway.recharge.pad_slack import cut
from skyway.recharge.problem import sure_ratio_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.recharge.work import Work
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.order.tables import OrderTables
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeOptions

SAME_M = 0.1
"""Tolerance for the place of a picture."""
MOST_TOLD = 3
NOTHING_FREE = (
    "order kept: no parts of the mission are certainly independent (lines of pictures, places with a picture or a stay)"
)


@dataclass(frozen=True, slots=True)
class OrderTold:
    """Report on an order.

    Attributes
    ----------
    units : int
        Parts of the mission that stay unchanged.
    moved : int
        Number of them that are in another place, or are flown from their end.
    end_s : float
        When the mission ends by the plan.
    before_s : float or None
        End of the mission in its original order; None if that cannot be flown.
    bound_s : float
        No order ends before this.
    looked_at, planned : int
        Orders that were bounded, and planned exactly.
    pictures_off_m : float
        The largest displacement of a picture by the order alone.
    """

    units: int
    moved: int
    end_s: float
    before_s: float | None
    bound_s: float
    looked_at: int
    planned: int
    pictures_off_m: float = 0.0


def with_best_order(ready: Prepared, options: RechargeOptions, *, iterations: int | None = None) -> Recharged:
    """Cut a mission whose independent parts may be reordered, and flown from their ends; the better of the result and the original order.

    If nothing may be moved the order is kept, and a note gives the reason. An `InputError` gives the reasons if neither can be cut.
    """
    own: Recharged | None = None
    refusal: InputError | None = None
    try:
        own = cut(ready, options)
    except InputError as error:
        refusal = error
    tables = None
    if own or _may_help(refusal):
        work = ready.work(options) if own is None else own.problem.work
        tables = tables_of(ready, options, ROUNDED * sure_ratio_of(options, work))
    if tables is None or not tables.division.is_free:
        if own is None:
            raise refusal or InputError("the mission cannot be cut")
        end_s = own.plan.end_s
        parts = 0 if tables is None else tables.free.units
        why = told(tables) or (NOTHING_FREE,)
        return replace(own, notes=(*own.notes, *why), order=OrderTold(parts, 0, end_s, end_s, end_s, 0, 0))
    begin = [2 * number for number in range(tables.free.units)]
    best = best_order(tables.free, [begin], iterations=iterations, seed=options.seed)
    tour = list(best.tours[0])
    found, off_m, notes = _better(ready, options, tables, tour, own)
    if found is None:
        raise refusal or InputError("no order of the mission can be flown")
    if found is own:
        tour = begin
    order = OrderTold(
        tables.free.units,
        sum(one != other for one, other in zip(tour, begin, strict=True)),
        found.plan.end_s,
        None if own is None else own.plan.end_s,
        min(bound_of_orders(tables.free), found.plan.end_s),
        best.looked_at,
        best.planned,
        off_m,
    )
    return replace(found, notes=(*found.notes, *told(tables), *notes), order=order)


def _may_help(refusal: InputError | None) -> bool:
    """Whether another order may be possible if the original one is not: the way to a pad may be shorter."""
    return refusal is not None and any("no pad in reach" in fault.problem for fault in refusal.faults)


def _better(
    ready: Prepared, options: RechargeOptions, tables: OrderTables, tour: Sequence[int], own: Recharged | None
) -> tuple[Recharged | None, float, tuple[str, ...]]:
    """Cut the mission in an order; return that or its original, the displacement of pictures, and the obstacle."""
    if list(tour) == [2 * number for number in range(tables.free.units)]:
        return own, 0.0, ()
    try:
        other = cut(in_order(ready, tables, tour), options)
    except InputError as error:
        return own, 0.0, (f"order kept: the best order found is not used: {error.faults[0].problem}",)
    off_m = pictures_off_m(tables.writer.work, [other.problem.work])
    if off_m > SAME_M:
        return own, 0.0, ("order kept: pictures would move",)
    if own is not None and own.plan.end_s <= other.plan.end_s:
        return own, 0.0, ()
    return other, off_m, ()


def in_order(ready: Prepared, tables: OrderTables, tour: Sequence[int]) -> Prepared:
    """Return the mission with its units in an order."""
    written = tables.writer.reordered([Turn(turn // 2, turn % 2 == 1) for turn in tour])
    return replace(ready, document=replace(ready.document, mission=written.mission))


def told(tables: OrderTables | None) -> tuple[str, ...]:
    """Return the reasons why the order is not freer, in a few lines."""
    kept = () if tables is None else tables.division.kept
    more = (f"order kept: {len(kept) - MOST_TOLD} more reasons of these kinds",) if len(kept) > MOST_TOLD else ()
    return (*kept[:MOST_TOLD], *more)


def pictures_off_m(before: Work, after: Sequence[Work]) -> float:
    """Return the largest distance of a picture from its original place, in any order; infinite if one is lost, or taken twice."""
    if len(before.pictures) != sum(len(work.pictures) for work in after):
        return math.inf
    if not before.pictures:
        return 0.0
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching
    from scipy.spatial import KDTree

    spots = [
        np.array([(one.lat, one.lon, work.height_m(one.step, one.share)) for work in works for one in work.pictures])
        for works in ([before], after)
    ]
    lat0, lon0 = spots[0][:, :2].mean(axis=0)
    planes = [np.column_stack((*geodesy.local_offsets_m(one[:, 0], one[:, 1], lat0, lon0), one[:, 2])) for one in spots]
    near = KDTree(planes[0]).query_ball_tree(KDTree(planes[1]), SAME_M)
    columns = np.array([other for others in near for other in others], dtype=np.int64)
    begins = np.cumsum([0, *(len(others) for others in near)])
    table: Any = csr_array((np.ones(len(columns)), columns, begins), shape=(len(near), len(near)))
    partner = maximum_bipartite_matching(table, perm_type="column")
    if (partner < 0).any():
        return math.inf
    return float(np.max(np.linalg.norm(planes[0] - planes[1][partner], axis=1)))
