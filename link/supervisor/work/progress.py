"""Progress of the work: completed parts, the present flight, and the pad where the next one begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from skyway.link.supervisor.work.task import WorkFlight
    from skyway.missions.items.mission import MissionItem
    from skyway.missions.recharge.spans import Done, Span


@dataclass(slots=True)
class WorkProgress:
    """The progress of one work; written only by its own methods."""

    begin: tuple[int, int] | None = None
    """Point that is done, and the pad of the drone; None: nothing is done yet."""
    flight: WorkFlight | None = None
    """Flight uploaded, or under way."""
    done: Done | None = None
    """Progress of the work in this flight."""
    finished: bool = False
    turned_back: int = 0
    """Successive flights that came back without progress."""
    intended: Span | None = None
    """Flight to which the mission is being changed."""

    def take(self, flight: WorkFlight | None) -> None:
        """Set the next, or present, flight."""
        self.flight = flight

    def intend(self, span: Span | None) -> None:
        """Set the flight to which the mission is about to be changed; None: no longer any."""
        self.intended = span

    def turn_back(self) -> None:
        """Record that a flight turns back to a pad."""
        self.turned_back += 1

    def begin_flight(self) -> None:
        """Reset the progress of an earlier flight."""
        self.done = None

    def advance(self, done: Done | None) -> None:
        """Record the progress of the work; it never decreases."""
        if done is not None and (self.done is None or done > self.done):
            self.done = done

    def stand(self, point: int, pad: int) -> None:
        """Record a landing on a pad, with the work done up to a point."""
        if self.begin is not None and point > self.begin[0]:
            self.turned_back = 0
        self.begin, self.flight, self.done, self.intended = (point, pad), None, None, None

    def back_at_start(self) -> None:
        """Record a landing at the start of the mission, with nothing done."""
        self.begin, self.flight, self.done, self.intended = None, None, None, None

    def finish(self) -> None:
        """Record that all is done."""
        self.finished, self.flight = True, None


def reached(flight: WorkFlight, item: int, place: tuple[float, float]) -> Done | None:
    """Return the progress of the work at a place on the way to an item; None before its first place."""
    reaches = flight.reaches
    before = next(
        (number for number in range(min(item, len(reaches)) - 1, -1, -1) if reaches[number] is not None), None
    )
    if before is None:
        return None
    last = reaches[before]
    following = reaches[item] if item < len(reaches) else None
    if last is None or following is None or following <= last:
        return last
    items = flight.mission.document.mission.items
    share = _share_flown(items[before], items[item], place)
    begin = last[1] if last[0] == following[0] else 0.0
    if last[0] + 1 < following[0]:
        return last  # between two places that are not neighbours the progress is unknown
    return following[0], min(begin + share * (following[1] - begin), following[1])


def _share_flown(start: MissionItem, end: MissionItem, place: tuple[float, float]) -> float:
    """Share of the way between two items that is flown at a place beside it."""
    if start.point is None or end.point is None:
        return 0.0
    north, east = geodesy.local_offsets_m(
        [end.point.lat, place[0]], [end.point.lon, place[1]], start.point.lat, start.point.lon
    )
    square = float(north[0] ** 2 + east[0] ** 2)
    return min(max(float(north[1] * north[0] + east[1] * east[0]) / square, 0.0), 1.0) if square > 1.0 else 0.0
