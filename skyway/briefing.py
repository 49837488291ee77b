"""The briefing of a delivery: one page to print, with map, schedule, diverts, weather, zones, energy and contacts."""

from __future__ import annotations

import math
from importlib import resources
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.models.base.formatting import (
    clock,
    date_clock,
    direction_text,
    distance_text,
    duration,
    energy_text,
    from_to,
    headline,
    kept_share,
    kilometres,
    percent,
    place_text,
    probability,
    share,
)
from skyway.models.base.geodesy import coarse_distance_m
from skyway.models.composition.way_back_words import delivered_text, end_text, way_back_lines
from skyway.report.map import WIDTH, framed
from skyway.report.svg import safe

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService
    from skyway.models.scenario.scenario import Scenario
    from skyway.report.map import Place

NEAR_M = 3000.0
"""Zones so near to the route are told."""
MAX_ZONES = 8
MAX_DIVERTS = 10
PAGE_LINES = 48
"""Of a printed page as it is; with more lines everything is printed smaller."""
HEAD_LINES = 26
WIDE = 110
"""Characters of a line of notes."""


def briefing(
    composition: Composition, scenario: Scenario, contacts: Sequence[str] = (), caveats: Sequence[str] = ()
) -> str:
    """Return a page of HTML that needs nothing else; `contacts` are lines as typed, `caveats` come before the plan's own notes."""
    c, zone = composition, ZoneInfo(scenario.timezone)
    first, last, notes = c.stations[c.origin], c.stations[c.destination], (*caveats, *c.notes)
    text = (resources.files("skyway") / "briefing.html").read_text(encoding="utf-8")
    parts = {
        "title": safe(f"{c.origin} to {c.destination}"),
        "names": f"{safe(first.name or c.origin)} &rarr; {safe(last.name or c.destination)}",
        "headline": safe(headline(c, zone)),
        "facts": _facts(c, zone),
        "map": _map(c.there_and_back, scenario),
        "legs": _legs(c, zone),
        "diverts": _diverts(c.there_and_back),
        "weather": _weather(c.there_and_back),
        "zones": _zones(c.there_and_back, scenario),
        "notes": "".join(f"<li>{safe(note)}</li>" for note in notes) or "<li>none</li>",
        "contacts": "".join(f"<li>{safe(line)}</li>" for line in contacts if line.strip())
        or "<li class='write'></li>" * 3,
        "made": safe(f"planner {c.planner}, scenario {scenario.name}, {(c.scenario_sha256 or '')[:12]}"),
    }
    lines = HEAD_LINES + 3 * len(c.there_and_back.services) + parts["diverts"].count("<tr>") + len(list(contacts))
    lines += sum(1 + len(note) // WIDE for note in notes)
    parts["zoom"] = f"{min(1.0, PAGE_LINES / lines):.2f}"
    for name, value in parts.items():
        text = text.replace(f"{{{{{name}}}}}", value)
    return text


def _facts(c: Composition, zone: ZoneInfo) -> str:
    rows = [
        ("Departure", date_clock(c.depart, zone, named=True)),
        ("Drone", f"{c.drone_parameters.get('name', c.drone)} ({c.drone})"),
        ("Package", f"{c.payload_kg:g} kg"),
        ("Airspeed, height", f"{c.airspeed_mps:g} m/s, {c.cruise_height_m:g} m above ground"),
        ("Distance, energy, typically", f"{distance_text(c.distance_m)}, {energy_text(c.energy_j)}"),
        ("Lowest charge", f"{percent(c.min_soc)}; reserve {percent(c.reserve_soc, None)}"),
    ]
    if c.success is not None:
        rows.append(("Reserve kept", f"{share(c.success)} of the deliveries"))
    if c.on_time is not None:
        rows.append(("On time", f"{share(c.on_time)} of the deliveries"))
    rows += [("After the delivery" if not number else "", line) for number, line in enumerate(way_back_lines(c, zone))]
    return "".join(f"<tr><th>{name}</th><td>{safe(value)}</td></tr>" for name, value in rows)


def _legs(c: Composition, zone: ZoneInfo) -> str:
    rows: list[str] = []
    number = 0
    for part in c.parts:
        for leg in part.services:
            number += 1
            stop = part.stop_before(leg)
            if stop is not None:
                doing = (
                    f"wait {duration(stop.wait_s)}, charge {duration(stop.recharge_s)} to {percent(stop.soc_to)}"
                    if stop.recharge_s
                    else "land and take off again"
                )
                rows.append(_stay(clock(stop.arrive, zone, c.depart), f"{stop.station}: {doing}"))
            rows.append(
                f"<tr><td>{clock(leg.depart, zone, c.depart)}</td><td>{number}</td><td>{safe(_way(leg))}</td><td>{kilometres(leg.distance_m)}</td>"
                f"<td>{direction_text(leg.bearing_deg)}</td><td>{safe(leg.wind.range_text)} {safe(leg.wind.direction_text)}</td>"
                f"<td>{duration(leg.flight_time_s)}</td><td>{from_to(leg.soc_depart, leg.soc_arrive)} %, {kept_share(leg.p_reserve, c.arrival.runs)}</td></tr>"
            )
        said = delivered_text(c) if part is c else end_text(part)
        rows.append(_stay(clock(part.arrive, zone, c.depart), f"{part.destination}: {said}"))
    return "".join(rows)


def _stay(time: str, words: str) -> str:
    return f"<tr class='stop'><td>{time}</td><td></td><td colspan='6'>{safe(words)}</td></tr>"


def _way(leg: DroneService) -> str:
    return f"{leg.origin} > " + "".join(f"({name}) > " for name in leg.via) + leg.destination


def _diverts(c: Composition) -> str:
    legs: dict[str, list[str]] = {}
    for number, leg in enumerate(c.services, start=1):
        for name in leg.diverts:
            legs.setdefault(name, []).append(str(number))
    rows = [
        f"<tr><td>{safe(name)}</td><td>{safe(c.stations[name].name or '')}</td><td>{place_text(c.stations[name].lat, c.stations[name].lon)}</td>"
        f"<td>{', '.join(numbers)}</td></tr>"
        for name, numbers in list(legs.items())[:MAX_DIVERTS]
        if name in c.stations
    ]
    return "".join(rows) or "<tr><td colspan='4'>none</td></tr>"


def _weather(c: Composition) -> str:
    rows = [
        f"<tr><td>{number}</td><td>{safe(leg.wind.range_text)} m/s</td><td>{safe(leg.wind.direction_text)}</td><td>{leg.tailwind_mps:+.1f}</td>"
        f"<td>{leg.crosswind_mps:+.1f}</td><td>{probability(leg.p_hold)}</td></tr>"
        for number, leg in enumerate(c.services, start=1)
    ]
    return "".join(rows)


def _zones(c: Composition, scenario: Scenario) -> str:
    """Zones near the route, the nearest first."""
    import numpy as np

    zones = scenario.network.zones
    route = [c.stations[name] for name in c.route]
    found = []
    for zone in () if zones is None else zones.zones:
        away = math.inf
        for volume in zone.volumes:
            for part in getattr(volume.area, "geoms", [volume.area]):
                ring = np.array(part.exterior.coords)[:, :2]
                away = min(
                    away, *(float(coarse_distance_m(at.lat, at.lon, ring[:, 1], ring[:, 0]).min()) for at in route)
                )
        if away <= NEAR_M:
            closed = "closed" if zones is not None and zones.is_closed(zone) else zone.kind
            words = f"{zone.label}: {closed}, {zone.volumes[0]}, {zone.activation}; {distance_text(away)} from a station of the route"
            found.append((away, words))
    return (
        "".join(f"<li>{safe(words)}</li>" for _, words in sorted(found)[:MAX_ZONES])
        or "<li>none within 3 km of the stations of the route</li>"
    )


def _map(c: Composition, scenario: Scenario) -> str:
    legs: list[list[Place]] = [
        [(c.stations[name].lat, c.stations[name].lon) for name in (leg.origin, *leg.via, leg.destination)]
        for leg in c.services
    ]
    frame = framed([at for leg in legs for at in leg])
    parts = []
    zones = scenario.network.zones
    for zone in () if zones is None else zones.zones:
        for volume in zone.volumes:
            for part in getattr(volume.area, "geoms", [volume.area]):
                ring = [(y, x) for x, y, *_ in part.exterior.coords]
                parts.append(f'<path class="zone" d="{frame.path(ring)}Z"/>')
    near = {leg.origin for leg in c.services} | {c.destination}
    diverts = {name for leg in c.services for name in leg.diverts} - near
    parts += [f'<path class="leg" d="{frame.path(leg)}"/>' for leg in legs]
    for name in sorted(near | diverts):
        x, y = frame.xy((c.stations[name].lat, c.stations[name].lon))
        if -20.0 <= x <= WIDTH + 20.0 and -20.0 <= y <= frame.height + 20.0:
            style = "stop" if name in near else "divert"
            parts.append(f'<circle class="{style}" cx="{x:.1f}" cy="{y:.1f}" r="{5 if name in near else 3.5}"/>')
            parts.append(f'<text x="{x + 8:.1f}" y="{y + 4:.1f}">{safe(name)}</text>')
    for number, leg in enumerate(legs, start=1):
        (x1, y1), (x2, y2) = frame.xy(leg[0]), frame.xy(leg[1])
        parts.append(f'<text class="number" x="{(x1 + x2) / 2 + 6:.1f}" y="{(y1 + y2) / 2 - 4:.1f}">{number}</text>')
    return f'<svg viewBox="0 0 {WIDTH:g} {frame.height:.0f}" role="img" aria-label="Map of the route">{"".join(parts)}</svg>'
