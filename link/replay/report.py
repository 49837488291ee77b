"""The report of a replay, and its table with a row per second."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, BinaryIO

import msgspec
import numpy as np

from skyway.link.logs.common.vehicle_kind import Vehicle  # noqa: TC001  the annotations are read at run time
from skyway.models.base.units import J_PER_WH, from_posix, iso
from skyway.models.drones.telemetry import QUANTITIES, TimeBase
from skyway.models.wind.estimation.health import chi2_band
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.link.replay.monitors import Leg
    from skyway.link.replay.prediction import Prediction
    from skyway.link.replay.replay import Replay
    from skyway.models.drones.telemetry import TelemetryTrack
    from skyway.models.wind.estimation.filter import FilteredWind

ESTIMATED = (
    "estimated_wind_north_mps",
    "estimated_wind_east_mps",
    "estimated_sigma_mps",
    "estimated_var_north_m2ps2",
    "estimated_cov_north_east_m2ps2",
    "estimated_var_east_m2ps2",
)
CORRELATED = 10.0
"""So many neighbouring innovations of a real log are as good as one."""
MAX_WINDS = 2000
WIND_EVERY_S = 5.0
MAX_EVENTS = 500
Instant = str | float | None
"""ISO 8601 where the log knows the date, else seconds of the log; None: unknown."""


class FlightLeg(msgspec.Struct, frozen=True, kw_only=True, rename={"origin": "from", "destination": "to"}):
    """A flight of the log; its ends as (latitude, longitude)."""

    start: Instant
    end: Instant
    time_s: float | None
    distance_m: float | None
    origin: tuple[float | None, float | None]
    destination: tuple[float | None, float | None]
    soc_start: float | None
    soc_end: float | None
    energy_wh: float | None


class WindAt(msgspec.Struct, frozen=True, kw_only=True):
    """Wind estimated at a time."""

    t: Instant
    speed_mps: float | None
    from_deg: float | None
    sigma_mps: float | None
    covariance_m2ps2: tuple[float | None, ...]


class AgainstForecast(msgspec.Struct, frozen=True, kw_only=True):
    """The forecast's mean wind, its mean error, and its error at each time."""

    speed_mps: float | None
    from_deg: float | None
    vector_difference_mps: float | None
    vector_rms_mps: float | None


class WindSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Wind of the whole flight, and how consistent the filter was."""

    mean_speed_mps: float | None
    mean_from_deg: float | None
    forecast: AgainstForecast | None
    measurements: dict[str, int]
    rejected: int
    inconsistent_s: int
    known_share: float | None
    """Of the time in the air, 0 to 1."""
    known_at_end: bool
    """Whether the last known wind still counts at the end of the flight."""
    last_known: WindAt | None
    nis_mean: float | None
    nis_band_95: tuple[float | None, ...] | None


class AirspeedUsed(msgspec.Struct, frozen=True, kw_only=True):
    """The airspeed sensor in use."""

    source: str
    factor: float | None
    heading_offset_deg: float | None


class DragUsed(msgspec.Struct, frozen=True, kw_only=True):
    """The drag in use, and what the flight reveals about it."""

    source: str
    as_live: bool
    linear_per_s: float | None
    quadratic_per_m: float | None
    reason: str | None
    check_factor: float | None
    check_sigma: float | None
    airspeed: AirspeedUsed


class PhaseUse(msgspec.Struct, frozen=True, kw_only=True):
    """Time, energy and power of a phase."""

    time_s: float | None
    energy_wh: float | None
    mean_power_w: float | None


class EnergyUse(msgspec.Struct, frozen=True, kw_only=True):
    """Energy and charge of the whole."""

    total_wh: float | None
    soc_start: float | None
    soc_end: float | None
    phases: dict[str, PhaseUse]


class EventAt(msgspec.Struct, frozen=True, kw_only=True):
    """An event of a vehicle."""

    t: Instant
    system: int | None
    text: str


class PredictedEnergy(msgspec.Struct, frozen=True, kw_only=True):
    """Energy that a drone's model predicts for the flight, beside the measured energy."""

    drone: str
    mass_kg: float | None
    predicted_wh: float | None
    predicted_by_phase_wh: dict[str, float | None]
    measured_wh: float | None
    error: float | None
    predicted_soc_used: float | None
    measured_soc_used: float | None


