"""Command ``fly``."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zoneinfo import ZoneInfo

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.commands.aboard.supervised import supervised
from skyway.cli.connection_options import Link
from skyway.cli.option_groups import with_groups
from skyway.cli.request_options import OBSERVED_HELP
from skyway.cli.seen_options import Seen
from skyway.models.base.errors import InputError
from skyway.models.composition.release import Release

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.flights.resuming import Begun
    from skyway.link.supervisor import DeliveryJob
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.composition.composition import Composition
    from skyway.models.drones.drag import DragModel
    from skyway.models.scenario.scenario import Scenario
    from skyway.now import LiveWinds
    from skyway.recharge.made_of import OpenedSet


@with_groups
def fly(
    plan: Annotated[
        Path, typer.Argument(help="Plan, as written by skyway plan -o; or the folder that skyway recharge -o wrote.")
    ],
    link: Link,
    seen: Seen,
    pads: Annotated[
        str, typer.Option(help="Pad service tcp:HOST:PORT, or manual: people charge the drone.")
    ] = "manual",
    manual: Annotated[bool, typer.Option("--manual", help="Ask for confirmation before each take-off.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Take off without asking. For simulations.")] = False,
    journal: Annotated[
        Path | None, typer.Option(help="Journal to write. Default: a new file in the folder of --record.")
    ] = None,
    resume: Annotated[Path | None, typer.Option(help="Continue the delivery of this journal.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report when the flight ends: FILE.html.")] = None,
    drag: Annotated[
        Path | None, typer.Option(help="Drag of the drone, from skyway calibrate wind: wind is estimated from tilt.")
    ] = None,
    scenario: Annotated[Path | None, typer.Option(help="Scenario folder. Default: the one named in the plan.")] = None,
    zones: options.Zones = None,
    forecast: Annotated[
        list[Path] | None,
        typer.Option(help="Weather forecast in any format, or a folder; repeatable. Default: the scenario's forecast."),
    ] = None,
    wind: Annotated[
        str | None, typer.Option(help="One constant wind at cruise height instead of a forecast: 8@270.")
    ] = None,
    observed: Annotated[list[str] | None, typer.Option(help=OBSERVED_HELP)] = None,
    planner: Annotated[
        str, typer.Option("--planner", hidden=True, help="No longer used: one online policy decides.")
    ] = "",
    no_replan: Annotated[bool, typer.Option("--no-replan", help="Fly the plan unchanged; never replan.")] = False,
    release: Annotated[
        Release | None,
        typer.Option(help="How the package is released. Default: as planned; in the air only where planned so."),
    ] = None,
    elevation: Annotated[
        list[str] | None, typer.Option(help="STATION=METRES: ground height that the plan lacks; repeatable.")
    ] = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    keep_parameters: Annotated[
        bool, typer.Option("--keep-parameters", help="Set no parameters; stop if one is unsuitable.")
    ] = False,
    no_restore: Annotated[
        bool, typer.Option("--no-restore", help="Leave changed parameters as they are at the end.")
    ] = False,
    fetch_log: Annotated[
        bool,
        typer.Option(
            "--fetch-log",
            help="Fetch the logs of the flight from the vehicle when it has ended, into the folder of --record.",
        ),
    ] = False,
    orders: Annotated[
        Path | None,
        typer.Option(
            help="Read the operator's commands from this file, FILE.orders, instead of the terminal (used by skyway serve)."
        ),
    ] = None,
    vehicle: Annotated[
        Literal["multirotor", "helicopter"] | None,
        typer.Option(
            help="Kind of the vehicle, if it does not report it; without it such a vehicle does not take off."
        ),
    ] = None,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
) -> None:
    """Fly a plan leg by leg, or a cut mission battery by battery, measure the wind on the way, and replan if that is better.

    Before each leg skyway runs the preflight checks, uploads the mission and reads it back; every point of the route has a
    divert station. Parameters to be set are listed with the request for take-off: once, or before each take-off with --manual. They
    are restored at the end. Everything is written to a journal; --resume continues an interrupted flight. Ctrl-C stops the
    delivery on the ground, or at the next landing; pressed twice in the air, skyway stops commanding the vehicle. In the air it
    accepts the commands pause, go, stay, divert STATION, return, land, undelivered, leave.

    Examples
    --------
      skyway fly flights --connect udpin:127.0.0.1:14540
      skyway fly plan.json --connect udpin:127.0.0.1:14540 --pads tcp:127.0.0.1:5790 --drag drag.toml
      skyway fly plan.json --connect /dev/ttyUSB0,57600 --pads manual --manual
      skyway fly plan.json --connect tcp:127.0.0.1:5760 --pads tcp:127.0.0.1:5790 --resume recordings/delivery.jsonl
    """
    from skyway import flying
    from skyway.flights.resuming import begun_in
    from skyway.link.pads import TcpPads
    from skyway.link.supervisor import DeliveryJob
    from skyway.link.vehicle.health_book import HealthBook
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.models.base.units import from_posix
    from skyway.models.composition.file import load
    from skyway.models.drones.drag_file import read_drag
    from skyway.models.scenario.air import fleet_in_air
    from skyway.models.scenario.remote_id import NOBODY
    from skyway.models.weather.region_files import check_files

    _refuse_together(
        manual=manual, yes=yes, journal=journal, resume=resume, keep=keep_parameters, no_restore=no_restore
    )
    options.refuse_overwriting(journal, report, force=False)
    begun = None if resume is None else begun_in(resume)
    drag_model = None if drag is None else read_drag(drag)
    how: dict[str, Any] = {
        "replanning": not no_replan,
        "parameters": typed_values.planner_parameters(settings),
        "asking": "never" if yes else "each" if manual else "once",
        "set_parameters": not keep_parameters,
        "restore_parameters": not no_restore,
        "traffic": seen.rule(),
        "vehicle_kind": vehicle,
    }
    service = None if pads == "manual" else TcpPads(pads)  # people tend the pads, or a service does
    if plan.is_dir():
        _refuse_of_delivery(scenario=scenario, terrain=terrain, obstacles=obstacles, zones=zones, elevation=elevation)
        cut, work_at = _work(plan, wind, forecast, observed, drag_model, how, begun)
        if yes and service is None and cut.found.plan.stops:
            problem = "--yes and --pads manual exclude each other, since nobody could confirm the charging"
            raise InputError(problem, field="--pads", value=pads, remedy="give --pads tcp:HOST:PORT, or remove --yes")
        region = cut.region
        how["remote_id"] = seen.remote_id(NOBODY if region is None else region.remote_id)
        how["health"] = HealthBook(link.record, None if region is None else ZoneInfo(region.timezone))
        supervised(
            link,
            work_at,
            service,
            orders,
            journal,
            resume,
            report,
            region,
            yes=yes,
            fetch_log=fetch_log,
            as_json=as_json,
        )
        return
    composition = load(plan)
    if begun is not None:
        begun.refuse_other_delivery(composition)
    region = flying.scenario_of(composition, scenario, terrain, obstacles, zones or ())
    who = seen.remote_id(region.remote_id)
    how["health"] = HealthBook(link.record, ZoneInfo(region.timezone))
    if yes:
        _refuse_questions(composition, pads, flying.release_of(composition, release))
    _check_words(planner, wind, forecast)
    request = flying.request_of(composition, region)
    flying.refuse_closed(region, composition.destination)
    if forecast:
        check_files(region, forecast, composition.depart)
    made_with = MissionOptions(
        release=flying.release_of(composition, release),
        elevation_m=flying.heights(region, elevation),
        over=region.network.over,
    )

    def job(now: datetime, craft: Vehicle) -> DeliveryJob:  # noqa: ARG001  any vehicle flies a plan
        winds = _observed(region, observed, now, wind)
        times = (one.time_s for one in winds(now.timestamp()))
        since = now if begun is None else begun.at
        begin = min([since.timestamp(), *times]) if not forecast else None
        known = typed_values.wind_forecast(
            region, since if begin is None else from_posix(begin), wind, forecast, None, None
        )
        return DeliveryJob(
            composition=composition,
            scenario=fleet_in_air(region, known, since.timestamp()),
            request=request,
            forecast=known,
            observed=winds,
            options=made_with,
            drag=drag_model,
            remote_id=who,
            **how,
        )

    supervised(
        link, job, service, orders, journal, resume, report, region, yes=yes, fetch_log=fetch_log, as_json=as_json
    )


def _work(
    folder: Path,
    wind: str | None,
    forecast: list[Path] | None,
    observed: list[str] | None,
    drag: DragModel | None,
    how: dict[str, Any],
    begun: Begun | None,
) -> tuple[OpenedSet, Callable[[datetime, Vehicle], DeliveryJob]]:
    """Open the folder of a cut mission; returns it, and what makes it a job."""
    from skyway.recharge.flying.work_job import WorkAsked, work_of_set
    from skyway.recharge.made_of import opened
    from skyway.recharge.output import identity_of

    if wind is not None:
        typed_values.parse_wind(wind)
    cut = opened(folder)
    if begun is not None:
        begun.refuse_other_set(identity_of(cut.found))

    def seen(region: Scenario, now: datetime) -> LiveWinds:
        return _observed(region, observed, now, wind)

    asked = WorkAsked(wind=wind, forecast=forecast, observed=seen, drag=drag, how=how)
    return cut, lambda now, vehicle: work_of_set(cut, vehicle, now, asked)


def _refuse_of_delivery(**given: object) -> None:
    """Refuse options that a cut mission has settled already."""
    for name, value in given.items():
        if value:
            remedy = "remove it, or give it to skyway recharge"
            raise InputError("is set when the mission is cut", field=f"--{name}", remedy=remedy)


def _observed(region: Scenario, given: list[str] | None, now: datetime, wind: str | None) -> LiveWinds:
    """Winds observed; the scenario's own where nobody named any and the clock is that of now."""
    from skyway.now import NOW_S, LiveWinds

    if given and wind is not None:
        remedy = "remove one of them: a constant wind needs no observations"
        raise InputError("--wind and --observed exclude each other", remedy=remedy)
    live = abs((now - datetime.now(UTC)).total_seconds()) <= NOW_S
    unasked = not given and live and wind is None
    chosen = region.observed_wind if unasked else given or ()
    return LiveWinds(region, chosen, now, asked=not unasked, tell=lambda note: typer.echo(f"skyway: {note}", err=True))


