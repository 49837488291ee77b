"""Map of a flight report as SVG: stations, planned and flown track, turns, no-fly zones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from skyway.report.svg import nice_step, safe, swatch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.report.flight_report import FlightReport, FlownLeg, PlannedLeg
    from skyway.report.series import Columns

WIDTH, _LEAST, _MOST = 640.0, 360.0, 760.0
_MARGIN = 0.09
_METRES_PER_DEG = 111_320.0
_MAX_TRACK = 4_000
_LABEL_PX = 10.0
_AWAY = frozenset({"divert", "land", "station", "stop"})
"""Decisions that send it elsewhere."""

Place = tuple[float, float]


class Zone(NamedTuple):
    """A no-fly zone: its rings as (lat, lon)."""

    name: str
    rings: list[list[Place]]


@dataclass(frozen=True, slots=True)
class Frame:
    """A flat map about a place: good for a city or a county."""

    lat: float
    lon: float
    left: float
    top: float
    metres_per_unit: float
    height: float

    def xy(self, at: Place) -> tuple[float, float]:
        """Return units right of the left, and below the upper edge."""
        east, south = _metres(at, self.lat, self.lon)
        return (east - self.left) / self.metres_per_unit, (south - self.top) / self.metres_per_unit

    def path(self, places: Sequence[Place]) -> str:
        """Return the path of an SVG through places."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(self.xy, places))


def _metres(at: Place, lat: float, lon: float) -> Place:
    east = (at[1] - lon + 540.0) % 360.0 - 180.0
    return east * _METRES_PER_DEG * math.cos(math.radians(lat)), -(at[0] - lat) * _METRES_PER_DEG


def framed(places: Sequence[Place]) -> Frame:
    """Return a frame that holds all places."""
    lat, lon = places[0]
    points = [_metres(at, lat, lon) for at in places]
    low = [min(point[k] for point in points) for k in (0, 1)]
    high = [max(point[k] for point in points) for k in (0, 1)]
    wide, tall = (max(high[k] - low[k], 200.0) * (1.0 + 2.0 * _MARGIN) for k in (0, 1))
    height = min(max(WIDTH * tall / wide, _LEAST), _MOST)
    scale = max(wide / WIDTH, tall / height)
    left, top = ((low[k] + high[k]) / 2.0 - scale * (WIDTH, height)[k] / 2.0 for k in (0, 1))
    return Frame(lat, lon, left, top, scale, height)


def drawn_map(document: FlightReport, zones: list[Zone] | None) -> str:
    """Return the map with its legend, as HTML."""
    drawn = map_picture(document, zones)
    if drawn is None:
        return '<p class="none">no position is known</p>'
    inner, height = drawn
    items = "".join(f"<li>{swatch(style)}{words}</li>" for words, style in map_entries(document, zones))
    unknown = "<li>no-fly zones: unknown</li>" if zones is None else "" if zones else "<li>no no-fly zones</li>"
    return (
        '<figure class="map"><div class="map-tools" hidden><button type="button" data-zoom="0.667" '
        'aria-label="zoom in">+</button><button type="button" data-zoom="1.5" aria-label="zoom out">&minus;</button>'
        '<button type="button" data-zoom="0">whole</button></div>'
        f'<svg id="map" viewBox="0 0 {WIDTH:g} {height:.0f}" role="img" aria-label="map of the flight">'
        f'{inner}</svg><ul class="legend">{items}{unknown}</ul></figure>'
    )


def map_picture(document: FlightReport, zones: list[Zone] | None) -> tuple[str, float] | None:
    """Return the content of the picture, `WIDTH` wide, and its height; None where no position is known."""
    stations = document.planned.stations
    tracks = _tracks(document)
    ways = _planned_ways(document)
    route = _on_route(document)
    on_route = [(at.lat, at.lon) for name, at in stations.items() if name in route]
    everything = [at for way in (*tracks, *ways) for at in way] + on_route
    if not everything:
        return None
    frame = framed(everything)
    parts = _zones(frame, zones)
    parts += [f'<path class="line planned" d="{frame.path(way)}"/>' for way in ways if len(way) > 1]
    uploaded = [leg.way for leg in document.legs if len(leg.way) > 1]
    parts += [f'<path class="line expected" d="{frame.path(way)}"/>' for way in uploaded]
    parts += [f'<path class="line actual" d="{frame.path(track)}"/>' for track in tracks if len(track) > 1]
    parts += _turns(frame, document)
    parts += _stations(frame, document, route)
    parts.append(_scale_bar(frame))
    return "".join(parts), frame.height


def map_entries(document: FlightReport, zones: list[Zone] | None) -> list[tuple[str, str]]:
    """Return the legend: words, and the CSS class of the mark."""
    found = [
        ("first plan", "line planned"), ("route as uploaded", "line expected"), ("flown", "line actual"),
        ("landed here", "station landed"), ("on the route or planned", "station passed"),
    ]  # fmt: skip
    diverts, route = _diverts(document), _on_route(document)
    found += [("divert station", "station divert")] if diverts - route else []
    found += [("other station", "station other")] if set(document.planned.stations) - route - diverts else []
    decided = {d.action for d in document.decisions if d.where == "flight"}
    if decided - _AWAY:
        found.append(("decision in flight", "turn-mark"))
    if decided & _AWAY:
        found.append(("sent elsewhere", "turn-away"))
    return [*found, ("no-fly zone", "zone")] if zones else found