class ReplayReport(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a replay found: ``skyway.replay/1``."""

    schema: str = "skyway.replay/1"
    format: str
    messages: int
    by_type: dict[str, int]
    skipped_bytes: int
    systems: tuple[int, ...]
    other_systems: tuple[int, ...]
    system: int | None
    vehicle: Vehicle
    start: Instant
    end: Instant
    time_base: TimeBase
    legs: list[FlightLeg]
    wind: list[WindAt]
    wind_summary: WindSummary
    drag: DragUsed
    energy: EnergyUse
    events: list[EventAt]
    prediction: PredictedEnergy | msgspec.UnsetType = msgspec.UNSET
    parameters: dict[str, str] | msgspec.UnsetType = msgspec.UNSET


def instant(found: Replay, time_s: float) -> Instant:
    """Return a time as JSON has it: ISO 8601 where the log knows the date, else seconds of the log; None: unknown."""
    if not math.isfinite(time_s):
        return None
    if not found.summary.time_base.absolute or not 0.0 <= time_s < 4e9:
        return round(time_s, 3)
    return iso(from_posix(round(time_s, 3)))


def replay_report(
    found: Replay, prediction: Prediction | None = None, parameters: dict[str, str] | None = None
) -> ReplayReport:
    """Compute the report of a replay; unknown numbers are None."""
    summary = found.summary
    return ReplayReport(
        format=summary.format,
        messages=summary.messages,
        by_type=summary.by_type,
        skipped_bytes=summary.skipped_bytes,
        systems=summary.systems,
        other_systems=summary.others,
        system=found.system,
        vehicle=found.vehicle,
        start=instant(found, summary.start_s),
        end=instant(found, summary.end_s),
        time_base=summary.time_base,
        legs=[_leg(found, leg) for leg in found.legs],
        wind=_winds(found),
        wind_summary=_wind_summary(found),
        drag=_drag(found),
        energy=_energy(found),
        events=[
            EventAt(t=instant(found, event.time_s), system=event.system, text=event.text)
            for event in found.events[:MAX_EVENTS]
        ],
        prediction=msgspec.UNSET if prediction is None else _prediction(prediction),
        parameters=parameters or msgspec.UNSET,
    )


def _known(value: float, digits: int = 3) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _leg(found: Replay, leg: Leg) -> FlightLeg:
    return FlightLeg(
        start=instant(found, leg.start_s),
        end=instant(found, leg.end_s),
        time_s=_known(leg.end_s - leg.start_s),
        distance_m=_known(leg.distance_m, 1),
        origin=(_known(leg.from_lat, 7), _known(leg.from_lon, 7)),
        destination=(_known(leg.to_lat, 7), _known(leg.to_lon, 7)),
        soc_start=_known(leg.soc_start),
        soc_end=_known(leg.soc_end),
        energy_wh=_known(leg.energy_j / J_PER_WH),
    )


def _winds(found: Replay) -> list[WindAt]:
    wind = found.wind
    if not len(wind):
        return []
    every = max(WIND_EVERY_S, float(wind.time_s[-1] - wind.time_s[0]) / MAX_WINDS)
    number = np.floor((wind.time_s - wind.time_s[0]) / every)
    rows = np.append(np.flatnonzero(np.diff(number)), len(wind) - 1)
    return _winds_at(found, wind, rows)


def _winds_at(found: Replay, wind: FilteredWind, rows: NDArray[np.int64]) -> list[WindAt]:
    """Return some rows of a course."""
    speed, direction = speed_from(wind.wind[rows, 0], wind.wind[rows, 1])
    return [
        WindAt(
            t=instant(found, float(wind.time_s[row])),
            speed_mps=_known(speed[place]),
            from_deg=_known(direction[place], 1),
            sigma_mps=_known(wind.sigma_mps[row]),
            covariance_m2ps2=tuple(_known(value) for value in wind.covariance[row]),
        )
        for place, row in enumerate(rows)
    ]


def _wind_summary(found: Replay) -> WindSummary:
    tally = found.tally
    speed, direction = (float(value) for value in speed_from(tally.mean(tally.north), tally.mean(tally.east)))
    band = chi2_band(tally.count / CORRELATED)
    return WindSummary(
        mean_speed_mps=_known(speed),
        mean_from_deg=_known(direction, 1),
        forecast=_against_forecast(found),
        measurements=found.measured,
        rejected=found.rejected,
        inconsistent_s=found.tally.doubted,
        known_share=_known(found.known.share),
        known_at_end=found.known.at_end,
        last_known=next(iter(_winds_at(found, found.known.last, np.arange(len(found.known.last)))), None),
        nis_mean=_known(tally.mean(tally.nis)),
        nis_band_95=tuple(_known(value) for value in band) if tally.count else None,
    )


def _against_forecast(found: Replay) -> AgainstForecast | None:
    tally = found.tally
    if not found.forecast or not tally.count:
        return None
    speed, direction = speed_from(tally.mean(tally.expected_north), tally.mean(tally.expected_east))
    return AgainstForecast(
        speed_mps=_known(float(speed)),
        from_deg=_known(float(direction), 1),
        vector_difference_mps=_known(math.hypot(tally.mean(tally.off_north), tally.mean(tally.off_east))),
        vector_rms_mps=_known(math.sqrt(tally.mean(tally.off_squared))),
    )


def _drag(found: Replay) -> DragUsed:
    drag = found.drag
    return DragUsed(
        source=found.drag_source,
        as_live="identified" not in (found.drag_source, found.airspeed_source),
        linear_per_s=None if drag is None else _known(drag.linear_per_s, 5),
        quadratic_per_m=None if drag is None else _known(drag.quadratic_per_m, 6),
        reason=found.drag_reason or None,
        check_factor=_known(found.drag_check.factor),
        check_sigma=_known(found.drag_check.sigma),
        airspeed=AirspeedUsed(
            source=found.airspeed_source,
            factor=_known(found.airspeed.factor, 4),
            heading_offset_deg=_known(math.degrees(found.airspeed.heading_offset_rad), 2),
        ),
    )


def _energy(found: Replay) -> EnergyUse:
    total = sum(phase.energy_j for phase in found.phases.values())
    return EnergyUse(
        total_wh=_known(total / J_PER_WH),
        soc_start=_known(found.soc[0]),
        soc_end=_known(found.soc[1]),
        phases={
            name: PhaseUse(
                time_s=_known(phase.time_s, 1),
                energy_wh=_known(phase.energy_j / J_PER_WH),
                mean_power_w=_known(phase.energy_j / phase.time_s, 1) if phase.time_s > 0.0 else None,
            )
            for name, phase in found.phases.items()
        },
    )


def _prediction(made: Prediction) -> PredictedEnergy:
    return PredictedEnergy(
        drone=made.drone.id,
        mass_kg=_known(made.mass_kg),
        predicted_wh=_known(made.total_j / J_PER_WH),
        predicted_by_phase_wh={name: _known(energy / J_PER_WH) for name, energy in made.predicted_j.items()},
        measured_wh=_known(made.measured_j / J_PER_WH),
        error=_known(made.error, 4),
        predicted_soc_used=_known(made.predicted_soc),
        measured_soc_used=_known(made.measured_soc),
    )


class Table:
    """Writes a row a second as the replay goes: the vehicle's own quantities, and the wind estimated then."""

    def __init__(self, stream: BinaryIO) -> None:
        self._text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True)
        self._writer = csv.writer(self._text, lineterminator="\n")
        self._writer.writerow(["time_s", *QUANTITIES, *ESTIMATED])
        self._measured = False

    def add(self, rows: TelemetryTrack, course: FilteredWind) -> None:
        """Write some seconds."""
        for row, time_s in enumerate(rows.time_s.tolist()):
            self._measured = self._measured or bool(course.accepted[row])
            known = self._measured and bool(course.trusted[row])
            told = [*course.wind[row], course.sigma_mps[row], *course.covariance[row]]
            extra = told if known else [math.nan] * len(ESTIMATED)
            cells = [f"{value:.10g}" if math.isfinite(value) else "" for value in (*rows.values[row], *extra)]
            self._writer.writerow([f"{time_s:.6f}", *cells])

    def close(self) -> None:
        """Leave the stream to its owner."""
        self._text.detach()
