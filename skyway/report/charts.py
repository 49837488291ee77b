"""Charts of a flight report: height, charge, wind, speed and cross-track distance over time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.formatting import percent
from skyway.report.svg import BROAD, Band, Chart, Course

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.report.flight_report import FlightReport
    from skyway.report.series import Columns

_GAP_S = 30.0
"""In flight there is a record every 5 s; a longer silence is shown as one."""
_GROUND_GAP_S = 400.0


def charts(document: FlightReport) -> list[Chart]:
    """Return the charts: charge, wind, height, wind direction, ground speed, distance from the way."""
    span = time_span(document)
    if span is None:
        return []
    flights = [(leg.depart_s, leg.land_s if leg.land_s is not None else span[1]) for leg in document.legs]
    turns = [(d.time_s, d.reason or "") for d in document.decisions if d.where == "flight"]
    plain = Chart("", "", begin_s=span[0], end_s=span[1], spans=flights, zone=document.zone)
    broad = replace(plain, turns=turns, width=BROAD)
    return [
        _charge(document, broad),
        _wind_speed(document, broad),
        _height(document, plain),
        _wind_direction(document, plain),
        _ground_speed(document, replace(plain, turns=turns)),
        _off_the_way(document, plain),
    ]


def time_span(document: FlightReport) -> tuple[float, float] | None:
    """Return from when to when the flight went, the plan's end included; None where nothing has an instant."""
    times = [*document.series.track["time_s"], *(event.time_s for event in document.events)]
    if not times:
        return None
    begin_s, end_s = min(times), max(times)
    planned = [leg.arrive_s for leg in document.planned.legs if leg.arrive_s is not None]
    longest_s = end_s + 2.0 * max(end_s - begin_s, 600.0)
    return begin_s, max([end_s, *(at_s for at_s in planned if at_s <= longest_s)])


def _points(columns: Columns, name: str, factor: float = 1.0) -> list[tuple[float, float | None]]:
    return [
        (at_s, None if value is None else factor * value)
        for at_s, value in zip(columns["time_s"], columns[name], strict=True)
    ]


def _actual(document: FlightReport, name: str, factor: float = 1.0) -> Course:
    """What the vehicle told: the recording's where there is one, since it is finer."""
    log = document.series.log
    if log is not None:
        return Course("flown (recording)", "actual", _points(log, name, factor), _GROUND_GAP_S)
    return Course("flown", "actual", _points(document.series.track, name, factor), _GROUND_GAP_S)


def _flown(document: FlightReport, name: str) -> Course:
    """The same in flight only: on the ground the last home may be far below or above."""
    log = document.series.log
    if log is None:
        return Course("flown", "actual", _points(_aloft(document.series.track), name), _GAP_S)
    flights = [(leg.depart_s, leg.land_s or math.inf) for leg in document.legs]
    points = [(at_s, value) for at_s, value in _points(log, name) if any(a <= at_s <= b for a, b in flights)]
    return Course("flown (recording)", "actual", points, _GAP_S)


def _charge(document: FlightReport, frame: Chart) -> Chart:
    """State of charge: told by the vehicle, planned at first, expected at each take-off, and true."""
    planned: list[tuple[float, float | None]] = []
    for leg in document.planned.legs:
        for at_s, soc in ((leg.depart_s, leg.soc_depart), (leg.arrive_s, leg.soc_arrive)):
            if at_s is not None and soc is not None:
                planned.append((at_s, 100.0 * soc))
    expected: list[tuple[float, float | None]] = []
    for one in document.legs:
        if one.soc_depart is not None and one.planned_soc is not None and one.planned_s is not None:
            landing_s = one.depart_s + one.planned_s
            expected += [
                (one.depart_s, 100.0 * one.soc_depart), (landing_s, 100.0 * one.planned_soc), (landing_s, None)
            ]  # fmt: skip
    courses = [Course("first plan, typical schedule", "planned", planned), _actual(document, "soc", 100.0)]
    if document.series.truth["time_s"]:
        true = Course("true (simulation)", "true", _points(document.series.truth, "soc", 100.0), _GAP_S)
        courses.append(true)
    courses.append(Course("expected at each take-off", "expected", expected))
    reserve = document.delivery.reserve_soc
    level = None if reserve is None else (100.0 * reserve, f"reserve {percent(reserve)}")
    return replace(
        frame, title="State of charge", unit="%", courses=courses, level=level, low=0.0, high=100.0, step=20.0
    )


