"""Parsing of typed values, on a command line or on a page: places, winds, instants, durations."""

from __future__ import annotations

import re
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError, NoRouteError, refuse
from skyway.models.base.formatting import distance_text
from skyway.models.base.ranges import percent_faults
from skyway.planner.registry import PLANNERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway import settings as settings_tree
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.estimation.filter import WindFilterSettings
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.objective import Objective

WIND = re.compile(r"^\s*([0-9]+(?:\.[0-9]*)?)\s*@\s*([0-9]+(?:\.[0-9]*)?)\s*$")

POSITION = re.compile(r"^\s*(-?[0-9]+(?:\.[0-9]*)?)\s*,\s*(-?[0-9]+(?:\.[0-9]*)?)\s*$")

YEARS = (1900, 2200)
"""Departures beyond these years are slips of the pen."""

TYPED = {
    "payload_kg": "--payload",
    "reserve_soc": "--reserve",
    "state.soc": "--soc",
    "state.time": "--depart",
    "recharge": "--recharge",
    "airspeed_mps": "--airspeed",
    "seed": "--seed",
    "drone": "--drone",
    "destination": "--to",
    "truth": "--actual-wind",
    "depart": "--depart",
    "depart-window": "--depart-window",
    "objective": "--objective",
    "authorized": "--authorized",
    "stop_at": "--stop-at",
    "return_to": "--return",
    "dwell_s": "--dwell",
    "undelivered_to": "--if-undelivered",
    "release": "--release",
    "not_before": "--not-before",
    "flown_runs": "--as-flown",
    "runs": "--runs",
    "planner": "--planner",
}
"""Option behind each field that a fault may name."""


@contextmanager
def as_typed(**texts: str | None) -> Iterator[None]:
    """Name options, not fields, in the faults of what was typed, and the value of a field as typed where its text is given."""

    def typed(fault: Fault) -> Fault:
        if fault.file:
            return fault
        text = texts.get(fault.field or "")
        return replace(
            fault, field=TYPED.get(fault.field or "", fault.field), value=fault.value if text is None else text
        )

    try:
        yield
    except InputError as error:
        raise InputError([typed(one) for one in error.faults]) from None


@contextmanager
def named(option: str) -> Iterator[None]:
    """Name an option in all faults."""
    try:
        yield
    except InputError as error:
        raise InputError([replace(fault, field=option) for fault in error.faults]) from None


def planner_parameters(settings: list[str] | None) -> PlannerParameters:
    """Return the parameters of planners with what ``--set`` changes."""
    return settings_of(settings).planner


def settings_of(settings: list[str] | None, wind_filter: WindFilterSettings | None = None) -> settings_tree.Settings:
    """Return all parameters with what ``--set`` changes; those of the wind filter may begin elsewhere than at its defaults."""
    from skyway import settings as tree
    from skyway.models.base.parameters import with_settings

    usual = tree.WindParameters() if wind_filter is None else tree.WindParameters(wind_filter)
    return with_settings(tree.Settings(wind=usual), settings or [])


def percent(value: float, option: str, *, high: float = 100.0) -> float:
    """Turn percent, as typed, into a fraction; an `InputError` names the option."""
    faults = percent_faults(option, value, high)
    refuse(faults)
    return value / 100.0


def parse_wind(text: str) -> tuple[float, float]:
    """Read ``SPEED@FROM``, for example ``8@270``: 8 m/s from the west, at cruise height."""
    match = WIND.match(text)
    if match is None:
        raise InputError("not a wind", field="--wind", value=text, remedy="write m/s@degrees FROM, such as 8@270")
    speed, direction = float(match[1]), float(match[2])
    if speed > 75.0 or direction > 360.0:
        remedy = "speed up to 75 m/s, direction from 0 to 360 degrees"
        raise InputError("out of range", field="--wind", value=text, remedy=remedy)
    return speed, direction % 360.0


def parse_position(text: str) -> tuple[float, float] | None:
    """Read ``lat,lon``; None where the text is something else."""
    match = POSITION.match(text)
    return (float(match[1]), float(match[2])) if match else None


def place(scenario: Scenario, text: str, option: str) -> tuple[Scenario, str]:
    """Find a station by id or part of its name; ``lat,lon`` adds a delivery target. Returns (scenario, station id)."""
    position = parse_position(text)
    with named(option):
        if position is None:
            return scenario, scenario.network.stations[scenario.network.find(text)].id
        return _target(scenario, *position, leads="from" if option == "--from" else "to")


