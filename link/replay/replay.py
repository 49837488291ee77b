"""Replay of a recorded flight: filter and monitors run over the log as if live.

A log is read piece by piece and each piece is forgotten when it has been seen, so that a log of any size needs the same memory.
What the monitors see at a time is what came before it. Only the drag may be known beforehand: given, or identified
in a first pass over the log, which is said.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.common.log import MAX_EVENTS, LogEvent
from skyway.link.replay.flight_monitor import FlightMonitor, WindTally, pieces
from skyway.link.replay.monitors import PERIOD_S, Leg, Notice, PhaseEnergy
from skyway.link.replay.vehicle import VehicleView, no_wind, vehicle_of
from skyway.models.base.errors import Fault, InputError
from skyway.models.calibration.airspeed import identify_airspeed
from skyway.models.calibration.wind import identify_drag
from skyway.models.wind.estimation.blocks import BlockMaker, Blocks
from skyway.models.wind.estimation.live import NOMINAL_DRAG, LiveWind
from skyway.models.wind.estimation.measurement import PLAIN_SENSOR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.link.logs.common.log import Log, LogSummary
    from skyway.link.logs.common.vehicle_kind import Kind, Vehicle
    from skyway.link.replay.flight_monitor import Listener
    from skyway.link.replay.known_wind import KnownWind
    from skyway.models.drones.airspeed import AirspeedModel
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.power import Phase
    from skyway.models.drones.telemetry import TelemetryTrack
    from skyway.models.wind.estimation.drag_monitor import DragCheck
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.models.wind.estimation.filter import FilteredWind, WindFilterSettings
    from skyway.models.wind.estimation.live import Forecast

MAX_BLOCKS = 7_200
"""The drag is looked for in so many seconds at the end of the log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """Replay of one vehicle of a log."""

    summary: LogSummary
    system: int | None
    """Whose; None where no vehicle gave telemetry."""
    vehicle: Vehicle
    seconds: TelemetryTrack
    """One row a second, fewer of a very long log."""
    wind: FilteredWind
    """The filter's course where something was measured and the filter is consistent, thinned likewise."""
    tally: WindTally
    """Sums over the whole course."""
    known: KnownWind
    """For how much of the flight the wind was known, and the last that was."""
    measured: dict[str, int]
    """Measurements of each kind."""
    rejected: int
    """Those that the gate did not let pass."""
    forecast: bool
    """Whether a wind was expected."""
    drag: DragModel | None
    """In use; None where tilt tells nothing."""
    drag_source: str
    """``given``, ``identified`` (from the whole log, so not as live), ``nominal`` or ``none``."""
    drag_reason: str
    """What this flight tells about it; empty where it was given."""
    drag_check: DragCheck
    """Whether the drag in use fits, by the last minutes."""
    airspeed: AirspeedModel
    """Of the sensor of a plane."""
    airspeed_source: str
    """``given``, ``identified`` (from the whole log) or ``plain`` (as the sensor says)."""
    observations: tuple[WindObservation, ...]
    """Averages over slots, for `models.wind.estimation.forecast_update`."""
    legs: tuple[Leg, ...]
    phases: dict[Phase, PhaseEnergy]
    soc: tuple[float, float]
    """First and last known state of charge."""
    events: tuple[LogEvent, ...]
    """Of this vehicle and of the monitors."""


