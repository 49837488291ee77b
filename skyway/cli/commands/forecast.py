"""Commands ``forecast``, which updates a forecast with winds measured by drones, and ``weather``, which shows weather files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast
from zoneinfo import ZoneInfo

import typer

from skyway import typed_values
from skyway.cli import log_options, options
from skyway.cli.log_options import Columns, open_any
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import date_clock, distance_text
from skyway.models.base.json_text import json_text
from skyway.models.base.units import from_posix
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.link.logs.common.vehicle_kind import Kind
    from skyway.link.replay.replay import ReplayOptions
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation

OLDEST_H = 24.0
"""Older measurements than this say nothing about the departure."""
REMEDY = "omit the logs for the forecast as it is, or give a --depart after the flight and a scenario of where it was"


@dataclass(frozen=True, slots=True)
class Update:
    """A forecast before and after an update with measurements, for the height of its sites."""

    world: Scenario
    depart_s: float
    """POSIX seconds."""
    before: WindEnsemble
    after: WindEnsemble
    seen: tuple[WindObservation, ...]
    """At the height of the sites."""


def forecast(
    logs: Annotated[list[Path] | None, typer.Argument(help="Flight logs, of any drone.")] = None,
    scenario: log_options.ScenarioName = None,
    base: Annotated[
        list[Path] | None,
        typer.Option(
            "--forecast",
            help="Weather forecast to update, in any format; repeatable. Default: made from the wind record.",
        ),
    ] = None,
    depart: Annotated[str | None, typer.Option(help="Departure to plan for. Default: the last measurement.")] = None,
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

    The winds of all logs are combined: a forecast error is similar at nearby places and times, according to the members of
    the forecast. Each member is moved by its own error; the shift fades with the lead time.
    Measurements after the departure do not count. Without logs the forecast is written unchanged.

    Examples
    --------
      skyway forecast flight1.tlog flight2.tlog -o forecast.csv
      skyway forecast today/*.tlog --scenario my-scenario --drag drag.toml --depart 2025-06-15T12:00Z -o forecast.csv
      skyway plan my-scenario --forecast forecast.csv --from depot --to clinic --payload 1.2
    """
    from skyway.cli.views.forecast import report_of, tell
    from skyway.link.replay.replay import ReplayOptions
    from skyway.models.wind.estimation.forecast_update import SLOT_S

    if not 1.0 <= slot <= 360.0:
        raise InputError("out of range", field="--slot", value=slot, remedy="1 to 360 minutes")
    options.refuse_overwriting(output, force=force)
    instant = None if depart is None else typed_values.parse_depart(depart)
    world = log_options.load_named(scenario)
    if not world.wind_sites:
        raise InputError("the scenario has no wind sites", world.path, remedy="name them in [[wind.sites]]")
    drag_model, sensor = log_options.air_of(drag)
    asked = ReplayOptions(vehicle=cast("Kind | None", vehicle), drag=drag_model, airspeed=sensor)
    seen = _measured(logs, columns, asked) if logs else None
    update = _update(world, seen, instant, hours, base, max(60.0 * slot, SLOT_S / 10.0))
    if output is not None:
        from skyway.models.base.files import write_atomically
        from skyway.models.wind.forecast_file import forecast_table

        write_atomically(output, forecast_table(update.after, [site.id for site in world.wind_sites]), force=force)
    report = report_of(update)
    if as_json:
        typer.echo(json_text(report))
    else:
        tell(report, output)


def _measured(logs: list[Path], columns: Path | None, asked: ReplayOptions) -> list[WindObservation]:
    """Measurements of all logs; those of a log given again count once."""
    seen: dict[tuple[float, ...], WindObservation] = {}
    for path in logs:
        told: dict[tuple[float, ...], WindObservation] = {
            (one.time_s, one.lat_deg, one.lon_deg, one.north_mps, one.east_mps): one
            for one in _observations(path, columns, asked)
        }
        again = len(told.keys() & seen.keys())
        if again:
            typer.echo(f"skyway: {path}: {counted(again, 'measurement')} as in an earlier log: counted once", err=True)
        seen |= told
    return list(seen.values())


