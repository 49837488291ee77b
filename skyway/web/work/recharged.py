"""Missions cut at pads, for the recharge page: computed by the functions of ``skyway recharge``."""

from __future__ import annotations

import io
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.missions import family_named, read
from skyway.missions.autopilots import NAMES
from skyway.missions.checks.route import fly
from skyway.models.base.errors import InputError
from skyway.models.base.files import write_atomically
from skyway.models.network.files import read_stations, stations_csv
from skyway.models.network.station import Station
from skyway.recharge.asking import Asked, options_of, pads_of, region_of, stands_of, with_home
from skyway.recharge.made_of import MadeOf, texts_of
from skyway.recharge.output import names_of, write_folder
from skyway.recharge.recharged import recharged
from skyway.recharge.simulated import simulated
from skyway.recharge.summary import RechargeSummary, summary_of
from skyway.web.work.question import OF_SCENARIO, Cut, number

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario
    from skyway.recharge.cutting import Recharged

MOST_PADS = 2000
"""That are drawn."""


def _asked(question: Cut, scenario: str | None, pads: Path | None) -> Asked:
    """Return the form of ``skyway recharge``."""
    return Asked(
        pads=Path(scenario or "newyork") if question.pads == OF_SCENARIO else pads,
        vans=Path(question.vans) if question.vans else None,
        drone=question.drone or None,
        wind=question.wind.strip() or None,
        depart=question.depart.strip() or None,
        payload_kg=number(question.payload, "--payload"),
        soc_percent=number(question.soc, "--soc"),
        reserve_percent=number(question.reserve, "--reserve"),
        level_ground=question.level_ground,
        home=question.home.strip() or None,
        home_elevation_m=number(question.home_elevation, "--home-elevation")
        if question.home_elevation.strip()
        else None,
        laps=_whole(question.laps, "--laps"),
        packs=_whole(question.packs, "--packs") if question.packs.strip() else None,
        chargers=_whole(question.chargers, "--chargers") if question.chargers.strip() else None,
        swap_s=number(question.swap, "--swap") if question.swap.strip() else None,
        reorder=question.reorder,
    )


def _whole(text: str, option: str) -> int:
    """Return a whole number as typed."""
    value = number(text, option)
    if value != int(value):
        raise InputError("is not a whole number", field=option, value=text)
    return int(value)


def places(scenario: str | None, told: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the pads of a request for the map, including moved and new ones."""
    question = msgspec.convert(told, Cut)
    if question.pads == OF_SCENARIO:
        region = region_of(_asked(question, scenario, None))
        stations: tuple[Station, ...] = () if region is None else region.network.stations
    else:
        stations = _stations(question)
    return [
        {"id": one.id, "lat": one.lat, "lon": one.lon, "pads": one.pads}
        for one in stations[:MOST_PADS]
        if one.pads and not one.flyover
    ]


def _stations(question: Cut) -> tuple[Station, ...]:
    """Return the pads of a file with their moves, and new ones; at a chosen place the height of the ground is unknown."""
    if question.pads == OF_SCENARIO:
        raise InputError("the pads of a scenario stay where they are", field="--pads", remedy="take a file of stations")
    known = {one.id: one for one in read_stations(Path(question.pads))} if question.pads else {}
    for put in question.put:
        if put.id in known:
            known[put.id] = replace(known[put.id], lat=put.lat, lon=put.lon, elevation_m=None)
        else:
            known[put.id] = Station(put.id, put.id, put.lat, put.lon, pads=1, holding_spots=0)
    return tuple(known.values())


def shown(scenario: str | None, told: dict[str, Any]) -> dict[str, Any]:
    """Cut a mission, and return the data for the page. Raises an `InputError` with the obstacle."""
    question = msgspec.convert(told, Cut)
    with tempfile.TemporaryDirectory() as folder:
        found, summary, _, _ = _made(question, scenario, _pads_file(question, Path(folder)))
    return _document(found, summary)


def saved(scenario: str | None, told: dict[str, Any], root: str, folder: str, pads: str) -> list[str]:
    """Write the folder of a cut mission into another, and the file of its pads if any was moved; return the written files."""
    question = msgspec.convert(told, Cut)
    written = []
    if question.put:
        write_atomically(Path(root) / pads, stations_csv(_stations(question)))
        written.append(pads)
    path = Path(root) / pads if question.put else Path(question.pads) if question.pads else None
    found, summary, made_of, region = _made(question, scenario, path)
    write_folder(found, summary, Path(root) / folder, beside=lambda texts: texts_of(made_of, region, texts))
    return [*written, folder]


def packed(scenario: str | None, told: dict[str, Any], name: str) -> bytes:
    """Return the folder of a cut mission as a ZIP file."""
    content = io.BytesIO()
    with tempfile.TemporaryDirectory() as root, zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as packing:
        saved(scenario, told, root, name, f"{name}-pads.csv")
        for path in sorted(Path(root).rglob("*")):
            if path.is_file():
                packing.write(path, path.relative_to(root))
    return content.getvalue()


def _pads_file(question: Cut, folder: Path) -> Path | None:
    """Return the file of the pads: the named one, or one with the moved pads."""
    if not question.put:
        return Path(question.pads) if question.pads else None
    path = folder / "pads.csv"
    write_atomically(path, stations_csv(_stations(question)))
    return path


def _made(
    question: Cut, scenario: str | None, pads: Path | None
) -> tuple[Recharged, RechargeSummary, MadeOf, Scenario | None]:
    """Cut a mission as ``skyway recharge`` does."""
    asked, mission = _asked(question, scenario, pads), Path(question.mission)
    document = with_home(read(mission), asked)
    region = region_of(asked)
    stands = stands_of(asked)
    zones = None if region is None else region.network.zones
    options = options_of(asked, document, region, zones, stands)
    families = [family_named(name) for name in ((question.autopilot,) if question.autopilot else NAMES)]
    found = recharged(document, pads_of(asked, region, stands), families, options)
    summary = summary_of(found, simulated(found), mission.name, names_of(found))
    return found, summary, MadeOf(asked=asked, mission=mission, autopilot=question.autopilot or None), region


def _document(found: Recharged, summary: RechargeSummary) -> dict[str, Any]:
    """Flights as lines, bars and charge, in addition to the output of ``skyway recharge``."""
    bars, legs, lines = [], [], []
    for flight, made in zip(summary.flights, found.told, strict=True):
        steps = fly(made.document.mission, autopilot=family_named(next(iter(found.flights)))).steps
        lines.append([[one.point.lat, one.point.lon] for one in steps])
        lands = flight.depart_s + flight.flight_s
        where = flight.stay.pad if flight.stay else "the end"
        bars.append({"kind": "fly", "begin_s": flight.depart_s, "end_s": lands, "where": f"battery {flight.number}"})
        ends = {"from": f"battery {flight.number}", "to": where, "fan": None, "back": False}
        legs.append(ends | {"typical": [flight.soc_start, flight.soc_end]})
        if flight.stay is not None:
            stay = flight.stay
            charges = stay.leave_s - stay.charge_s
            for kind, begin, end in (("wait", stay.arrive_s, charges), ("charge", charges, stay.leave_s)):
                if end - begin >= 0.5:
                    bars.append({"kind": kind, "begin_s": begin, "end_s": end, "where": stay.pad})
    home = found.told[0].document.mission.home
    return {
        "summary": msgspec.to_builtins(summary), "bars": bars, "charge": {"legs": legs}, "reserve_soc": summary.reserve_soc,
        "lines": lines, "home": None if home is None else [home.point.lat, home.point.lon],
    }  # fmt: skip
