"""Maps of the network and of a route on it."""

from __future__ import annotations

import math
import textwrap
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, duration, from_to, headline
from skyway.models.base.geodesy import about, middle_longitude, wrapped
from skyway.plots.charge import draw_charge
from skyway.plots.heights import HEIGHTS_IN, draw_heights
from skyway.plots.pictures import (
    CALM,
    INK,
    MUTED,
    MUTED_INK,
    ROUTE,
    ZONE,
    ZONE_INK,
    LabelPlacer,
    new_figure,
    plain_axes,
    save_figure,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.plots.charge_band import ChargeBand

_Line: TypeAlias = tuple[tuple[float, float], tuple[float, float]]

MAX_LABELS = 150
"""Stations up to which a map of the network names them all."""
WIDTH_IN = 9.0
_CHARGE_IN = 2.4
_ARROW_SCALE = 130.0
"""m/s of wind that an arrow as long as the map is wide would stand for."""


def plot_network(scenario: Scenario, path: Path | None = None) -> Figure:
    """Draw stations, segments and no-fly zones; into a file where one is named."""
    net = scenario.network
    frame = _with_zones(_frame(net.lon, net.lat, 0.45), scenario)
    lon = about(net.lon, frame.middle)
    figure = new_figure(WIDTH_IN, _height_in(frame) + 0.9)
    axes = figure.add_subplot()
    _draw_network(axes, scenario, frame, segment_alpha=0.5)
    both = len({tuple(sorted(pair)) for pair in zip(net.tail.tolist(), net.head.tolist(), strict=True)})
    count = sum(not station.flyover for station in net.stations)
    axes.set_title(f"{scenario.name}: {count} stations, {both} segments", color=INK, loc="left")
    placer = LabelPlacer(axes, lon, net.lat)
    _name_zones(placer, scenario, frame)
    if len(net) <= MAX_LABELS:
        for station, x in zip(net.stations, lon.tolist(), strict=True):
            if station.flyover:
                continue
            placer.place(station.id, x, station.lat, fontsize=7, color=INK, zorder=5)
    return save_figure(figure, path)


def plot_composition(
    composition: Composition, scenario: Scenario, path: Path | None = None, band: ChargeBand | None = None
) -> Figure:
    """Draw the route on the part of the network round it, and the state of charge over time below it.

    The band tells how the charge differs over the simulated deliveries.
    """
    whole = composition.there_and_back
    shown = [(place.lon, place.lat) for place in (whole.stations[key] for key in whole.route)]
    shown += _diverts(whole, scenario).values()
    lon, lat = np.array(shown).T
    frame = _frame(lon, lat, 0.9, least=0.15)
    tall = _height_in(frame)
    heights = [service.heights for service in whole.services]
    parts = (tall, _CHARGE_IN, HEIGHTS_IN) if any(heights) else (tall, _CHARGE_IN)
    figure = new_figure(WIDTH_IN, sum(parts) + 1.2)
    upper, lower, *below = figure.subplots(len(parts), 1, height_ratios=parts)
    zone = ZoneInfo(scenario.timezone)
    _draw_network(upper, scenario, frame, segment_alpha=0.25)
    draw_charge(lower, composition, zone, band)
    upper.set_title(_headline(composition, zone), color=INK, loc="left", fontsize=11)
    _draw_route(upper, whole, scenario, frame, out=len(composition.services))
    for axes in below:
        draw_heights(axes, heights, [whole.origin, *(service.destination for service in whole.services)])
    return save_figure(figure, path)


def _headline(composition: Composition, zone: ZoneInfo) -> str:
    """What is to be expected first: on average, half and 95 % by when; the length of the typical schedule where that is unknown."""
    who = f"{composition.origin} > {composition.destination}, {composition.payload_kg:g} kg by {composition.drone}"
    return f"{who}, {distance_text(composition.distance_m)}\n{headline(composition, zone)}"


class Frame(NamedTuple):
    """Extent of a map, degrees."""

    west: float
    east: float
    south: float
    north: float

    @property
    def middle(self) -> float:
        """Longitude in the middle; others are drawn within 180 degrees of it."""
        return (self.west + self.east) / 2.0

    @property
    def stretch(self) -> float:
        """Length of a degree of longitude over one of latitude, in the middle."""
        return math.cos(math.radians((self.south + self.north) / 2.0))


def _frame(lon: NDArray[np.float64], lat: NDArray[np.float64], squareness: float, *, least: float = 0.02) -> Frame:
    """Frame round some points with a margin.

    The shorter side is at least `squareness` of the longer one, which is at least `least` degrees of latitude.
    """
    if not len(lon):
        return Frame(-1.0, 1.0, -1.0, 1.0)
    lon = about(lon, middle_longitude(lon))
    tight = Frame(float(lon.min()), float(lon.max()), float(lat.min()), float(lat.max()))
    size = max((tight.east - tight.west) * tight.stretch, tight.north - tight.south, least)
    wide = 0.57 * max(tight.east - tight.west, squareness * size / tight.stretch)
    high = 0.57 * max(tight.north - tight.south, squareness * size)
    x, y = (tight.west + tight.east) / 2.0, (tight.south + tight.north) / 2.0
    return Frame(x - wide, x + wide, y - high, y + high)


def _with_zones(frame: Frame, scenario: Scenario) -> Frame:
    """Widen a frame so that zones at its rim are shown whole."""
    west, east, south, north = frame
    near = 0.1 * (east - west), 0.1 * (north - south)
    for left, bottom, right, top in (_bounds(ring) for _, ring in _rings(scenario, frame)):
        if left < east + near[0] and right > west - near[0] and bottom < north + near[1] and top > south - near[1]:
            west, east, south, north = min(west, left), max(east, right), min(south, bottom), max(north, top)
    return Frame(west, east, south, north)


def _rings(scenario: Scenario, frame: Frame) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Outer rings of the zones with the number of their zone, each moved by whole turns next to a frame; shape (points, 2)."""
    zones = scenario.network.zones
    for number, polygon in enumerate(zones.polygons if zones is not None else ()):
        for part in getattr(polygon, "geoms", [polygon]):
            ring = np.array(part.exterior.coords)[:, :2]
            middle = (ring[:, 0].min() + ring[:, 0].max()) / 2.0
            yield number, ring - (360.0 * round((middle - frame.middle) / 360.0), 0.0)


def _bounds(ring: NDArray[np.float64]) -> tuple[float, float, float, float]:
    west, south = ring.min(axis=0).tolist()
    east, north = ring.max(axis=0).tolist()
    return west, south, east, north


def _height_in(frame: Frame) -> float:
    shape = (frame.north - frame.south) / ((frame.east - frame.west) * frame.stretch)
    return float(np.clip((WIDTH_IN - 0.8) * shape, 3.0, 11.0))


def _degrees(value: float, names: str) -> str:
    value = wrapped(value)
    return f"{abs(value):.6g}° {names[0] if value >= 0 else names[1]}"


def _draw_network(axes: Any, scenario: Scenario, frame: Frame, *, segment_alpha: float) -> None:
    """Segments, zones, stations, axes and a scale; no names."""
    from matplotlib.collections import LineCollection

    net = scenario.network
    lon = about(net.lon, frame.middle)
    ends = about(net.lon[net.head], lon[net.tail])
    lines = np.stack(
        (np.column_stack((lon[net.tail], net.lat[net.tail])), np.column_stack((ends, net.lat[net.head]))), axis=1
    )
    axes.add_collection(LineCollection(list(lines), colors=MUTED, linewidths=0.6, alpha=segment_alpha, zorder=1))
    for number, (_, ring) in enumerate(_rings(scenario, frame)):
        label = None if number else "no-fly zone"
        axes.fill(ring[:, 0], ring[:, 1], color=ZONE, alpha=0.7, linewidth=0, zorder=0, label=label)
    charging = net.pads > 0
    axes.plot(lon[charging], net.lat[charging], "o", color=CALM, markersize=4, zorder=2, label="station with pads")
    others = ~charging & np.array([not station.flyover for station in net.stations], dtype=bool)
    if others.any():
        axes.plot(lon[others], net.lat[others], "s", color=INK, markersize=5, zorder=2, label="no pads")
    axes.legend(fontsize=7, loc="upper left", frameon=True, edgecolor="none", framealpha=0.8)
    axes.set_xlim(frame.west, frame.east)
    axes.set_ylim(frame.south, frame.north)
    axes.set_aspect(1.0 / frame.stretch)
    axes.xaxis.set_major_locator(_few_ticks())
    axes.yaxis.set_major_locator(_few_ticks())
    axes.xaxis.set_major_formatter(lambda value, _: _degrees(value, "EW"))
    axes.yaxis.set_major_formatter(lambda value, _: _degrees(value, "NS"))
    plain_axes(axes)
    _draw_scale(axes, frame)


def _few_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(5, steps=[1, 2, 5, 10])


def _draw_scale(axes: Any, frame: Frame) -> None:
    """A bar of a round length, about a sixth of the map's width, in its lower right corner."""
    west, east, south, north = frame
    middle = (south + north) / 2.0
    metres = geodesy.distance_m(middle, west, middle, min(east, west + 179.0))
    step = 10.0 ** math.floor(math.log10(metres / 6.0))
    length = max(k for k in (1, 2, 5) if k * step <= metres / 6.0) * step
    part = length / metres * (east - west)
    x, y = east - 0.03 * (east - west) - part, south + 0.03 * (north - south)
    axes.plot([x, x + part], [y, y], "-", color=INK, linewidth=2, solid_capstyle="butt", zorder=5)
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    axes.annotate(
        text, (x + part / 2, y), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=7, color=INK
    )


def _name_zones(placer: LabelPlacer, scenario: Scenario, frame: Frame) -> None:
    zones = scenario.network.zones
    for name, polygon in zip(zones.names, zones.polygons, strict=True) if zones is not None else ():
        inside = polygon.representative_point()
        short = textwrap.fill(name, 16)
        placer.centre(
            short,
            float(about(inside.x, frame.middle)),
            inside.y,
            fontsize=6,
            color=ZONE_INK,
            zorder=1,
            clip_on=True,
            annotation_clip=True,
        )


def _diverts(composition: Composition, scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Longitude and latitude of the divert stations of all legs."""
    names = {name for service in composition.services for name in service.diverts}
    return {s.id: (s.lon, s.lat) for s in scenario.network.stations if s.id in names}


def _draw_route(axes: Any, composition: Composition, scenario: Scenario, frame: Frame, *, out: int) -> None:
    """Legs, stops with what is done there, diverts, the other stations, and the wind of each leg.

    After the first `out` legs those of the way back follow, dashed.
    """
    net = scenario.network
    diverts = _diverts(composition, scenario)
    places = diverts | {key: (place.lon, place.lat) for key, place in composition.stations.items()}
    at = {key: (float(about(lon, frame.middle)), lat) for key, (lon, lat) in places.items()}
    lines: list[_Line] = []
    for number, service in enumerate(composition.services):
        path = [at[key] for key in (service.origin, *service.via, service.destination)]
        x, y = zip(*path, strict=True)
        label = {0: "leg, stations overflown", out: "way back"}.get(number)
        style, width = ("-o", 2.2) if number < out else ("--o", 1.4)
        axes.plot(x, y, style, color=ROUTE, linewidth=width, markersize=3.5, zorder=3, label=label)
        lines += list(pairwise(path))
    landings = dict.fromkeys(key for service in composition.services for key in (service.origin, service.destination))
    aside = [key for key in diverts if key not in composition.route and key in at]
    for keys, mark, size, label in ((landings, "o", 8, "lands, or begins"), (aside, "D", 6, "divert station")):
        if keys:
            x, y = zip(*(at[key] for key in keys), strict=True)
            colour = ROUTE if mark == "o" else CALM
            axes.plot(x, y, mark, color=colour, markersize=size, zorder=5, markeredgecolor="white", label=label)
    lines += _draw_wind_arrows(axes, composition, at)
    axes.legend(fontsize=7, loc="upper left", frameon=True, edgecolor="none", framealpha=0.8)
    lon = about(net.lon, frame.middle)
    placer = LabelPlacer(axes, lon, net.lat, lines)
    _name_zones(placer, scenario, frame)
    bends = {station.id for station in net.stations if station.flyover}
    _name_stops(placer, composition, {key: place for key, place in at.items() if key not in bends}, landings)
    shown = (frame.west < lon) & (lon < frame.east) & (frame.south < net.lat) & (net.lat < frame.north)
    for node in np.flatnonzero(shown) if shown.sum() <= MAX_LABELS else ():
        station, east = net.stations[node], float(lon[node])
        if station.id not in composition.route and not station.flyover:
            name = f"{station.id} (divert)" if station.id in diverts else station.id
            points, tone = (6.5, INK) if station.id in diverts else (5.5, MUTED_INK)
            placer.place(name, east, station.lat, zorder=5, fontsize=points, color=tone)


def _name_stops(
    placer: LabelPlacer, composition: Composition, at: dict[str, tuple[float, float]], landings: dict[str, None]
) -> None:
    """Name the stations of the route, and what is done there."""
    paper = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8}
    charging = [key for key in landings if any(one.station == key and one.recharge_s > 0 for one in composition.stops)]
    rest = [key for key in composition.route if key not in charging]
    for key in dict.fromkeys((*charging, composition.origin, composition.destination, *rest)):
        if key not in at:
            continue
        text = key
        for stop in composition.stops:
            if stop.station == key and stop.recharge_s > 0:
                text += f"\n{from_to(stop.soc_from, stop.soc_to)} % in {duration(stop.recharge_s)}"
                text += f"\nwait {duration(stop.wait_s)}" if stop.wait_s >= 90 else ""
        font_pt = (8.0 if len(landings) <= 8 else 7.0) if key in landings else 6.5
        placer.place(text, *at[key], gap=7, fontsize=font_pt, color=INK, zorder=6, bbox=paper)


def _draw_wind_arrows(axes: Any, composition: Composition, at: dict[str, tuple[float, float]]) -> list[_Line]:
    """One arrow per leg beside its middle: where its wind prevails to blow to, as long as it is strong on average.

    A leg whose wind has no prevailing direction has no arrow; a key says how strong a wind is.

    Returns the arrows as lines.
    """
    winds = [(service, service.wind.from_deg) for service in composition.services if service.wind.from_deg is not None]
    if not winds:
        return []
    services = [service for service, _ in winds]
    ends = np.array([(at[service.origin], at[service.destination]) for service in services])
    angle = np.radians([from_deg + 180.0 for _, from_deg in winds])
    speed = np.array([service.wind.speed_mps for service in services])
    west, east = axes.get_xlim()
    low, high = axes.get_ylim()
    stretch = math.cos(math.radians((low + high) / 2.0))
    wide = (east - west) * stretch
    step = ends[:, 1] - ends[:, 0]
    course = np.arctan2(step[:, 1], step[:, 0] * stretch) + math.pi / 2.0
    x = ends[:, :, 0].mean(axis=1) + 0.03 * wide * np.cos(course) / stretch
    y = ends[:, :, 1].mean(axis=1) + 0.03 * wide * np.sin(course)
    arrows = axes.quiver(
        x,
        y,
        speed * np.sin(angle),
        speed * np.cos(angle),
        angles="uv",
        scale_units="width",
        scale=_ARROW_SCALE,
        width=0.0035,
        pivot="middle",
        color=CALM,
        zorder=4,
    )
    axes.quiverkey(
        arrows, 0.9, 0.1, 10.0, "wind 10 m/s", labelpos="N", color=CALM, labelcolor=INK, fontproperties={"size": 7}
    )
    half = 0.5 * speed / _ARROW_SCALE * wide
    dx, dy = half * np.sin(angle) / stretch, half * np.cos(angle)
    return [((i - u, j - v), (i + u, j + v)) for i, j, u, v in zip(x, y, dx, dy, strict=True)]