def _refuse_together(
    *, manual: bool, yes: bool, journal: Path | None, resume: Path | None, keep: bool, no_restore: bool
) -> None:
    """Refuse options that contradict each other."""
    if manual and yes:
        raise InputError("--manual and --yes exclude each other", remedy="give one of them")
    if resume is not None and journal is not None:
        raise InputError("--journal and --resume exclude each other", remedy="a resumed journal is continued")
    if keep and no_restore:
        remedy = "--keep-parameters sets no parameters, so there are none to restore"
        raise InputError("--keep-parameters and --no-restore exclude each other", remedy=remedy)


def _refuse_questions(composition: Composition, pads: str, release: str) -> None:
    """With --yes nobody is listened to: refuse what could only be answered by a person, and would be waited for."""
    charges = [stop.station for stop in composition.stops if stop.recharge_s > 0.0]
    if pads == "manual" and charges:
        problem = f"--yes and --pads manual exclude each other, since nobody could confirm the charging at {', '.join(charges)}"
        raise InputError(problem, field="--pads", value=pads, remedy="give --pads tcp:HOST:PORT, or remove --yes")
    if release == "hand":
        problem = (
            "--yes and --release hand exclude each other, since nobody could confirm that the package was taken off"
        )
        raise InputError(problem, field="--release", value=release, remedy="give --release gripper, or remove --yes")


def _check_words(planner: str, wind: str | None, forecast: list[Path] | None) -> None:
    """Find out before a vehicle is spoken with what would fail in the midst of a delivery."""
    from skyway.planner.registry import CLAIRVOYANT_PLANNERS, PLANNERS

    known = [name for name in PLANNERS if wind is not None or name not in CLAIRVOYANT_PLANNERS]
    if planner and planner not in known:
        problem = (
            "needs perfect information about the wind, which a flight does not have"
            if planner in PLANNERS
            else "no such planner"
        )
        raise InputError(problem, field="--planner", value=planner, remedy=f"one of {', '.join(known)}")
    if wind is not None:
        typed_values.parse_wind(wind)
    for one in forecast or ():
        if not one.exists():
            raise InputError("no such file", str(one), field="--forecast")
