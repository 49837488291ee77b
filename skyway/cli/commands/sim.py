"""Command ``sim``."""

from __future__ import annotations

import json
import re
import signal
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from skyway import typed_values
from skyway.cli import options, typed_words
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text
from skyway.scenarios import load_scenario
from skyway.sim_stub.autopilot import NAMES

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from skyway.models.network.station import Station
    from skyway.models.scenario.scenario import Scenario
    from skyway.sim_stub.plant.wind_truth import WindTruth
    from skyway.sim_stub.transports.channel import Impairment
    from skyway.sim_stub.transports.loop import SocketLoop
    from skyway.sim_stub.world import Event, World

BARE = typed_words.BARE["sim"]
DEFAULT_CONNECT = "udpout:127.0.0.1:14540"
CONNECT_HELP = (
    f"udpout:, udpin:, tcp: or tcpin:HOST:PORT; repeatable. Without it, and without --tcp: {DEFAULT_CONNECT}."
)
WIND_HELP = "The wind: 8@270 (m/s@degrees FROM), a day of the record, or a forecast file. Default: calm."
FAULT_HELP = (
    "KIND[=VALUE][@START][+DURATION][#SYSTEM], such as link-loss@60s+20s, or link-loss@T+60s+20s: 60 s after "
    "take-off; repeatable. See docs/reference/sim.md."
)

_MOST_LOG_BYTES = 200e6
LOG_ROOM_BYTES = 200_000_000
"""For logs of the flights of all vehicles: an hour of one takes some 3 MB."""