def _on_route(document: FlightReport) -> set[str | None]:
    legs: list[PlannedLeg | FlownLeg] = [*document.planned.legs, *document.legs]
    return {name for leg in legs for name in (leg.origin, leg.destination, *leg.via)}


def _diverts(document: FlightReport) -> set[str]:
    return {name for leg in document.legs for name in leg.diverts}


def _planned_ways(document: FlightReport) -> list[list[Place]]:
    stations = document.planned.stations
    found = []
    for leg in document.planned.legs:
        names = [leg.origin, *leg.via, leg.destination]
        found.append([(at.lat, at.lon) for name in names if (at := stations.get(name or "")) is not None])
    return found


def _tracks(document: FlightReport) -> list[list[Place]]:
    """Return the flown track, in one piece per flight."""
    series = document.series
    columns = series.log or series.track
    flights = columns.get("flight") or [0] * len(columns["time_s"])
    found: dict[int, list[Place]] = {}
    for flight, lat, lon in zip(flights, columns["lat"], columns["lon"], strict=True):
        if lat is not None and lon is not None:
            found.setdefault(flight, []).append((lat, lon))
    return [way[:: max(math.ceil(len(way) / _MAX_TRACK), 1)] + way[-1:] for way in found.values()]


def _zones(frame: Frame, zones: list[Zone] | None) -> list[str]:
    parts = []
    for zone in zones or ():
        path = "".join(frame.path(ring) + "Z" for ring in zone.rings)
        parts.append(f'<path class="zone" d="{path}"><title>no-fly zone {safe(zone.name)}</title></path>')
    return parts


def _turns(frame: Frame, document: FlightReport) -> list[str]:
    """Mark where something was decided in flight, at the position told next to that time."""
    track = document.series.track
    parts = []
    for decision in document.decisions:
        if decision.where != "flight":
            continue
        at = _position(track, decision.time_s)
        if at is not None:
            x, y = frame.xy(at)
            away = decision.action in _AWAY
            shape = "M0 -7L7 6H-7Z" if away else "M0 -5L5 0L0 5L-5 0Z"
            kind = "turn-away" if away else "turn-mark"
            words = f"{decision.action}: {decision.reason}"
            parts.append(
                f'<g class="fixed" transform="translate({x:.1f} {y:.1f})"><path class="{kind}" d="{shape}">'
                f"<title>{safe(words)}</title></path></g>"
            )
    return parts


def _position(track: Columns, at_s: float) -> Place | None:
    rows = [i for i, lat in enumerate(track["lat"]) if lat is not None and track["lon"][i] is not None]
    if not rows:
        return None
    nearest = min(rows, key=lambda i: abs(track["time_s"][i] - at_s))
    return track["lat"][nearest], track["lon"][nearest]


def _stations(frame: Frame, document: FlightReport, route: set[str | None]) -> list[str]:
    """Draw the stations; those of the route with their names, the others with theirs under the pointer."""
    landed = {leg.landed_at for leg in document.legs if leg.landed_at}
    parts = []
    taken: list[tuple[float, float, float]] = []
    diverts = _diverts(document)
    ordered = sorted(
        document.planned.stations.items(),
        key=lambda item: (item[0] not in landed, item[0] not in route, item[0] not in diverts),
    )
    for name, station in ordered:
        x, y = frame.xy((station.lat, station.lon))
        if not (0.0 <= x <= WIDTH and 0.0 <= y <= frame.height):
            continue
        kind = "landed" if name in landed else "passed" if name in route else "divert" if name in diverts else "other"
        title = f"{name}: {station.name}" if station.name else name
        text = ""
        if kind != "other":
            wide = _LABEL_PX * len(name) + 12.0
            right = x + wide < WIDTH and not any(abs(y - v) < 15.0 and u < x + wide and x < u + w for u, v, w in taken)
            taken.append((x if right else x - wide, y, wide))
            text = f'<text x="{10 if right else -10}" y="4" text-anchor="{"start" if right else "end"}">{safe(name)}</text>'
        parts.append(
            f'<g class="fixed station {kind}" transform="translate({x:.1f} {y:.1f})"><circle r="{5 if text else 3}">'
            f"<title>{safe(title)}</title></circle>{text}</g>"
        )
    return parts[::-1]


def _scale_bar(frame: Frame) -> str:
    length_m = nice_step(frame.metres_per_unit * WIDTH)
    units = length_m / frame.metres_per_unit
    name = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    y = frame.height - 16.0
    return (
        f'<path class="scale" d="M16 {y - 5:.1f}v5h{units:.1f}v-5"/>'
        f'<g class="fixed" transform="translate({16 + units / 2:.1f} {y - 6:.1f})"><text text-anchor="middle">{name}</text></g>'
        f'<g class="fixed" transform="translate({WIDTH - 22:.1f} 26)"><path class="north" d="M0 -14L6 6L0 2L-6 6Z"/>'
        '<text y="20" text-anchor="middle">N</text></g>'
    )
