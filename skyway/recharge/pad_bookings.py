"""Pads in a ledger (`models.ledger`): bookings of others are respected, and the stays of a cut mission are booked.

The bookings are the windows of the set: a drone that replans in flight stays within them, regardless of later bookings.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from itertools import groupby
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.units import parse_instant
from skyway.models.ledger.ledger import TakenError
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window as Booking
from skyway.planner.fixed_route.pad_windows import ALWAYS
from skyway.planner.fixed_route.sharing import Stay, number_of, window_of, windows_left
from skyway.recharge.recharged import recharged
from skyway.recharge.several import in_windows

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.models.ledger.ledger import Ledger
    from skyway.models.network.station import Station
    from skyway.planner.fixed_route.pad_windows import Window
    from skyway.recharge.asking import Asked
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.problem import RechargeOptions
    from skyway.recharge.several import SharedWork

EARLIER_S, LATER_S = 600.0, 1800.0
"""A pad is also booked this long before and after a planned stay, if it is free."""
OWNER_S = 60.0
MAX_TEXT = 150


@dataclass(frozen=True, eq=False, slots=True)
class PadBookings:
    """The pads of a mission in a ledger, for one holder, from a first take-off on."""

    ledger: Ledger
    holder: str
    depart: datetime

    def held(self, pads: Sequence[Station]) -> tuple[Stay, ...]:
        """Return the bookings of others by pad; seconds after the first take-off, pads by their place in `pads`."""
        place_of = {pad.id: place for place, pad in enumerate(pads)}
        return tuple(
            Stay(place_of[one.window.station], one.window.pad - 1, self._seconds(one.window.opens), self._seconds(one.window.closes))
            for one in self.ledger.holds(begin=self.depart)
            if one.holder != self.holder and one.window.station in place_of
        )  # fmt: skip

    @contextmanager
    def booked(
        self, pads: Sequence[Station], drones: Sequence[Sequence[tuple[Stay, Window]]]
    ) -> Iterator[list[dict[str, tuple[Window, ...]]]]:
        """Book a pad for each stay of each drone, around it as far as its window extends; yield the windows of each drone.

        If the enclosed code fails, they are released. Raises an `InputError` if another holder has booked one meanwhile.
        """
        found: list[dict[str, tuple[Window, ...]]] = []
        lease = self.ledger.acquire(self.holder, "skyway recharge", ttl_s=OWNER_S)
        names = []
        try:
            for number, stays in enumerate(drones, start=1):
                windows = _joined(stays)
                if windows:
                    name = f"{self.holder}, drone {number}"
                    self.ledger.book(lease, name, [self._booking(pads, *one) for one in windows])
                    names.append(name)
                found.append(
                    {pad.id: tuple(one for place, _, one in windows if place == here) for here, pad in enumerate(pads)}
                )
            yield found
        except BaseException as error:
            for name in names:
                self.ledger.mark(lease, name, "released")
            if isinstance(error, TakenError):
                raise InputError(
                    f"a pad was booked by others meanwhile: {error}", field="--ledger", remedy="try again"
                ) from error
            raise
        finally:
            self.ledger.give_back(lease)

    @contextmanager
    def cut_for_one(
        self, document: MissionDocument, pads: Sequence[Station], families: Sequence[Family], options: RechargeOptions
    ) -> Iterator[Recharged]:
        """Cut a mission with the pads left free by others, and book the required ones; see `booked`."""
        free = free_windows(pads, options.held, options.windows)
        left = {pad.id: tuple(one for one, _ in own) for pad, own in zip(pads, free, strict=True)}
        found = recharged(document, pads, families, replace(options, windows=left))
        with self.booked(pads, [stays_within(found, pads, free)]) as (windows,):
            yield recharged(document, pads, families, replace(options, windows=windows))

    @contextmanager
    def cut_for_several(self, work: SharedWork) -> Iterator[SharedWork]:
        """Book the pads for the drones of a shared mission, and cut each drone's mission within the bookings; see `booked`."""
        stays = [list(zip(share.stays, share.within, strict=True)) for share in work.shares]
        with self.booked(work.shares[0].ready.pads, stays) as windows:
            yield in_windows(work, windows)

    def _seconds(self, instant: datetime) -> float:
        return (instant - self.depart).total_seconds()

    def _booking(self, pads: Sequence[Station], place: int, number: int, window: Window) -> Booking:
        start, end = (self.depart + timedelta(seconds=one) for one in window)
        return Booking(station=pads[place].id, pad=number + 1, start=start, end=end)


@contextmanager
def desk_of(ledger: str, folder: Path, depart: str | None) -> Iterator[PadBookings]:
    """Open a ledger for the folder of a set: cutting again replaces its earlier bookings."""
    if depart is None:
        raise InputError(
            "needs --depart", field="--ledger", remedy="say when the first take-off is, with its UTC offset"
        )
    start = parse_instant(depart, field="--depart")
    with open_ledger(ledger) as opened:
        yield PadBookings(opened, f"recharge {folder.resolve()}"[-MAX_TEXT:], start)


def _joined(stays: Sequence[tuple[Stay, Window]]) -> list[tuple[int, int, Window]]:
    """Return the windows around stays, adjacent ones on one pad as one: place, number, window."""
    around = sorted(
        (stay.pad, stay.number, max(stay.from_s - EARLIER_S, first), min(stay.until_s + LATER_S, last))
        for stay, (first, last) in stays
    )
    found: list[tuple[int, int, Window]] = []
    for (place, number), every in groupby(around, key=lambda one: one[:2]):
        begin, end = None, 0.0
        for _, _, first, last in every:
            if begin is not None and first > end:
                found.append((place, number, (begin, end)))
                begin = None
            begin, end = (first, last) if begin is None else (begin, max(end, last))
        if begin is not None:
            found.append((place, number, (begin, end)))
    return found


def free_windows(
    pads: Sequence[Station], held: Sequence[Stay], within: Mapping[str, tuple[Window, ...]]
) -> list[list[tuple[Window, int]]]:
    """Return for each pad the windows left free by others, each with the number of the pad."""
    return [
        windows_left(pad.pads, [one for one in held if one.pad == place], within.get(pad.id, (ALWAYS,)))
        for place, pad in enumerate(pads)
    ]


def stays_within(
    found: Recharged, pads: Sequence[Station], free: Sequence[Sequence[tuple[Window, int]]]
) -> list[tuple[Stay, Window]]:
    """Return the stays of a cut mission on numbered pads, each with its window; pads by their place in `pads`."""
    place_of = {pad.id: place for place, pad in enumerate(pads)}
    stays = []
    for stop in found.plan.stops:
        place = place_of[found.problem.ways.pads[stop.pad].id]
        number = number_of((stop.arrive_s, stop.leave_s), free[place])
        stay = Stay(place, number, stop.arrive_s, stop.leave_s)
        stays.append((stay, window_of(stay, free[place])))
    return stays


def with_windows(asked: Asked, found: Recharged) -> Asked:
    """Return the options of a set that is cut again in its own windows."""
    windows = found.problem.options.windows
    return replace(asked, windows={pad: [list(window) for window in own] for pad, own in windows.items()})