def sim(
    scenario: options.ScenarioArgument = None,
    vehicles: Annotated[int, typer.Option(help="Number of vehicles.")] = 1,
    at: Annotated[
        list[str] | None,
        typer.Option(help="Initial places of the vehicles: station or lat,lon; repeatable, used in turn."),
    ] = None,
    autopilot: Annotated[options.FamilyName, typer.Option(help="Autopilot to simulate.")] = NAMES[0],
    firmware: Annotated[
        str, typer.Option(help="Firmware version, such as 1.16, main or 4.7. Default: a common release.")
    ] = "",
    connect: Annotated[list[str] | None, typer.Option(help=CONNECT_HELP)] = None,
    tcp: Annotated[
        int | None, typer.Option(help="Listen on this TCP port; each further vehicle uses the port 10 higher.")
    ] = None,
    pads: Annotated[str | None, typer.Option(help="Serve the pads: tcp:HOST:PORT.")] = None,
    speedup: Annotated[float, typer.Option(help="Simulated seconds per second, up to 20.")] = 1.0,
    pad_speedup: Annotated[
        float | None,
        typer.Option(help="Simulated seconds per second while all vehicles are on the ground, up to 2000."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Random seed of gusts, errors, queues and packet loss.")] = 1,
    system: Annotated[int, typer.Option(help="System id of the first vehicle.")] = 1,
    wind: Annotated[str | None, typer.Option(help=WIND_HELP)] = None,
    depart: Annotated[str | None, typer.Option(help="Start of simulated time, with UTC offset. Default: now.")] = None,
    soc: Annotated[float, typer.Option(help="Charge at the start, percent.")] = 100.0,
    payload: Annotated[float, typer.Option(help="Mass of the package on board, kg.")] = 0.0,
    warm: Annotated[
        bool, typer.Option("--warm", help="Vehicles have been on for a while and are ready to arm.")
    ] = False,
    traffic: Annotated[bool, typer.Option(help="Simulate other drones at the pads.")] = True,
    loss: Annotated[float, typer.Option(help="Share of packets lost, 0-1.")] = 0.0,
    delay: Annotated[float, typer.Option(help="Delay of each packet, each way, s.")] = 0.0,
    jitter: Annotated[
        float, typer.Option(help=f"Largest additional random delay, s; without a value: {BARE['--jitter']}.")
    ] = 0.0,
    duplicate: Annotated[
        float, typer.Option(help=f"Share of packets duplicated, 0-1; without a value: {BARE['--duplicate']}.")
    ] = 0.0,
    reorder: Annotated[
        float, typer.Option(help=f"Share of packets reordered, 0-1; without a value: {BARE['--reorder']}.")
    ] = 0.0,
    rate: Annotated[
        float, typer.Option(help="Data rate of the link, each way, bytes/s, such as 5760 for a 57600 baud radio.")
    ] = 0.0,
    logs: Annotated[
        list[str] | None,
        typer.Option(
            "--log",
            help="A log of an earlier flight on the card, of this size: 300kB, 2MB; repeatable. Each flight adds its own.",
        ),
    ] = None,
    fault: Annotated[list[str] | None, typer.Option(help=FAULT_HELP)] = None,
    operator_control: Annotated[
        bool,
        typer.Option(
            "--operator-control", help="The vehicles report which ground station is in control (CONTROL_STATUS)."
        ),
    ] = False,
    remote_id: Annotated[bool, typer.Option("--remote-id", help="The vehicles have a Remote ID module.")] = False,
    parameter: Annotated[list[str] | None, typer.Option(help="NAME=VALUE set on every vehicle; repeatable.")] = None,
    lasting: Annotated[float | None, typer.Option("--duration", help="End after this simulated time, s.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Simulate vehicles, pads and wind. On the link the vehicles behave like real ones.

    Every vehicle has its own system id. Each printed line is one event. Ctrl-C ends the simulation.

    Examples
    --------
      skyway sim --vehicles 5 --at bellevue
      skyway sim --autopilot ardupilot --tcp 5760 --wind 8@270
      skyway sim --at bellevue --wind 2013-07-10 --depart 2013-07-10T14:00-04:00 --pads tcp:127.0.0.1:5790
      skyway sim flights --tcp 5760 --pads tcp:127.0.0.1:5790 --warm --wind 6@250
      skyway sim --loss 0.1 --delay 0.02 --jitter --duplicate --reorder
      skyway sim --fault gust@T+120s --fault battery-sag --fault link-loss@T+60s+20s --fault gps@5m+10s#2
    """
    from skyway.sim_stub.faults import parse_fault
    from skyway.sim_stub.fleet import FleetOptions, build_world, serve
    from skyway.sim_stub.transports.urls import parse_address

    if lasting is not None and not lasting > 0.0:
        raise InputError("out of range", field="--duration", value=lasting, remedy="seconds, above 0")
    begins = typed_values.parse_depart(depart)
    region, starts = _region(scenario)
    known, places = _placed(region, at) if at or not starts else (region, starts)
    vehicles = max(vehicles, 1 if at else len(starts))
    asked = FleetOptions(
        stations=tuple({one.id: one for one in (*known.network.stations, *starts)}.values()),
        places=places,
        vehicles=vehicles,
        first_system=system,
        autopilot=autopilot,
        firmware=firmware,
        drone=known.drones[0] if known.drones else None,
        soc=typed_values.percent(soc, "--soc"),
        payload_kg=payload,
        seed=seed,
        warm=warm,
        epoch_s=begins.timestamp(),
        wind=_wind(known, begins, wind),
        load=known.load if traffic else None,
        faults=tuple(parse_fault(text) for text in fault or ()),
        operator_control=operator_control,
        remote_id=remote_id,
        parameters=tuple(_parameter(text) for text in parameter or ()),
        logs=tuple(_bytes(text) for text in logs or ()),
        log_room_bytes=LOG_ROOM_BYTES,
    )
    if tcp is not None and not 0 <= tcp + 10 * (vehicles - 1) <= 65535:
        raise InputError("port out of range", field="--tcp", value=tcp, remedy="0 to 65535 for all vehicles")
    addresses = connect or ([] if tcp is not None else [DEFAULT_CONNECT])
    world = build_world(asked, _print_json if as_json else typer.echo)
    loop, listening = serve(
        world,
        connect=tuple(parse_address(text, option="--connect") for text in addresses),
        tcp_port=tcp,
        pads=None if pads is None else parse_address(pads, option="--pads", kinds=("tcp",)),
        impairment=_bad_link(loss, delay, jitter, duplicate, reorder, rate),
        speedup=speedup,
        pad_speedup=pad_speedup,
        seed=seed,
    )
    _run(world, loop, listening, lasting, as_json=as_json)


def _region(folder: Path | None) -> tuple[Scenario, tuple[Station, ...]]:
    """Return a scenario; of the folder of a cut mission its pads, and where its drone or each of its drones stands."""
    from skyway.recharge.made_of import opened, sets_in

    sets = () if folder is None else sets_in(folder)
    if not sets:
        return load_scenario(folder), ()
    from skyway.recharge.flying.places import places_of, region_with, starts_of

    cuts = [opened(one) for one in sets]
    places = places_of(cuts[0].found)
    region = region_with(cuts[0].found, places, cuts[0].region)
    return region, (places.start,) if len(cuts) == 1 else starts_of([one.found for one in cuts])


def _placed(scenario: Scenario, at: list[str] | None) -> tuple[Scenario, tuple[Station, ...]]:
    """Stations where the vehicles stand; a position becomes a separate station."""
    places = []
    for text in at or [scenario.network.stations[0].id]:
        scenario, station_id = typed_values.place(scenario, text, "--at")
        places.append(station_id)
    stations = {station.id: station for station in scenario.network.stations}
    return scenario, tuple(stations[place] for place in places)


def _bad_link(loss: float, delay: float, jitter: float, duplicate: float, reorder: float, rate: float) -> Impairment:
    """What the options say of the link; a wrong one is named as it was typed."""
    from skyway.sim_stub.transports.channel import Impairment

    try:
        return Impairment(loss, delay, jitter, duplicate, reorder, rate)
    except InputError as error:
        raise InputError(
            [replace(f, field=f"--{(f.field or '').removesuffix('_s').removesuffix('_byteps')}") for f in error.faults]
        ) from None


def _bytes(text: str) -> int:
    """Read an amount of data: ``300kB``."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?) ?(B|kB|MB)?", text.strip())
    size = float(found[1]) * {None: 1.0, "B": 1.0, "kB": 1e3, "MB": 1e6}[found[2]] if found is not None else -1.0
    if not 0.0 < size <= _MOST_LOG_BYTES:
        raise InputError("is not the size of a log", field="--log", value=text, remedy="up to 200MB, such as 300kB")
    return int(size)


def _run(world: World, loop: SocketLoop, listening: list[str], lasting: float | None, *, as_json: bool) -> None:
    """Run until the time is over or it is stopped; Ctrl-C is the usual end, not an error."""
    before = {number: signal.signal(number, lambda *_: loop.stop()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for line in listening:
            typer.echo(json.dumps({"listening": line}) if as_json else line)
        loop.run(None if lasting is None else lambda: world.sim_s >= lasting)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if not as_json:
        typer.echo(f"{world.sim_s:10.2f} s  ended")


def _print_json(event: Event) -> None:
    typer.echo(json_text({"sim_s": round(event.sim_s, 3), "system": event.system, "event": event.text}))


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        remedy = "NAME=VALUE, for example WPNAV_SPEED=1500"
        raise InputError("not a parameter", field="--parameter", value=text, remedy=remedy) from None


def _wind(scenario: Scenario, begins: datetime, text: str | None) -> WindTruth | None:
    from skyway.sim_stub.plant.wind_truth import RecordedWind, parse_constant

    if text is None:
        return None
    constant = parse_constant(text)
    if constant is not None:
        return constant
    series, _ = typed_values.true_wind(scenario, begins, text, "--wind")
    return None if series is None else RecordedWind(series)
