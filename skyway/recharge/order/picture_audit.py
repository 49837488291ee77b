"""Comparison of pictures before and after: those of the written missions with those of the original mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.missions.autopilots.registry import family_named
from skyway.missions.recharge.work import work_of
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text

if TYPE_CHECKING:
    from skyway.recharge.cutting import Recharged

MOST_OFF_M = 1.0
"""Largest displacement of a picture in a set that is written."""


@dataclass(frozen=True, slots=True)
class PictureAudit:
    """Number of pictures, and the largest displacement of one."""

    before: int
    after: int
    """Maximum over all autopilots."""
    off_m: float
    """Infinite if their numbers differ."""


def audited(found: Recharged) -> PictureAudit:
    """Read every written flight, one after the other, and compare the places of pictures."""
    before = found.problem.work.pictures
    moved_m = 0.0 if found.order is None else found.order.pictures_off_m
    worst = PictureAudit(len(before), len(before), moved_m)
    for name, flights in found.flights.items():
        after: list[tuple[float, float]] = []
        for flight in flights:
            last = after[-1] if after else None
            work = work_of(flight.document.mission, family_named(name), last_picture=last)
            after += [(one.lat, one.lon) for one in work.pictures]
        if len(after) != len(before):
            return PictureAudit(len(before), len(after), float("inf"))
        apart = [geodesy.distance_m(one.lat, one.lon, *other) for one, other in zip(before, after, strict=True)]
        worst = max(
            (worst, PictureAudit(len(before), len(after), moved_m + max(apart, default=0.0))), key=lambda one: one.off_m
        )
    return worst


def kept_pictures(found: Recharged) -> PictureAudit:
    """Return the audit; an `InputError` refuses flights that would lose a picture, take one twice, or displace one."""
    audit = audited(found)
    if audit.off_m <= MOST_OFF_M:
        return audit
    told = f"the mission takes {audit.before} pictures, and these flights would take {audit.after}"
    if audit.before == audit.after:
        told = f"a picture would be {distance_text(audit.off_m)} from where it was"
    raise InputError(told, field="mission", remedy="cut it by hand, and send us the mission")
