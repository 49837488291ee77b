"""Command ``forecast``: update a forecast with winds measured by drones."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast
from zoneinfo import ZoneInfo

import msgspec
import typer

from skyway.cli import log_options, options
from skyway.cli.log_options import Columns, open_any
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import write_atomically
from skyway.models.base.formatting import distance_text, wind_text
from skyway.models.base.json_text import json_text
from skyway.models.base.units import from_posix, iso, parse_instant
from skyway.models.composition.composition import Wind

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.link.logs.common.vehicle_kind import Kind
    from skyway.link.replay.replay import ReplayOptions
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation

OLDEST_H = 24.0
"""Older measurements than this say nothing about the departure."""
SHOWN_H = (0, 1, 2, 3, 6, 12)


@dataclass(frozen=True, slots=True)
class Update:
    """A forecast before and after what was measured, for the height of its sites.

    Attributes
    ----------
    world : Scenario
    depart_s : float
        POSIX seconds.
    before, after : WindEnsemble
    seen : tuple of WindObservation
        At the height of the sites.
    """

    world: Scenario
    depart_s: float
    before: WindEnsemble
    after: WindEnsemble
    seen: tuple[WindObservation, ...]


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """A wind that was measured, at the height of the sites."""

    t: str
    lat: float
    lon: float
    north_mps: float
    east_mps: float
    sigma_mps: float


class SiteWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind at a site at the departure."""

    site: str
    speed_mps: float
    from_deg: float
    sigma_mps: float


class SlotWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind of an hour (`models.wind.summary`), and the spread of the members about their mean vector."""

    speed_mps: float
    p10_mps: float
    p90_mps: float
    from_deg: float | None
    sigma_mps: float

    @property
    def wind(self) -> Wind:
        """The same without the spread of the vectors."""
        return Wind(self.speed_mps, self.from_deg, self.p10_mps, self.p90_mps)


class HourWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind at the centre of the network, at cruise height, so many hours after the departure."""

    hours: int
    before: SlotWind
    after: SlotWind


class ForecastReport(msgspec.Struct, frozen=True, kw_only=True):
    """What an update did: measured winds, wind at each site, hours before and after, probability of each member."""

    schema: str = "skyway.forecast-update/1"
    depart: str
    height_m: float
    observations: list[Measured]
    field: list[SiteWind]
    hours: list[HourWind]
    members: dict[str, float]