def choose_system(summary: LogSummary, system: int | None) -> int | None:
    """Return the vehicle to replay: the requested one, else the first that sent telemetry.

    Raises an `InputError` if it gave no telemetry in this log.
    """
    if system is None:
        return summary.systems[0] if summary.systems else None
    if system not in summary.systems:
        known = ", ".join(str(number) for number in summary.systems) or "none"
        raise InputError(
            Fault("gave no telemetry in this log", field="--system", value=system, remedy=f"these did: {known}")
        )
    return system


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Part of a log to replay, and data known beforehand."""

    system: int | None = None
    """Vehicle; by default the first."""
    vehicle: Kind | None = None
    """What it is, where the log does not say it."""
    from_s: float = -math.inf
    to_s: float = math.inf
    """`from_s`, `to_s`: part of the log, in its own time."""
    drag: DragModel | None = None
    """Of this drone; by default identified from the flight, or else a nominal one."""
    airspeed: AirspeedModel | None = None
    """Of its sensor; by default identified from a flight on wings, or else as the sensor says."""
    forecast: Forecast | None = None
    """As `models.wind.estimation.live.LiveWind` takes it; by default nothing is expected."""
    settings: WindFilterSettings | None = None


def replay(
    log: Log,
    options: ReplayOptions | None = None,
    *,
    notice: Callable[[Notice], None] | None = None,
    wait_until: Callable[[float], None] | None = None,
    listener: Listener | None = None,
) -> Replay:
    """Replay a log as if it were live.

    `notice` is called with the monitors' findings, second by second, and the vehicle's messages.
    `wait_until` is called before each second of the log is looked at, with the time of its last sample: it keeps pace
    with a clock. The listener gets every second of telemetry with the wind estimated then.
    """
    asked = options or ReplayOptions()
    system = choose_system(log.summary, asked.system)
    vehicle = vehicle_of(log.summary, system, asked.vehicle, drag=asked.drag is not None)
    air = _find_air(log, system, asked, vehicle)
    wind = LiveWind(drag=air.drag, airspeed=air.airspeed, forecast=asked.forecast, settings=asked.settings)
    monitor = FlightMonitor(wind, listener)
    told = _Told(log.summary, system, asked, notice)
    for track in _tracks(log, system, vehicle, asked.from_s, asked.to_s):
        steps = pieces(track, PERIOD_S) if notice is not None or wait_until is not None else iter((track,))
        for step in steps:
            if wait_until is not None:
                wait_until(float(step.time_s[-1]))
            told.add(monitor.feed(step))
    told.add(monitor.close())
    told.until(math.inf)
    told.add(_last_words(monitor, air))
    return Replay(
        summary=log.summary,
        system=system,
        vehicle=vehicle,
        seconds=monitor.seconds(),
        wind=monitor.course(),
        tally=monitor.tally,
        known=monitor.known(),
        measured=dict(monitor.wind.measured),
        rejected=monitor.wind.rejected,
        forecast=asked.forecast is not None,
        drag=air.drag,
        drag_source=air.drag_source,
        drag_reason=air.reason,
        drag_check=monitor.wind.check_drag(),
        airspeed=air.airspeed,
        airspeed_source=air.airspeed_source,
        observations=monitor.wind.observations(),
        legs=tuple(monitor.legs.legs),
        phases=monitor.legs.phases(),
        soc=(monitor.battery.first, monitor.battery.last),
        events=told.events(),
    )


def flight_blocks(
    log: Log,
    system: int | None,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    *,
    vehicle: Vehicle | None = None,
) -> Blocks:
    """Return the averages that a drag is found in: those of the last `MAX_BLOCKS` seconds of telemetry.

    What the kind of vehicle cannot tell, and what the vehicle did not trust, is unknown in them.
    """
    maker, parts, count = BlockMaker(PERIOD_S), [Blocks.joined(())], 0
    for track in _tracks(log, system, vehicle or log.summary.vehicle(system), from_s, to_s):
        parts.append(maker.feed(track))
        count += len(parts[-1])
        if count > 2 * MAX_BLOCKS:
            parts, count = [Blocks.joined(parts).part(slice(-MAX_BLOCKS, None))], MAX_BLOCKS
    return Blocks.joined([*parts, maker.flush()]).part(slice(-MAX_BLOCKS, None))


def _tracks(log: Log, system: int | None, vehicle: Vehicle, from_s: float, to_s: float) -> Iterator[TelemetryTrack]:
    view = VehicleView(vehicle, log.summary.doubted.get(system or 0, ()))
    for track in log.tracks(from_s, to_s):
        if track.system == system and len(track):
            yield view.see(track)


@dataclass(frozen=True, slots=True)
class _Air:
    """How the drone feels the air, and where that is known from."""

    drag: DragModel | None
    drag_source: str
    airspeed: AirspeedModel
    airspeed_source: str
    reason: str = ""


def _find_air(log: Log, system: int | None, asked: ReplayOptions, vehicle: Vehicle) -> _Air:
    """Take what was given, and look for the rest in the whole log."""
    plain = PLAIN_SENSOR
    nothing = no_wind(vehicle)
    if nothing:
        return _Air(None, "none", plain, "plain", nothing)
    if asked.drag is not None or asked.airspeed is not None:
        given = "given" if asked.airspeed is not None else "plain"
        return _Air(asked.drag, "given" if asked.drag is not None else "none", asked.airspeed or plain, given)
    air = flight_blocks(log, system, asked.from_s, asked.to_s, vehicle=vehicle)
    if not air.flying.any():
        return _Air(None, "none", plain, "plain", "the vehicle does not fly")
    sensor = identify_airspeed(air) if air.winged[air.flying].any() else None
    found, source = (plain, "plain") if sensor is None or sensor.model is None else (sensor.model, "identified")
    if sensor is not None and not np.isfinite(air.airspeed_mps[air.flying & air.winged]).any():
        reason = f"a {vehicle.kind} ({vehicle.told_by}) without a trusted airspeed sensor: in forward flight its wind is unknown"
        if vehicle.kind == "fixed wing":
            return _Air(None, "none", plain, "plain", reason)
    rotors = air.part(~air.winged)
    if not np.isfinite(rotors.drag[rotors.flying]).any():
        airspeed = "" if sensor is None else f"airspeed: {sensor.reason}"
        return _Air(None, "none", found, source, airspeed or "no lean of a multirotor is known")
    fit = identify_drag(rotors, PERIOD_S)
    if fit.drag is not None:
        return _Air(fit.drag, "identified", found, source, fit.reason)
    return _Air(NOMINAL_DRAG, "nominal", found, source, fit.reason)


class _Told:
    """Merges the vehicle's texts and the monitors' notices in order of time."""

    def __init__(
        self, summary: LogSummary, system: int | None, asked: ReplayOptions, notice: Callable[[Notice], None] | None
    ) -> None:
        self._system = system or 0
        self._notice = notice
        self._events: list[LogEvent] = []
        self._said = [
            event
            for event in summary.events
            if event.system == self._system and asked.from_s <= event.time_s < asked.to_s
        ]
        self._next = 0

    def until(self, time_s: float) -> None:
        """Pass on what the vehicle said before this time."""
        while self._next < len(self._said) and self._said[self._next].time_s < time_s:
            event = self._said[self._next]
            self._next += 1
            self._events.append(event)
            if self._notice is not None:
                self._notice(Notice(event.time_s, "mission", event.text))

    def add(self, notices: list[Notice]) -> None:
        """Pass on the monitors' findings, and before each the vehicle's messages up to then."""
        for one in notices:
            self.until(one.time_s)
            if one.event and len(self._events) < MAX_EVENTS:
                text = one.text if one.kind == "mission" else f"monitor: {one.text}"
                self._events.append(LogEvent(one.time_s, self._system, text))
            if self._notice is not None:
                self._notice(one)

    def events(self) -> tuple[LogEvent, ...]:
        return tuple(sorted(self._events, key=lambda event: event.time_s))


def _last_words(monitor: FlightMonitor, air: _Air) -> list[Notice]:
    """Return what is only known at the end."""
    if math.isnan(monitor.end_s):
        return []
    texts = []
    if air.drag_source == "nominal":
        texts.append(f"a nominal drag is used; {air.reason}")
    if not monitor.tally.count and not monitor.tally.doubted and monitor.legs.legs:
        why = f": {air.reason}" if air.drag_source == "none" and air.reason else ""
        texts.append(f"no wind could be measured in this flight{why}")
    if monitor.tally.doubted:
        texts.append(f"the wind is unknown for {monitor.tally.doubted} s in which the filter is inconsistent")
    if monitor.wind.rejected:
        total = sum(monitor.wind.measured.values())
        texts.append(f"{monitor.wind.rejected} of {total} wind measurements were rejected by the gate")
    return [Notice(monitor.end_s, "wind", text) for text in texts]
