"""A recorded flight, gone through as if it were live: filter and monitors over the log, and what they found.

A log is read once, piece by piece, and reduced to one row a second on the way, so that a day of telemetry fits into a few
megabytes whatever its rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.calibration_energy import VERTICAL_MPS
from models.calibration_wind import DragFit, identify_drag
from models.drag import DragModel
from models.drag_monitor import DragCheck, check_drag
from models.energy import PHASES, Phase
from models.errors import Fault, InputError
from models.telemetry import COLUMN, TelemetryTrack
from models.wind_filter import FilteredWind, WindFilterSettings, chi2_band, filter_log
from models.wind_filter_blocks import BlockMaker, Blocks, is_flying
from models.wind_filter_measurement import Measurements, measurements, tilt_air_velocity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from link.logs.log import Log, LogEvent, LogSummary

PERIOD_S = 1.0
NOMINAL = DragModel(relative_sigma=0.35)
"""Where no drag is known: that of a common quadcopter, uncertain by a third."""
NO_FORECAST = WindFilterSettings(tau_s=1800.0, sigma_mps=5.0)
"""How the wind is taken where nothing is forecast: anything up to a gale, slowly changing."""
LEG_GAP_S = 5.0
MIN_LEG_S = 10.0
DRAG_WINDOW_S = 300


@dataclass(frozen=True, slots=True)
class Leg:
    """One flight, from leaving the ground to landing.

    Attributes
    ----------
    start_s, end_s : float
        Times as in the log.
    distance_m : float
        Flown over the ground.
    from_lat, from_lon, to_lat, to_lon : float
        NaN where not known.
    soc_start, soc_end : float
        State of charge, 0 to 1.
    energy_j : float
        Taken from the battery; NaN where power is not known.
    """

    start_s: float
    end_s: float
    distance_m: float
    from_lat: float
    from_lon: float
    to_lat: float
    to_lon: float
    soc_start: float
    soc_end: float
    energy_j: float


@dataclass(frozen=True, slots=True)
class PhaseEnergy:
    """Time and energy of one phase of flight."""

    time_s: float
    energy_j: float


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """What a log says about one vehicle.

    Attributes
    ----------
    summary : LogSummary
        The whole log.
    system : int or None
        Whose; None where no vehicle gave telemetry.
    seconds : TelemetryTrack
        One row a second.
    wind : FilteredWind
        The filter's course.
    measured : Measurements
        What it was fed.
    forecast : ndarray, shape (2,), or None
        (north, east) that it was told to expect.
    drag : DragModel or None
        In use; None where tilt tells nothing.
    drag_source : str
        ``given``, ``identified``, ``nominal`` or ``none``.
    drag_fit : DragFit
        What this flight tells about it.
    drag_check : DragCheck
        Whether the drag in use fits, by the last minutes.
    legs : tuple of Leg
    phases : dict of Phase to PhaseEnergy
    events : tuple of LogEvent
        Of this vehicle and of the monitors.
    """

    summary: LogSummary
    system: int | None
    seconds: TelemetryTrack
    wind: FilteredWind
    measured: Measurements
    forecast: NDArray[np.float64] | None
    drag: DragModel | None
    drag_source: str
    drag_fit: DragFit
    drag_check: DragCheck
    legs: tuple[Leg, ...]
    phases: dict[Phase, PhaseEnergy]
    events: tuple[LogEvent, ...]


def choose_system(summary: LogSummary, system: int | None) -> int | None:
    """Return the vehicle to look at: the one asked for, else the first that gave telemetry.

    Raises
    ------
    InputError
        It gave no telemetry in this log.
    """
    if system is None:
        return summary.systems[0] if summary.systems else None
    if system not in summary.systems:
        known = ", ".join(str(number) for number in summary.systems) or "none"
        raise InputError(
            Fault("gave no telemetry in this log", field="--system", value=system, remedy=f"these did: {known}")
        )
    return system


def replay(
    log: Log,
    *,
    system: int | None = None,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    drag: DragModel | None = None,
    forecast: tuple[float, float] | None = None,
) -> Replay:
    """Go through a log as if it were live.

    Parameters
    ----------
    log : Log
        From `link.logs.reader.open_log`.
    system : int, optional
        Vehicle; by default the first.
    from_s, to_s : float
        Part of the log, in its own time.
    drag : DragModel, optional
        Of this drone; by default identified from the flight, or else a nominal one.
    forecast : (float, float), optional
        (north, east) TOWARDS, m/s; by default nothing is expected.
    """
    chosen = choose_system(log.summary, system)
    seconds, air = reduce_log(log, chosen, from_s, to_s)
    fit = identify_drag(air, PERIOD_S)
    used, source = (drag, "given") if drag is not None else (fit.drag, "identified")
    if used is None:
        wings = air.flying.any() and bool(air.winged[air.flying].mean() > 0.5)
        used, source = (None, "none") if wings or not air.flying.any() else (NOMINAL, "nominal")
    measured = measurements(air, used)
    settings = NO_FORECAST if forecast is None else WindFilterSettings()
    expected = np.zeros(2) if forecast is None else np.array(forecast)
    wind = filter_log(measured.time_s, measured.wind, measured.noise, expected, settings)
    check = _check(air, used)
    legs = find_legs(seconds)
    found = Replay(
        summary=log.summary,
        system=chosen,
        seconds=seconds,
        wind=wind,
        measured=measured,
        forecast=None if forecast is None else expected,
        drag=used,
        drag_source=source,
        drag_fit=fit,
        drag_check=check,
        legs=legs,
        phases=phase_energy(seconds),
        events=(),
    )
    return replace(found, events=_events(found, from_s, to_s))


def reduce_log(log: Log, system: int | None, from_s: float, to_s: float) -> tuple[TelemetryTrack, Blocks]:
    """Return one row a second of a vehicle, and the averages that measurements are made of."""
    rows: list[TelemetryTrack] = []
    parts: list[Blocks] = []
    maker = BlockMaker(PERIOD_S)
    for track in log.tracks(from_s, to_s):
        if track.system == system and len(track):
            rows.append(each_second(track))
            parts.append(maker.feed(track))
    return TelemetryTrack.joined(rows), Blocks.joined([*parts, maker.flush()])


def each_second(track: TelemetryTrack) -> TelemetryTrack:
    """Return the last known value of each second, but the mean of the power."""
    number = np.floor(track.time_s - track.time_s[0]).astype(np.int64)
    _, starts = np.unique(number, return_index=True)
    last = np.append(starts[1:], len(track)) - 1
    values = track.values[last].copy()
    power = track["power_w"]
    known = np.isfinite(power)
    total = np.add.reduceat(np.where(known, power, 0.0), starts)
    count = np.add.reduceat(known.astype(np.float64), starts)
    values[:, COLUMN["power_w"]] = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    return TelemetryTrack(track.system, track.time_s[last], values)


def find_legs(seconds: TelemetryTrack) -> tuple[Leg, ...]:
    """Find the flights; pauses in the air of a few seconds do not end one."""
    flying = np.flatnonzero(is_flying(seconds)) if len(seconds) else np.empty(0, dtype=np.int64)
    if not len(flying):
        return ()
    cuts = np.flatnonzero(np.diff(seconds.time_s[flying]) > LEG_GAP_S) + 1
    legs = []
    for group in np.split(flying, cuts):
        part = seconds.part(slice(int(group[0]), int(group[-1]) + 1))
        if part.time_s[-1] - part.time_s[0] >= MIN_LEG_S:
            legs.append(_leg(part))
    return tuple(legs)


def _leg(part: TelemetryTrack) -> Leg:
    def first(name: str, *, last: bool = False) -> float:
        known = part[name][np.isfinite(part[name])]
        return float(known[-1 if last else 0]) if len(known) else math.nan

    step = np.minimum(np.diff(part.time_s, prepend=part.time_s[0]), LEG_GAP_S)
    speed = np.hypot(part["vel_north_mps"], part["vel_east_mps"])
    power = part["power_w"]
    return Leg(
        start_s=float(part.time_s[0]),
        end_s=float(part.time_s[-1]),
        distance_m=float(np.nansum(speed * step)),
        from_lat=first("lat_deg"),
        from_lon=first("lon_deg"),
        to_lat=first("lat_deg", last=True),
        to_lon=first("lon_deg", last=True),
        soc_start=first("soc"),
        soc_end=first("soc", last=True),
        energy_j=float(np.nansum(power * step)) if np.isfinite(power).any() else math.nan,
    )


def phase_energy(seconds: TelemetryTrack) -> dict[Phase, PhaseEnergy]:
    """Time and energy of climb, cruise and descent, in the air."""
    if not len(seconds):
        return {phase: PhaseEnergy(0.0, 0.0) for phase in PHASES}
    step = np.minimum(np.diff(seconds.time_s, prepend=seconds.time_s[0]), LEG_GAP_S)
    rise = -np.nan_to_num(seconds["vel_down_mps"])
    flying = is_flying(seconds)
    power = np.nan_to_num(seconds["power_w"])
    where: dict[Phase, NDArray[np.bool_]] = {
        "climb": flying & (rise > VERTICAL_MPS),
        "cruise": flying & (np.abs(rise) <= VERTICAL_MPS),
        "descent": flying & (rise < -VERTICAL_MPS),
    }
    known = bool(np.isfinite(seconds["power_w"]).any())
    return {
        phase: PhaseEnergy(float(step[rows].sum()), float((step * power)[rows].sum()) if known else math.nan)
        for phase, rows in where.items()
    }


def _check(air: Blocks, drag: DragModel | None) -> DragCheck:
    if drag is None or not len(air):
        return DragCheck(math.nan, math.nan, 0.0)
    good = air.flying & ~air.winged & np.isfinite(air.drag).all(axis=1)
    seen = tilt_air_velocity(air, drag)[good][-DRAG_WINDOW_S:]
    return check_drag(air.velocity[good][-DRAG_WINDOW_S:], seen)


def _events(found: Replay, from_s: float, to_s: float) -> tuple[LogEvent, ...]:
    """Join what the log says with what the monitors notice."""
    from link.logs.log import LogEvent

    system = found.system or 0
    events = [event for event in found.summary.events if event.system == system and from_s <= event.time_s < to_s]
    for number, leg in enumerate(found.legs, 1):
        events.append(LogEvent(leg.start_s, system, f"leg {number} begins"))
        events.append(LogEvent(leg.end_s, system, f"leg {number} ends"))
    if len(found.seconds):
        end_s = float(found.seconds.time_s[-1])
        events += [LogEvent(end_s, system, text) for text in _remarks(found)]
        events += [LogEvent(time_s, system, text) for time_s, text in _battery_remarks(found.seconds)]
    return tuple(sorted(events, key=lambda event: event.time_s))


def _remarks(found: Replay) -> list[str]:
    remarks = []
    if found.drag_source == "nominal":
        remarks.append(f"monitor: a nominal drag is used; {found.drag_fit.reason}")
    if found.drag_check.wrong:
        remarks.append(f"monitor: {found.drag_check.advice}")
    if not len(found.wind) and found.legs:
        remarks.append("monitor: no wind could be measured in this flight")
    nis = found.wind.nis[np.isfinite(found.wind.nis)]
    if len(nis) >= 60 and float(nis.mean()) > chi2_band(len(nis) / 10.0)[1]:
        remarks.append(f"monitor: the filter is overconfident (mean NIS {float(nis.mean()):.1f} instead of 2)")
    rejected = int((~found.wind.accepted).sum())
    if rejected:
        remarks.append(f"monitor: {rejected} of {len(found.wind)} wind measurements were rejected by the gate")
    return remarks


def _battery_remarks(seconds: TelemetryTrack) -> list[tuple[float, str]]:
    soc = seconds["soc"]
    known = np.flatnonzero(np.isfinite(soc))
    if len(known) < 2:
        return []
    jumps = known[1:][np.abs(np.diff(soc[known])) > 0.10]
    remarks = [
        (float(seconds.time_s[row]), f"monitor: the state of charge jumps to {soc[row]:.0%}") for row in jumps[:20]
    ]
    low = known[soc[known] < 0.20]
    if len(low):
        remarks.append((float(seconds.time_s[low[0]]), "monitor: the state of charge falls below 20%"))
    return remarks