def _observations(path: Path, columns: Path | None, asked: ReplayOptions) -> list[WindObservation]:
    """What every vehicle of a log measured; nothing is expected of the wind, so that no forecast counts twice."""
    from skyway.link.replay.replay import replay

    log = open_any(path, columns)
    log_options.refuse_wrong_units(log, path, "wrong_time")
    log_options.dated(log, path, "a log with GPS time, or a table whose times are instants (ISO 8601 or POSIX seconds)")
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
    world: Scenario,
    measured: list[WindObservation] | None,
    instant: datetime | None,
    hours: int,
    base: list[Path] | None,
    slot_s: float,
) -> Update:
    from skyway.models.wind.estimation.assimilation import assimilated
    from skyway.models.wind.estimation.field import ResidualModel
    from skyway.models.wind.triangle import height_factor
    from skyway.planner.parameters.planner import USUAL

    seen = measured or []
    if not seen and instant is None:
        raise InputError("no time is known for the forecast", remedy="give logs with measured wind, or --depart")
    depart_s = max(one.time_s for one in seen) if instant is None else instant.timestamp()
    kept = _usable(world, seen, depart_s)
    if measured is not None and not kept:
        why = "no wind could be estimated from the logs" if not seen else "no measurement of the logs counts"
        raise InputError(f"{why} for a departure at {date_clock(from_posix(depart_s), named=True)}", remedy=REMEDY)
    begin = from_posix(min([depart_s, *(one.time_s for one in kept)]))
    span_h = hours + math.ceil((depart_s - begin.timestamp()) / 3600.0)
    if base:
        before = _at_sites(world, world.forecast_from(base, begin, span_h))
    else:
        day = from_posix(depart_s).astimezone(ZoneInfo(world.timezone)).date()
        before = _at_sites(world, world.forecast(begin, span_h, truth=day))
    exponent = world.rules.wind_profile_exponent
    level = tuple(one.at_height(before.height_m, exponent) for one in kept)
    field = world.field_error.at_height(float(height_factor(before.height_m, world.measured_at_m, exponent)))
    residual = ResidualModel(tau_s=USUAL.online.residual_tau_s)
    least = USUAL.online.least_members
    after = assimilated(before, level, field, residual, slot_s=slot_s, least_members=least)
    return Update(world, depart_s, before, after, level)


def _usable(world: Scenario, seen: list[WindObservation], depart_s: float) -> list[WindObservation]:
    """Return the measurements that count: none after the departure, none old, none far; the others are reported."""
    from skyway.models.wind.observed.conditioning import FUTURE_S

    late, old = "after the departure", f"more than {OLDEST_H:g} h before the departure"
    far = f"more than {distance_text(log_options.FAR_M)} from every wind site"
    kept: list[WindObservation] = []
    left_out = dict.fromkeys((late, old, far), 0)
    for one in seen:
        if one.time_s > depart_s + FUTURE_S:
            left_out[late] += 1
        elif depart_s - one.time_s > 3600.0 * OLDEST_H:
            left_out[old] += 1
        elif _distance_m(world, one) > log_options.FAR_M:
            left_out[far] += 1
        else:
            kept.append(one)
    for reason, count in left_out.items():
        if count:
            typer.echo(f"skyway: {counted(count, 'measurement')} {reason}: ignored", err=True)
    return kept


def _at_sites(world: Scenario, ensemble: WindEnsemble) -> WindEnsemble:
    """Return a forecast for the sites of a scenario, at the height of their instruments."""
    import numpy as np

    if ensemble.lattice is None:
        return ensemble
    lat, lon = (np.array([getattr(site, part) for site in world.wind_sites]) for part in ("lat", "lon"))
    return ensemble.at_sites(lat, lon).at_height(world.measured_at_m, world.rules.wind_profile_exponent)


def _distance_m(world: Scenario, one: WindObservation) -> float:
    from skyway.models.base.geodesy import distance_m

    return min(distance_m(one.lat_deg, one.lon_deg, site.lat, site.lon) for site in world.wind_sites)