def _height(document: FlightReport, frame: Chart) -> Chart:
    plan = document.planned
    cruise, climb, sink = plan.cruise_height_m, plan.climb_rate_mps, plan.descent_rate_mps
    planned: list[tuple[float, float | None]] = []
    if cruise and climb and sink and min(cruise, climb, sink) > 0.0:
        for leg in plan.legs:
            depart_s, arrive_s = leg.depart_s, leg.arrive_s
            if depart_s is not None and arrive_s is not None:
                planned += [
                    (depart_s, 0.0), (depart_s + cruise / climb, cruise), (arrive_s - cruise / sink, cruise),
                    (arrive_s, 0.0), (arrive_s, None),
                ]  # fmt: skip
    courses = [Course("first plan", "planned", planned), _flown(document, "height_m")]
    return replace(frame, title="Height above home", unit="m", courses=courses, low=0.0)


def _winds(
    columns: Columns, name: str, of_what: Callable[[float | None, float | None], float | None]
) -> list[tuple[float, float | None]]:
    rows = zip(columns["time_s"], columns[f"{name}_north_mps"], columns[f"{name}_east_mps"], strict=True)
    return [(at_s, of_what(north, east)) for at_s, north, east in rows]


def _speed(north: float | None, east: float | None) -> float | None:
    return None if north is None or east is None else math.hypot(north, east)


def _direction(north: float | None, east: float | None) -> float | None:
    return None if north is None or east is None else math.degrees(math.atan2(-east, -north)) % 360.0


def _aloft(columns: Columns) -> Columns:
    """Only what was told in flight: on the ground the forecast is that of another height."""
    rows = [i for i, air in enumerate(columns["air"]) if air]
    return {name: [column[i] for i in rows] for name, column in columns.items()}


def _wind_speed(document: FlightReport, frame: Chart) -> Chart:
    track, truth = _aloft(document.series.track), document.series.truth
    estimate = _winds(track, "wind", _speed)
    sigma: list[tuple[float, float | None, float | None]] = [
        (at_s, None, None) if value is None or s is None else (at_s, max(value - 2.0 * s, 0.0), value + 2.0 * s)
        for (at_s, value), s in zip(estimate, track["wind_sigma_mps"], strict=True)
    ]
    courses = [Course("estimate", "actual", estimate, _GAP_S)]
    if truth["time_s"]:
        courses.append(Course("true (simulation)", "true", _winds(truth, "wind", _speed), _GAP_S))
    courses += [
        Course("forecast, mean speed", "planned", _points(track, "forecast_mean_mps"), _GAP_S),
        Course("forecast, updated", "expected", _points(track, "believed_mean_mps"), _GAP_S),
    ]
    spread = list(zip(track["time_s"], track["forecast_p10_mps"], track["forecast_p90_mps"], strict=True))
    bands = [Band("forecast, 10 to 90 %", "planned", spread, _GAP_S), Band("two sigma", "actual", sigma, _GAP_S)]
    return replace(frame, title="Wind at the vehicle", unit="m/s", courses=courses, bands=bands, low=0.0)


def _wind_direction(document: FlightReport, frame: Chart) -> Chart:
    """Where the wind comes from; a line is broken where it goes through north."""
    track, truth = _aloft(document.series.track), document.series.truth
    courses = [Course("estimate", "actual", _unwound(_winds(track, "wind", _direction)), _GAP_S)]
    if truth["time_s"]:
        courses.append(Course("true (simulation)", "true", _unwound(_winds(truth, "wind", _direction)), _GAP_S))
    courses.append(Course("forecast, prevailing", "planned", _unwound(_points(track, "forecast_from_deg")), _GAP_S))
    return replace(frame, title="Wind comes from", unit="°", courses=courses, low=0.0, high=360.0, step=90.0)


def _unwound(points: list[tuple[float, float | None]]) -> list[tuple[float, float | None]]:
    found: list[tuple[float, float | None]] = []
    before: float | None = None
    for at_s, value in points:
        if value is not None and before is not None and abs(value - before) > 180.0:
            found.append((at_s, None))
        found.append((at_s, value))
        before = value
    return found


def _ground_speed(document: FlightReport, frame: Chart) -> Chart:
    track = _aloft(document.series.track)
    courses = [
        _flown(document, "ground_speed_mps"),
        Course("commanded", "expected", _points(track, "commanded_mps"), _GAP_S),
    ]
    return replace(frame, title="Ground speed", unit="m/s", courses=courses, low=0.0)


def _off_the_way(document: FlightReport, frame: Chart) -> Chart:
    track = _aloft(document.series.track)
    courses = [Course("off the route", "actual", _points(track, "cross_track_m"), _GAP_S)]
    return replace(frame, title="Distance from the route (cross-track)", unit="m", courses=courses, low=0.0)
