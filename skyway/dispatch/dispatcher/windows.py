"""Windows of pads: of flights under way, of routes, and of pads out of order; as holds, and made disjoint."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.units import from_posix
from skyway.models.ledger.ledger import Hold
from skyway.models.ledger.window import Window

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import PlanStep


def committed(situation: Situation, now_s: float) -> dict[str, list[Window]]:
    """Return the windows of flights that have begun, by the id of their booking."""
    found: dict[str, list[Window]] = {}
    for name, (_, flight) in situation.flights.items():
        windows = windows_of(situation.steps_of(flight), situation.late_s.get(name, 0.0), not_before_s=now_s)
        found.setdefault(itinerary_name(flight.order, flight.drone), []).extend(windows)
    return found


def wanted(situation: Situation, now_s: float) -> dict[str, list[Window]]:
    """Return the windows of flights that have begun, and those of all routes, by itinerary."""
    found = committed(situation, now_s)
    for name, (_, drone) in situation.drones.items():
        last = None
        for part in drone.route:
            last = part.order or last
            found.setdefault(itinerary_name(last, name), []).extend(windows_of(part.steps, not_before_s=now_s))
    return found


def idle_windows(situation: Situation, real: Mapping[str, Sequence[Window]], now_s: float) -> dict[str, Window]:
    """Return the windows of drones that charge without a task, by drone, without those whose pad a flight needs meanwhile."""
    taken = [one for windows in real.values() for one in windows]
    found = {}
    for name, (_, drone) in situation.drones.items():
        for window in windows_of((drone.idle,), not_before_s=now_s) if drone.idle is not None else ():
            if not any(window.touches(one) for one in taken):
                found[name] = window
    return found


def to_book(situation: Situation, now_s: float) -> dict[str, list[Window]]:
    """Return all windows to be booked, by itinerary: the wanted ones, and those of drones that charge without a task."""
    found = wanted(situation, now_s)
    idle = {f"idle {name}": [one] for name, one in idle_windows(situation, found, now_s).items()}
    return found | idle


def out_of_order(situation: Situation) -> list[Hold]:
    """Return the windows in which pads are out of order."""
    return [
        hold
        for name, (_, one) in situation.pads.items()
        for hold in as_holds(f"out of order {name}", [Window(station=one.station, pad=one.pad, start=from_posix(one.from_s), end=from_posix(one.until_s))], "out of order")
    ]  # fmt: skip


def itinerary_name(order: str | None, drone: str) -> str:
    """Return the name of the booking of a drone's windows for an order, or for its way home."""
    return order or f"home of {drone}"


def windows_of(steps: Sequence[PlanStep], late_s: float = 0.0, *, not_before_s: float = 0.0) -> list[Window]:
    """Return the windows of some steps that are not over, with their delay; a drone that charges twice in a row has one pad at a time."""
    found = []
    before: PlanStep | None = None
    for one in steps:
        last, before = before, one
        if one.kind != "charge" or one.pad is None or one.end_s + late_s <= not_before_s or one.end_s <= one.begin_s:
            continue
        begin_s = one.begin_s if one.begin_s <= not_before_s else one.begin_s + late_s
        if last is not None and last.kind == "charge" and last.origin == one.origin:
            begin_s = max(begin_s, last.end_s + late_s)
        found.append(
            Window(station=one.origin, pad=one.pad, start=from_posix(begin_s), end=from_posix(one.end_s + late_s))
        )
    return found


def as_holds(itinerary: str, windows: Sequence[Window], holder: str) -> list[Hold]:
    """Return windows as holds of the planner."""
    return [Hold(itinerary, 0, number, one, "firm", holder, 0) for number, one in enumerate(windows, 1)]


def apart(
    wanted: Mapping[str, Sequence[Window]], pads: Mapping[str, int], taken: Sequence[Window] = ()
) -> dict[str, list[Window]]:
    """Move windows that overlap on one pad to another pad of the station, or behind each other.

    A late flight may need a pad that is planned for another flight: the first to arrive has it, as on the ground.
    """
    placed: list[Window] = list(taken)
    found: dict[str, list[Window]] = {name: [] for name in wanted}
    flat = sorted(
        ((one.start, name, one) for name, windows in wanted.items() for one in windows),
        key=lambda one: (one[0], one[1]),
    )
    for _, name, window in flat:
        numbers = [
            window.pad,
            *(number for number in range(1, pads.get(window.station, window.pad) + 1) if number != window.pad),
        ]
        options = [replace(window, pad=number) for number in numbers]
        best = next((one for one in options if not any(one.touches(other) for other in placed)), None)
        if best is None:
            best = min((_behind(one, placed) for one in options), key=lambda one: one.start)
        placed.append(best)
        found[name].append(best)
    return found


def _behind(window: Window, placed: Sequence[Window]) -> Window:
    """Return a window delayed by those before it."""
    while True:
        met = [one.end for one in placed if window.touches(one)]
        if not met:
            return window
        begin = max(met)
        window = replace(window, start=begin, end=max(window.end, begin + (window.end - window.start)))