def forecast(
    logs: Annotated[list[Path] | None, typer.Argument(help="Flight logs, of any drone.")] = None,
    scenario: log_options.ScenarioName = None,
    base: Annotated[
        Path | None, typer.Option("--forecast", help="Forecast to update. Without it: made from the wind record.")
    ] = None,
    depart: Annotated[str | None, typer.Option(help="Departure to plan for. Without it: the last measurement.")] = None,
    hours: Annotated[int, typer.Option(help="Hours after the departure.", min=1, max=48)] = 12,
    slot: Annotated[float, typer.Option(help="Longest time slot of the file, minutes.")] = 60.0,
    drag: log_options.Drag = None,
    vehicle: log_options.VehicleKind = None,
    columns: Columns = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Output file for the forecast: FILE.csv.")
    ] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Update the wind forecast with winds measured by drones, and write it for skyway plan.

    The winds of all logs are combined: a forecast error is similar at nearby places and times. Members close to the
    measurements gain weight, and each member is corrected by its own error; the correction fades with the lead time.
    Without logs the forecast is written unchanged.

    Examples
    --------
      skyway forecast flight1.tlog flight2.tlog -o forecast.csv
      skyway forecast today/*.tlog --scenario my-scenario --drag drag.toml --depart 2025-06-15T12:00Z -o forecast.csv
      skyway plan my-scenario --forecast forecast.csv --from depot --to clinic --payload 1.2
    """
    from skyway.link.replay.replay import ReplayOptions
    from skyway.models.wind.estimation.forecast_update import SLOT_S

    if not 1.0 <= slot <= 360.0:
        raise InputError(Fault("out of range", field="--slot", value=slot, remedy="1 to 360 minutes"))
    options.refuse_overwriting(output, force=force)
    instant = None if depart is None else options.parse_depart(depart)
    world = log_options.load_named(scenario)
    if not world.wind_sites:
        raise InputError(Fault("the scenario has no wind sites", world.path, remedy="name them in [[wind.sites]]"))
    drag_model, sensor = log_options.air_of(drag)
    asked = ReplayOptions(vehicle=cast("Kind | None", vehicle), drag=drag_model, airspeed=sensor)
    seen = [one for path in logs or () for one in _observations(path, columns, asked)]
    update = _update(world, seen, instant, hours, base, max(60.0 * slot, SLOT_S / 10.0))
    if output is not None:
        from skyway.models.wind.forecast_file import forecast_table

        write_atomically(output, forecast_table(update.after, [site.id for site in world.wind_sites]), force=force)
    report = _report(update)
    if as_json:
        typer.echo(json_text(report))
    else:
        _tell(report, output)


def _observations(path: Path, columns: Path | None, asked: ReplayOptions) -> list[WindObservation]:
    """What every vehicle of a log measured; nothing is expected of the wind, so that no forecast counts twice."""
    from skyway.link.replay.replay import replay

    log = open_any(path, columns)
    log_options.dated(log)
    found: list[WindObservation] = []
    for system in log.summary.systems:
        course = replay(log, replace(asked, system=system))
        if course.drag_source == "none" and course.drag_reason and not course.observations:
            typer.echo(f"skyway: {path}: vehicle {system}: {course.drag_reason}", err=True)
        if course.tally.doubted:
            unknown = f"its wind is unknown for {course.tally.doubted} s in which the filter is inconsistent"
            typer.echo(f"skyway: {path}: vehicle {system}: {unknown}", err=True)
        if course.drag_source == "nominal":
            typer.echo(f"skyway: {path}: vehicle {system}: a nominal drag is used; {course.drag_reason}", err=True)
        found += course.observations
    if not found:
        typer.echo(f"skyway: {path}: no wind could be estimated from it", err=True)
    return found


def _update(
    world: Scenario, seen: list[WindObservation], instant: datetime | None, hours: int, base: Path | None, slot_s: float
) -> Update:
    from skyway.models.wind.estimation.forecast_update import update_forecast
    from skyway.models.wind.forecast import read_forecast

    if not seen and instant is None:
        remedy = "give logs with measured wind, or --depart"
        raise InputError(Fault("no time is known for the forecast", remedy=remedy))
    depart_s = max(one.time_s for one in seen) if instant is None else instant.timestamp()
    fresh = [one for one in seen if -hours <= (depart_s - one.time_s) / 3600.0 <= OLDEST_H]
    if len(fresh) < len(seen):
        typer.echo(
            f"skyway: {len(seen) - len(fresh)} measurements are too long before or after the departure", err=True
        )
    near = [one for one in fresh if _distance_m(world, one) <= log_options.FAR_M]
    if len(near) < len(fresh):
        away = f"more than {distance_text(log_options.FAR_M)} from every wind site"
        typer.echo(f"skyway: {len(fresh) - len(near)} measurements are {away} and are left out", err=True)
    fresh = near
    begin = from_posix(min([depart_s, *(one.time_s for one in fresh)]))
    span_h = hours + math.ceil((depart_s - begin.timestamp()) / 3600.0)
    if base is not None:
        before = read_forecast(base, world.wind_sites, begin, span_h, world.measured_at_m)
    else:
        day = from_posix(depart_s).astimezone(ZoneInfo(world.timezone)).date()
        before = world.forecast(begin, span_h, truth=day)
    exponent = world.rules.wind_profile_exponent
    level = tuple(one.at_height(before.height_m, exponent) for one in fresh)
    return Update(world, depart_s, before, update_forecast(before, level, slot_s=slot_s), level)


def _distance_m(world: Scenario, one: WindObservation) -> float:
    from skyway.models.base.geodesy import distance_m

    return min(distance_m(one.lat_deg, one.lon_deg, site.lat, site.lon) for site in world.wind_sites)


def _report(update: Update) -> ForecastReport:
    """Work out what is told: the winds measured, at each site now, and before and after by hour."""
    return ForecastReport(
        depart=iso(from_posix(round(update.depart_s, 3))),
        height_m=update.before.height_m,
        observations=[
            Measured(
                t=iso(from_posix(round(one.time_s, 3))),
                lat=round(one.lat_deg, 6),
                lon=round(one.lon_deg, 6),
                north_mps=round(one.north_mps, 3),
                east_mps=round(one.east_mps, 3),
                sigma_mps=round(math.sqrt(one.variance), 3),
            )
            for one in update.seen
        ],
        field=_field(update),
        hours=_hours(update),
        members=dict(zip(update.after.labels, update.after.probability.round(6).tolist(), strict=True)),
    )


def _hours(update: Update) -> list[HourWind]:
    from skyway.plots.wind_summary import over_region

    regions = [(one, *over_region(one, update.world)) for one in (update.before, update.after)]
    found = []
    for hour in SHOWN_H:
        time_s = update.depart_s + 3600.0 * hour
        if time_s < update.after.start_s + update.after.slots * update.after.slot_s:
            before, after = (_slot(one, north, east, one.slot_at(time_s)) for one, north, east in regions)
            found.append(HourWind(hours=hour, before=before, after=after))
    return found


def _slot(ensemble: WindEnsemble, north: Any, east: Any, slot: int) -> SlotWind:
    from skyway.models.wind.summary import summary_of

    found = summary_of(north[:, slot], east[:, slot], ensemble.probability)
    off = (north[:, slot] - found.north_mps) ** 2 + (east[:, slot] - found.east_mps) ** 2
    return SlotWind(
        speed_mps=round(found.mean_mps, 3),
        p10_mps=round(found.p10_mps, 3),
        p90_mps=round(found.p90_mps, 3),
        from_deg=None if found.from_deg is None else round(found.from_deg, 1),
        sigma_mps=round(math.sqrt(0.5 * float(ensemble.probability @ off)), 3),
    )


def _field(update: Update) -> list[SiteWind]:
    """All observations fused, and how sure that is."""
    import numpy as np

    from skyway.models.wind.estimation.field import WindField
    from skyway.models.wind.estimation.live import forecast_of

    mean = forecast_of(update.before)
    expected = [mean(one.time_s, one.lat_deg, one.lon_deg, math.nan) for one in update.seen]
    fused = WindField(update.seen, np.array(expected).reshape(-1, 2))
    found = []
    for site in update.world.wind_sites:
        now = fused.at(update.depart_s, site.lat, site.lon, mean(update.depart_s, site.lat, site.lon, math.nan))
        speed, sigma = round(now.speed_mps, 3), round(now.sigma_mps, 3)
        found.append(SiteWind(site=site.id, speed_mps=speed, from_deg=round(now.from_deg, 1), sigma_mps=sigma))
    return found


def _tell(report: ForecastReport, output: Path | None) -> None:
    count = len(report.observations)
    what = "1 measurement" if count == 1 else f"{count} measurements"
    depart = iso(from_posix(round(parse_instant(report.depart).timestamp())))
    typer.echo(f"{len(report.members)} members updated with {what} of 10 minutes, for {depart}")
    for row in report.field:
        typer.echo(f"  {row.site}: {wind_text(row.speed_mps, row.from_deg, row.sigma_mps)} at {report.height_m:g} m")
    typer.echo("  at the centre of the network, at cruise height, before and after:")
    for hour in report.hours:
        typer.echo(f"  +{hour.hours:2d} h: {hour.before.wind}  →  {hour.after.wind}")
    typer.echo("use -o FILE to write it" if output is None else f"written to {output}: skyway plan --forecast {output}")