weather = typer.Typer(
    help="Show, verify and fetch weather forecasts: GRIB, NetCDF, Open-Meteo, METAR and TAF, CSV.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Files = Annotated[list[Path], typer.Argument(help="Weather files, in any format; files of one forecast are combined.")]


@weather.command("show")
def show(
    files: Files,
    scenario: log_options.ScenarioName = None,
    depart: Annotated[
        str | None, typer.Option(help="Approximate time of METARs and TAFs, which have no month. Default: now.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Show the contents of weather files: fields, heights, grid, members, issue and valid times, gaps.

    ``skyway weather FILE …`` does the same. With a scenario, grids are cut to its region; with a departure, the command also shows the forecast that a plan would use, or why it cannot.

    Examples
    --------
      skyway weather hrrr.t12z.wrfsfcf0*.grib2
      skyway weather ensemble.json --scenario my-scenario
    """
    from skyway.cli.views.weather import print_weather, weather_report
    from skyway.models.weather.readers.reading import read_weather
    from skyway.models.weather.region_files import listed
    from skyway.models.weather.weather import Box
    from skyway.models.wind.history import station_places

    near_s = typed_values.parse_depart(depart).timestamp()
    box, stations = None, {}
    if scenario is not None:
        world = log_options.load_named(scenario)
        box = Box.around(world.network.lat, world.network.lon)
        stations = station_places(world.wind_sites)
    found = read_weather(listed(files), box, near_s=near_s, stations=stations)
    report = weather_report(found)
    if as_json:
        typer.echo(json_text(report, indent=1))
        return
    print_weather(found, report)
    if scenario is not None and depart is not None:
        ready = world.forecast_from(files, from_posix(near_s), hours=24)
        typer.echo(f"for {world.name} from {date_clock(from_posix(near_s), named=True)} on: {ready!r}")
        for note in ready.notes:
            typer.echo(f"Note: {note}")


@weather.command("verify")
def verify(
    files: Files,
    observed: Annotated[
        str | None,
        typer.Option(
            help="Observations: METARs, or a table as for plan --observed. Default: the scenario's wind record."
        ),
    ] = None,
    scenario: log_options.ScenarioName = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Write the learnt error by lead time, for plan --forecast-error: FILE.json."
        ),
    ] = None,
    plot: options.Plot = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Compare forecasts with observations by lead time, and learn their error.

    Bias, RMSE, CRPS, and the spread of members against the error of their mean. The learnt error is a calibration of the members (EMOS).

    Examples
    --------
      skyway weather verify forecasts/ --observed metars.txt --scenario my-scenario -o error.json --plot error.svg
      skyway plan my-scenario --forecast forecasts/ --forecast-error error.json --from depot --to clinic --payload 1.2
    """
    from skyway.cli.views.weather import VerificationReport, print_verification
    from skyway.models.base.files import write_atomically
    from skyway.models.weather.lead_error import lead_error_text
    from skyway.models.weather.readers.reading import read_weather
    from skyway.models.weather.region_files import listed
    from skyway.models.weather.verification import learn, pairs_of, scores
    from skyway.models.wind.history import station_places

    options.refuse_overwriting(output, plot, force=force)
    options.check_picture(plot)
    world = log_options.load_named(scenario)
    paths = listed(files)
    found = read_weather(
        paths, near_s=_near_s(observed), stations=station_places(world.wind_sites), height_m=world.measured_at_m
    )
    seen = _seen(world, observed, float(found[0].times_s[0]))
    pairs = pairs_of([one for one in found if one.form != "METAR"], seen, world.rules.wind_profile_exponent)
    source = f"learnt from {len(pairs):,} comparisons ({', '.join(dict.fromkeys(one.model for one in found))})"
    heights = [one.height_m for one in seen if math.isfinite(one.height_m)]
    learnt = learn(pairs, source, heights[0] if heights else world.measured_at_m)
    report = VerificationReport(pairs=len(pairs), leads=tuple(scores(pairs)), learnt=learnt)
    if output is not None:
        write_atomically(output, lead_error_text(learnt), force=force)
    if plot is not None:
        from skyway.plots.verification import plot_verification

        plot_verification(report.leads, plot)
    options.say_written(output, plot)
    if as_json:
        typer.echo(json_text(report, indent=1))
        return
    print_verification(report)


def _near_s(observed: str | None) -> float | None:
    """What TAFs without a month are near to: the date that a file of observations begins with, else now."""
    if observed is None or not Path(observed).is_file():
        return None
    from skyway.models.base.files import read_text
    from skyway.models.base.units import parse_instant

    for word in read_text(Path(observed), max_bytes=4 * 1024 * 1024)[:4000].replace(",", " ").split():
        try:
            return parse_instant(word).timestamp()
        except InputError:
            continue
    return None


def _seen(world: Scenario, observed: str | None, near_s: float) -> list[WindObservation]:
    """What was observed: in a file, or the scenario's record."""
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.models.wind.observed.reading import read_observed

    if observed is not None:
        told = read_observed(observed, world.wind_sites, world.measured_at_m, near_s)
        return [one.observation for one in told.winds if one.from_deg is not None]
    record = world.history
    if record is None:
        raise InputError("the scenario has no wind record", world.path, remedy="give observations with --observed")
    return [
        WindObservation(record.start_s + (slot + 0.5) * record.slot_s, site.lat, site.lon, float(record.north[slot, k]), float(record.east[slot, k]), 1.0, record.measured_at_m)
        for slot in range(len(record)) if record.complete[slot] for k, site in enumerate(record.sites)
    ]  # fmt: skip


def _providers() -> list[str]:
    """Names of services, for completion."""
    from skyway.fetching.providers import PROVIDERS

    return list(PROVIDERS)


@weather.command("fetch")
def fetch(
    provider: Annotated[
        str,
        typer.Option(
            help="Service: open-meteo, open-meteo-ensemble, hrrr, gfs, gefs, ifs-ensemble, taf.",
            autocompletion=_providers,
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write: JSON, GRIB or text, as the service gives it.")
    ],
    region: Annotated[
        str | None, typer.Option("--region", help="Scenario that gives the region (newyork: built in).")
    ] = None,
    hours: Annotated[int, typer.Option(help="Hours from the departure on.", min=1, max=120)] = 12,
    depart: Annotated[str | None, typer.Option(help="Departure with UTC offset. Default: now.")] = None,
    server: Annotated[str | None, typer.Option(help="Another server with the service's interface: https://…")] = None,
    api_key: Annotated[
        str | None,
        typer.Option(help="Key of a paid service of Open-Meteo.", envvar="SKYWAY_WEATHER_API_KEY", show_envvar=True),
    ] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Neither store nor use cached parts of files.")] = False,
    force: options.Force = False,
) -> None:
    """Fetch a forecast for the region of a scenario, and show its licence.

    Only this command contacts a weather service. From GRIB files it fetches only the fields in use, by their index.

    Examples
    --------
      skyway weather fetch --provider open-meteo --region my-scenario --hours 12 -o today.json
      skyway weather fetch --provider hrrr --region newyork --hours 6 -o hrrr.grib2
    """
    from skyway.fetching.client import Client, cache_folder
    from skyway.fetching.providers import PROVIDERS, Wanted
    from skyway.models.base.files import write_atomically
    from skyway.models.weather.readers.reading import read_weather
    from skyway.models.weather.weather import Box
    from skyway.models.wind.history import station_places

    if provider not in PROVIDERS:
        raise InputError(
            "no such provider", field="--provider", value=provider, remedy=f"one of {', '.join(PROVIDERS)}"
        )
    options.refuse_overwriting(output, force=force)
    chosen, world = PROVIDERS[provider], log_options.load_named(region)
    begin = typed_values.parse_depart(depart)
    box = Box.around(world.network.lat, world.network.lon)
    stations = tuple(name for name in station_places(world.wind_sites) if len(name) == 4)
    wanted = Wanted(box, begin, hours, stations, api_key=api_key)
    typer.echo(f"{provider} ({chosen.about}): {chosen.licence}", err=True)
    client = Client(None if no_cache else cache_folder())
    data = chosen.fetch(client, wanted, (server or chosen.server).rstrip("/"))
    write_atomically(output, data, force=force)
    kept = f", {client.cached} parts from the cache" if client.cached else ""
    typer.echo(f"wrote {output}: {len(data) / 1e6:.1f} MB, {client.requests} requests{kept}", err=True)
    found = read_weather([output], box, near_s=begin.timestamp(), stations=station_places(world.wind_sites))
    for one in found:
        one.needs_wind()
        if one.times_s[-1] < begin.timestamp() + hours * 3600.0 - 1.0:
            typer.echo(
                f"skyway: the forecast ends at {date_clock(from_posix(float(one.times_s[-1])), named=True)}", err=True
            )