def _target(scenario: Scenario, lat: float, lon: float, *, leads: str) -> tuple[Scenario, str]:
    """Add a place to the network, one that the delivery `leads` from or to; a `NoRouteError` where no segment reaches it."""
    from skyway.models.base.geodesy import inverse

    network = scenario.network
    named_as = {"id": "start", "kind": "start"} if leads == "from" else {}
    wider = scenario.with_target(lat, lon, **named_as)
    distance, _ = inverse(lat, lon, network.lat, network.lon)
    nearest = int(distance.argmin())
    if len(wider.network) == len(network):
        return scenario, network.stations[nearest].id
    if len(wider.network.tail) == len(network.tail):
        message = (
            f"no route {leads} {lat:g},{lon:g}: no segment joins it; the nearest station, "
            f"{network.stations[nearest].id}, is {distance_text(distance[nearest])} away"
        )
        swapped, _ = inverse(lon if abs(lon) <= 90 else 0.0, lat, network.lat, network.lon)
        if abs(lon) <= 90 and swapped.min() < distance[nearest] / 10:
            message += "; lat and lon look swapped"
        raise NoRouteError(message, constraint="disconnected")
    return wider, wider.network.stations[-1].id


def parse_depart(text: str | None) -> datetime:
    """Departure as typed; without one, now (to the minute)."""
    from skyway.models.base.units import parse_instant

    if text is None:
        return datetime.now(UTC).replace(second=0, microsecond=0)
    with named("--depart"):
        instant = parse_instant(text)
    if not YEARS[0] <= instant.year <= YEARS[1]:
        remedy = f"a year from {YEARS[0]} to {YEARS[1]}"
        raise InputError("out of range", field="--depart", value=text, remedy=remedy)
    return instant


def parse_time(text: str, option: str) -> datetime:
    """Return a time as typed, with its offset from UTC."""
    from skyway.models.base.units import parse_instant

    with named(option):
        return parse_instant(text)


def parse_duration(text: str, option: str) -> float:
    """Seconds of a length of time as typed with its unit: ``45min``, ``2h``, ``1.5h``."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(h|min|m|s)?\s*", text)
    if found is None:
        raise InputError("is not a duration", field=option, value=text, remedy="such as 90min or 2h")
    if found[2] is None:
        meant = f"{found[1]}h or {found[1]}min"
        raise InputError("has no unit", field=option, value=text, remedy=f"did you mean {meant}?")
    return float(found[1]) * {"h": 3600.0, "min": 60.0, "m": 60.0, "s": 1.0}[found[2]]


def parse_objective(text: str) -> Objective:
    """Objective as typed: ``mean``, ``p95``, ``on-time 2013-07-10T16:00-04:00``."""
    from skyway.planner.problem.objective import Objective

    with as_typed():
        return Objective.parse(text)


def wind_forecast(
    scenario: Scenario,
    depart: datetime,
    wind: str | None,
    forecast: Sequence[Path] | None,
    truth: WindEnsemble | None,
    day: date | None,
    error: Path | None = None,
) -> WindEnsemble:
    """Wind that the planner knows: constant, from weather files, or the scenario's analogue days (without the true one)."""
    from skyway.models.wind.forecast import constant_wind
    from skyway.planner.problem.problem import HORIZON_H

    if wind is not None and forecast:
        raise InputError("--wind and --forecast exclude each other", remedy="give one of them")
    if wind is not None:
        speed, direction = parse_wind(wind)
        lat, lon = float(scenario.network.lat.mean()), float(scenario.network.lon.mean())
        return constant_wind(speed, direction, depart, HORIZON_H, lat, lon, scenario.rules.cruise_height_m)
    if forecast:
        return scenario.forecast_from(forecast, depart, HORIZON_H, error=error, truth=day)
    if scenario.history is None and not scenario.has_forecast and truth is not None:
        return truth
    return scenario.forecast(depart, HORIZON_H, truth=day)


def true_wind(
    scenario: Scenario, depart: datetime, text: str | None, option: str = "--actual-wind"
) -> tuple[WindEnsemble | None, date | None]:
    """Wind as it will be: a day of the record (``2013-07-10``) or a forecast file with one member."""
    from skyway.planner.problem.problem import HORIZON_H

    if text is None:
        return None, None
    try:
        day = date.fromisoformat(text)
    except ValueError:
        path = Path(text)
        if not path.is_file():
            remedy = "a day of the record such as 2013-07-10, or a forecast file with one member"
            raise InputError("neither a date nor a file", field=option, value=text, remedy=remedy) from None
        return scenario.forecast_from([path], depart, HORIZON_H), None
    try:
        return scenario.truth(day, depart, HORIZON_H), day
    except InputError as error:
        faults = [replace(one, field=option if one.field == "truth" else one.field) for one in error.faults]
        raise InputError(faults) from error


def check_planners(names: Sequence[str], option: str, among: Sequence[str] = PLANNERS) -> None:
    """Refuse names of planners that are not among some."""
    known = ", ".join(among)
    informed = "has perfect information, which no forecast gives"
    faults = [
        Fault(informed if name in PLANNERS else "no such planner", field=option, value=name, remedy=f"one of {known}")
        for name in names
        if name not in among
    ]
    if not names:
        faults = [Fault("no planner named", field=option, remedy=f"one or more of {known}")]
    refuse(faults)
