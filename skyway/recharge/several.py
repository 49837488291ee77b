"""One mission for several drones: its independent parts and the pads are shared among them.

Every drone gets a separate mission, with windows in which pads are its own: when it then replans in flight, alone, it cannot take a pad
from another one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.missions.files import plan_reader, plan_writer
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS
from skyway.missions.items.coordinates import Point
from skyway.missions.recharge.reordered import Turn
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.planner.fixed_route.order_bound import bound_of_orders
from skyway.planner.fixed_route.order_search import best_order
from skyway.planner.fixed_route.pad_shares import shares_of
from skyway.planner.fixed_route.pad_windows import ALWAYS
from skyway.planner.fixed_route.sharing import Stay, number_of, window_of, windows_left
from skyway.recharge.cutting import ROUNDED
from skyway.recharge.order.ordering import SAME_M, pictures_off_m, told
from skyway.recharge.order.tables import tables_of
from skyway.recharge.pad_slack import cut
from skyway.recharge.preparing import prepared
from skyway.recharge.problem import sure_ratio_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.mission import Mission, MissionItem
    from skyway.models.network.station import Station
    from skyway.planner.fixed_route.pad_windows import Window
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.order.tables import OrderTables
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeOptions

BESIDE_M = 5.0
"""Distance between drones at the start, to the east."""


@dataclass(frozen=True, eq=False, slots=True)
class Share:
    """Share of one drone."""

    units: int
    text: str
    """Its mission, as a file: complete, not cut yet."""
    windows: dict[str, tuple[Window, ...]]
    """By the id of a pad, the windows of this drone; seconds after the first take-off of all."""
    found: Recharged
    stays: tuple[Stay, ...]
    within: tuple[Window, ...]
    """The window that contains each stay."""
    ready: Prepared


@dataclass(frozen=True, eq=False, slots=True)
class SharedWork:
    """A mission shared among drones.

    Attributes
    ----------
    shares : tuple of Share
        Shares of the drones that fly.
    units : int
        Independent parts.
    bound_s : float
        No distribution and order ends before this.
    alone_s : float or None
        End with one drone alone; None if that is not possible.
    looked_at, planned : int
        Distributions that were bounded, and planned exactly.
    pictures_off_m : float
        The largest displacement of a picture.
    notes : tuple of str
        Further notes.
    """

    shares: tuple[Share, ...]
    units: int
    bound_s: float
    alone_s: float | None
    looked_at: int
    planned: int
    pictures_off_m: float
    notes: tuple[str, ...]

    @property
    def end_s(self) -> float:
        """End of the last drone by the plan."""
        return max(share.found.plan.end_s for share in self.shares)


def shared_among(
    document: MissionDocument,
    pads: Sequence[Station],
    families: Sequence[Family],
    options: RechargeOptions,
    drones: int,
    *,
    iterations: int | None = None,
) -> SharedWork:
    """Distribute a mission over drones that fly at once, so that the last one ends first.

    Without `options.reorder` each flies its parts in the order of the mission. An `InputError` gives the reason if it cannot be shared, or cut.
    """
    if options.packs is not None:
        raise InputError("is for one drone", field="--packs", remedy="remove it, or --drones")
    ready = prepared(document, pads, families, options)
    alone_s: float | None = None
    refusal: InputError | None = None
    try:
        alone_s = cut(ready, options).plan.end_s
    except InputError as error:
        refusal = error
    tables = tables_of(ready, options, ROUNDED * sure_ratio_of(options, ready.work(options)), drones=drones)
    tables = _shareable(tables, refusal)
    begin = _begun(tables, drones)
    best = best_order(
        tables.free, begin, keeps_order=not options.reorder, iterations=iterations, seed=options.seed
    )  # fmt: skip
    tours = [list(tour) for tour in best.tours if tour]
    missions = [_mission_of(ready, tables, tour, number) for number, tour in enumerate(tours)]
    readies = [prepared(one, pads, families, options) for one in missions]
    usable = readies[0].pads
    others = _held_of(usable, pads, options)
    own = _planned_together(readies, options, others)
    off_m = pictures_off_m(tables.writer.work, [one.problem.work for one, _ in own])
    if off_m > SAME_M:
        raise InputError(
            "pictures would be lost or taken twice: the parts found are not independent",
            field="--drones",
            remedy="fly it with one drone",
        )
    open_when = [options.windows.get(pad.id, (ALWAYS,)) for pad in usable]
    divided = shares_of(
        [pad.pads for pad in usable], [*(stays for _, stays in own), *([others] if others else [])], open_when
    )
    shares = []
    for number, one in enumerate(readies):
        windows = {
            pad.id: tuple(dict.fromkeys(window for window, _ in mine))
            for pad, mine in zip(usable, divided[number], strict=True)
        }
        found = cut(one, replace(options, reorder=False, windows=windows))
        stays = stays_of(found, divided[number])
        within = tuple(window_of(stay, divided[number][stay.pad]) for stay in stays)
        shares.append(
            Share(len(tours[number]), plan_writer.dumps(missions[number]), windows, found, stays, within, one)
        )
    work = SharedWork(
        tuple(shares),
        tables.free.units,
        0.0,
        alone_s,
        best.looked_at,
        best.planned,
        off_m,
        _notes(ready, tables, shares, drones),
    )
    return replace(work, bound_s=min(bound_of_orders(tables.free), work.end_s))


def in_windows(work: SharedWork, windows: Sequence[dict[str, tuple[Window, ...]]]) -> SharedWork:
    """Cut each drone's mission again, with its windows of pads."""
    shares = []
    for share, own in zip(work.shares, windows, strict=True):
        found = cut(share.ready, replace(share.found.problem.options, windows=own))
        shares.append(replace(share, windows=own, found=found))
    return replace(work, shares=tuple(shares))


