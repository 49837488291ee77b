"""Drones without a task charge on free pads of the station where they stand; they leave for a flight, for a booked window, and for any drone that waits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from skyway.dispatch.dispatcher.windows import idle_windows, out_of_order, wanted, windows_of
from skyway.dispatch.records import STANDING, PlanStep
from skyway.models.base.errors import SkywayError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from skyway.dispatch.dispatcher.bookings import Bookings
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import DroneRecord
    from skyway.models.ledger.window import Window
    from skyway.models.queues.pad_service import DroneOnPad, PadService, StationStatus

LOW_SOC, CHARGED_SOC = 0.7, 0.8
"""State of charge below which a drone begins, and at which it ends: above, charging is slow, and a full battery ages faster."""
STEP_SOC = 0.02
"""Change of the charge that is recorded while a drone charges."""
UNKNOWN_S = 7200.0
"""Time since its charge was measured after which a standing drone is taken for one that needs a pad, s."""
WINDOW_S = 900.0
"""Length of the booked window, s; it is extended while nobody else needs the pad, so other operators wait no longer than this."""
LOOK_S = 60.0
"""Interval of the requests to the pads, s."""
AGAIN_S = 900.0
"""Time after which a drone that has left its pad for others may charge again, s."""


class IdleCharging:
    """Charges drones that have no task.

    Parameters
    ----------
    situation : Situation
        The state, changed here.
    bookings : Bookings
        Bookings of pads.
    pads : mapping
        Number of pads of each station.
    service : PadService or None
        The pads; without them no drone charges.
    say : callable
        Displays a line.
    """

    def __init__(
        self, situation: Situation, bookings: Bookings, pads: Mapping[str, int], service: PadService | None, say: Callable[[str], None]
    ) -> None:  # fmt: skip
        self._situation, self._bookings, self._pads, self._service, self._say = situation, bookings, pads, service, say
        self._looked_s = -math.inf
        self._left_s: dict[str, float] = {}

    def give_way(self, now_s: float) -> None:
        """Take drones off their pads that have a flight to begin, or whose pad is booked."""
        charging = self._charging()
        if not charging:
            return
        kept = idle_windows(self._situation, wanted(self._situation, now_s), now_s)
        for name, drone in charging.items():
            due = bool(drone.route) and drone.route[0].begin_s <= now_s
            if due or name not in kept:
                self._take_off_pad(name, drone, now_s)

    def charge(self, now_s: float) -> None:
        """Continue and begin charges, once a minute."""
        if self._service is None or now_s < self._looked_s + LOOK_S:
            return
        self._looked_s = now_s
        here: dict[str, list[str]] = {}
        for name, (_, drone) in self._situation.drones.items():
            if drone.idle is not None or self._needs_charge(name, now_s):
                here.setdefault(drone.place, []).append(name)
        if not here:
            return
        taken = self._taken(now_s)
        for station, names in here.items():
            try:
                status = self._service.status(station)
                self._continue(names, status, taken, now_s)
                if not status.waiting:
                    self._begin(self._service, station, names, status.pads - status.busy, taken, now_s)
            except SkywayError as error:
                self._say(f"no drone without a task charges at {station}: {error}")

    def end(self, now_s: float) -> None:
        """End all charges, at the end of the service."""
        for name, drone in self._charging().items():
            self._take_off_pad(name, drone, now_s)

    def _charging(self) -> dict[str, DroneRecord]:
        return {name: one for name, (_, one) in self._situation.drones.items() if one.idle is not None}

    def _needs_charge(self, name: str, now_s: float) -> bool:
        state, drone = self._situation.drones[name]
        idle = state == STANDING and drone.flight is None and drone.aboard is None and drone.idle is None
        idle = idle and self._pads.get(drone.place, 0) > 0
        soon = bool(drone.route) and drone.route[0].begin_s <= now_s + WINDOW_S
        low = drone.soc < LOW_SOC or now_s > drone.measured_s + UNKNOWN_S
        return idle and low and not soon and now_s >= self._left_s.get(name, -math.inf) + AGAIN_S

    def _taken(self, now_s: float) -> list[Window]:
        """Return the windows on which no drone without a task charges: of all flights, of others, and of pads out of order."""
        real = [one for windows in wanted(self._situation, now_s).values() for one in windows]
        others = [one.window for one in self._bookings.of_others(now_s)]
        return [*real, *others, *(one.window for one in out_of_order(self._situation))]

    def _continue(self, names: Sequence[str], status: StationStatus, taken: list[Window], now_s: float) -> None:
        """Continue the charges at a station, or end them; those that wait get the pads of the drones with the most charge."""
        drones = self._situation.drones
        charging = {name: drones[name][1] for name in names if drones[name][1].idle is not None}
        on_pad = {one.drone: one for one in status.drones}
        for name, drone in charging.items():
            self._measure(name, drone, on_pad.get(str(drone.system)), now_s)
        leaving = sorted(charging, key=lambda name: -charging[name].soc)[: status.waiting]
        for name, drone in charging.items():
            window = self._window(drone, taken, now_s)
            entry = on_pad.get(str(drone.system))
            if name in leaving or window is None or entry is None or entry.state != "charging":
                self._measure(name, drone, entry, now_s, always=True)
                self._take_off_pad(name, drone, now_s)
            else:
                self._put(name, drone, window, taken)

    def _begin(
        self, service: PadService, station: str, names: Sequence[str], free: int, taken: list[Window], now_s: float
    ) -> None:
        """Begin charges at a station, on so many free pads, the emptiest drone first."""
        standing = {name: self._situation.drones[name][1] for name in names if self._needs_charge(name, now_s)}
        for name in sorted(standing, key=lambda name: standing[name].soc)[: max(free, 0)]:
            drone = standing[name]
            window = self._window(drone, taken, now_s)
            if window is None:
                return
            self._measure(name, drone, service.charge(station, str(drone.system), CHARGED_SOC), now_s, always=True)
            self._put(name, drone, window, taken)

    def _window(self, drone: DroneRecord, taken: Sequence[Window], now_s: float) -> PlanStep | None:
        """Return a window of a drone on a pad that nobody else needs until its end, on the same pad if possible; None if all are needed."""
        before = drone.idle
        options = [
            PlanStep(
                kind="charge", origin=drone.place, destination=drone.place, begin_s=now_s, end_s=now_s + WINDOW_S,
                soc_begin=drone.soc, soc_end=CHARGED_SOC, pad=pad,
            )
            for pad in range(1, self._pads[drone.place] + 1)
        ]  # fmt: skip
        if before is not None and before.end_s > now_s + WINDOW_S / 2:
            options.insert(0, before)
        elif before is not None:
            options.insert(0, msgspec.structs.replace(before, end_s=now_s + WINDOW_S))
        free = (one for one in options if not any(own.touches(other) for own in windows_of((one,)) for other in taken))
        return next(free, None)

    def _measure(
        self, name: str, drone: DroneRecord, entry: DroneOnPad | None, now_s: float, *, always: bool = False
    ) -> None:
        """Take the charge that the pad measures, in steps: each change of a record stays in its history."""
        if entry is not None and entry.soc is not None and (always or abs(entry.soc - drone.soc) >= STEP_SOC):
            drone.soc, drone.measured_s = min(max(entry.soc, 0.0), 1.0), now_s
            self._change(name, drone)

    def _put(self, name: str, drone: DroneRecord, window: PlanStep, taken: list[Window]) -> None:
        """Take a window for a drone."""
        drone.idle = window
        taken += windows_of((window,))
        self._change(name, drone)

    def _change(self, name: str, drone: DroneRecord) -> None:
        self._situation.change_drone(name, self._situation.drones[name][0], drone)

    def _take_off_pad(self, name: str, drone: DroneRecord, now_s: float) -> None:
        """Release the pad; if the pads do not answer, the drone stays there, and begins no flight."""
        if self._service is None or drone.idle is None:
            return
        try:
            self._service.release(drone.place, str(drone.system))
        except SkywayError as error:
            self._say(f"{name} does not leave its pad at {drone.place}: {error}")
            return
        drone.idle = None
        self._left_s[name] = now_s
        self._change(name, drone)