def _shareable(tables: OrderTables | None, refusal: InputError | None) -> OrderTables:
    """Return the tables; an `InputError` if a mission has no parts that several drones may fly at once."""
    units = () if tables is None else tables.division.units
    if tables is not None and len(units) > 1 and all(unit.group == units[0].group for unit in units):
        return tables
    if refusal is not None and len(units) < 2:
        raise refusal
    why = told(tables) or ("no parts are certainly independent (lines of pictures, places with a picture or a stay)",)
    raise InputError(
        f"the mission cannot be shared among drones: {why[0].removeprefix('order kept: ')}",
        field="--drones",
        remedy="fly it with one drone, or divide it by hand",
    )


def _begun(tables: OrderTables, drones: int) -> list[list[int]]:
    """Return the units in the order of the mission, divided into runs of similar cost."""
    cost = tables.free.turn_cost_s[::2]
    tours: list[list[int]] = [[] for _ in range(drones)]
    done, whole = 0.0, max(float(cost.sum()), 1e-9)
    for unit, each in enumerate(cost.tolist()):
        tours[min(int(drones * (done + each / 2.0) / whole), drones - 1)].append(2 * unit)
        done += each
    return tours


def _mission_of(ready: Prepared, tables: OrderTables, tour: Sequence[int], number: int) -> MissionDocument:
    """Return the mission of one drone, read back from its written form, so that a reader of the file gets the same cuts."""
    turns = [Turn(turn // 2, turn % 2 == 1) for turn in tour]
    written = tables.writer.reordered(turns, events=number == 0)
    mission = _beside(written.mission, BESIDE_M * number)
    document = replace(ready.document, mission=mission)
    return plan_reader.loads(plan_writer.dumps(document))


def _beside(mission: Mission, east_m: float) -> Mission:
    """Let a drone begin and land beside the first one."""
    if east_m == 0.0:
        return mission

    def moved(item: MissionItem) -> MissionItem:
        if item.command not in TAKEOFF_COMMANDS | LAND_COMMANDS or item.point is None:
            return item
        at = _east(item.point, east_m)
        return replace(item, x=at.lat_e7, y=at.lon_e7)

    home = mission.home
    if home is not None:
        home = replace(home, point=_east(home.point, east_m))
    return replace(mission, items=tuple(moved(item) for item in mission.items), home=home)


def _east(point: Point, by_m: float) -> Point:
    return Point.of_degrees(*(float(one) for one in geodesy.direct(point.lat, point.lon, 90.0, by_m)))


def _planned_together(
    readies: Sequence[Prepared], options: RechargeOptions, others: list[Stay]
) -> list[tuple[Recharged, tuple[Stay, ...]]]:
    """Cut the missions one after the other, the longest first, each with the pads left free by the earlier ones."""
    found: dict[int, tuple[Recharged, tuple[Stay, ...]]] = {}
    lengths_m = [_length_m(one, options) for one in readies]
    for number in sorted(range(len(readies)), key=lambda one: -lengths_m[one]):
        taken = [stay for _, stays in found.values() for stay in stays] + others
        pads = readies[number].pads
        left = [_left(pad, place, taken, options) for place, pad in enumerate(pads)]
        windows = {pad.id: tuple(window for window, _ in free) for pad, free in zip(pads, left, strict=True)}
        made = cut(readies[number], replace(options, reorder=False, windows=windows))
        found[number] = made, stays_of(made, left)
    return [found[number] for number in range(len(readies))]


def _held_of(usable: Sequence[Station], pads: Sequence[Station], options: RechargeOptions) -> list[Stay]:
    """Return the stays of others on the pads on which landing is possible."""
    place_of = {pad.id: place for place, pad in enumerate(usable)}
    return [replace(one, pad=place_of[pads[one.pad].id]) for one in options.held if pads[one.pad].id in place_of]


def stays_of(found: Recharged, windows: Sequence[Sequence[tuple[Window, int]]]) -> tuple[Stay, ...]:
    """Return the stays of a drone on the numbered pads whose windows contain them."""
    stays = []
    for stop in found.plan.stops:
        stay = stop.arrive_s, stop.leave_s
        stays.append(Stay(stop.pad, number_of(stay, windows[stop.pad]), *stay))
    return tuple(stays)


def _length_m(ready: Prepared, options: RechargeOptions) -> float:
    return sum(geodesy.distance_m(*one, *other) for one, other in pairwise(ready.work(options).places))


def _left(pad: Station, place: int, taken: Sequence[Stay], options: RechargeOptions) -> list[tuple[Window, int]]:
    """Return when a pad is free, with the number of the free one."""
    here = [stay for stay in taken if stay.pad == place]
    return windows_left(pad.pads, here, options.windows.get(pad.id, (ALWAYS,)))


def _notes(ready: Prepared, tables: OrderTables, shares: Sequence[Share], drones: int) -> tuple[str, ...]:
    notes = [*ready.notes, *ready.left_out]
    if len(shares) < drones:
        notes.append(f"{len(shares)} of {drones} drones fly: more drones would not end earlier")
    if len(shares) > 1:
        notes.append(f"each drone stands {BESIDE_M:g} m east of the one before, and lands there")
        notes.append("start all drones together: their pad windows count from then")
    return (*notes, *told(tables), *dict.fromkeys(note for share in shares for note in share.found.notes))
