"""Maps of the network and of a route on it."""

from __future__ import annotations

import math
import textwrap
from datetime import timedelta
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from zoneinfo import ZoneInfo

import numpy as np

from models import geodesy
from skyway.pictures import CALM, INK, MUTED, ROUTE, ZONE, ZONE_INK, LabelPlacer, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from numpy.typing import NDArray

    from models.scenario import Scenario
    from models.services import Composition

_Line: TypeAlias = tuple[tuple[float, float], tuple[float, float]]

MOST_LABELS = 150
"""Stations up to which a map of the network names them all."""
WIDTH_IN = 9.0
_CHARGE_IN = 2.4
_ARROW_SCALE = 130.0
"""m/s of wind that an arrow as long as the map is wide would stand for."""


def plot_network(scenario: Scenario, path: Path) -> None:
    """Draw stations, segments and no-fly zones."""
    net = scenario.network
    frame = _with_zones(_frame(net.lon, net.lat, 0.45), scenario)
    figure = new_figure(WIDTH_IN, _height_in(frame) + 0.9)
    axes = figure.add_subplot()
    _draw_network(axes, scenario, frame, segment_alpha=0.5)
    both = len({tuple(sorted(pair)) for pair in zip(net.tail.tolist(), net.head.tolist(), strict=True)})
    axes.set_title(f"{scenario.name}: {len(net)} stations, {both} segments", color=INK, loc="left")
    placer = LabelPlacer(axes, net.lon, net.lat)
    _name_zones(placer, scenario)
    if len(net) <= MOST_LABELS:
        for station in net.stations:
            placer.place(station.id, station.lon, station.lat, fontsize=7, color=INK, zorder=5)
    save_figure(figure, path)


def plot_composition(composition: Composition, scenario: Scenario, path: Path) -> None:
    """Draw the route on the part of the network round it, and the state of charge over time below it."""
    places = [composition.stations[key] for key in composition.route]
    lon, lat = np.array([place.lon for place in places]), np.array([place.lat for place in places])
    frame = _frame(lon, lat, 0.9, least=0.15)
    tall = _height_in(frame)
    figure = new_figure(WIDTH_IN, tall + _CHARGE_IN + 1.2)
    upper, lower = figure.subplots(2, 1, height_ratios=(tall, _CHARGE_IN))
    zone = ZoneInfo(scenario.timezone)
    _draw_network(upper, scenario, frame, segment_alpha=0.25)
    _draw_charge(lower, composition, zone)
    hours, minutes = divmod(round(composition.delivery_time_s / 60.0), 60)
    time = f"{hours} h {minutes} min" if hours else f"{minutes} min"
    title = f"{composition.origin} > {composition.destination}, {composition.payload_kg:g} kg by {composition.drone}: "
    upper.set_title(f"{title}{time}, {composition.distance_m / 1000:.1f} km", color=INK, loc="left")
    _draw_route(upper, composition, scenario)
    save_figure(figure, path)


class Frame(NamedTuple):
    """What a map shows, degrees."""

    west: float
    east: float
    south: float
    north: float

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
    zones = scenario.network.zones
    for zone in zones.polygons if zones is not None else ():
        left, bottom, right, top = zone.bounds
        if left < east + near[0] and right > west - near[0] and bottom < north + near[1] and top > south - near[1]:
            west, east, south, north = min(west, left), max(east, right), min(south, bottom), max(north, top)
    return Frame(west, east, south, north)


def _height_in(frame: Frame) -> float:
    shape = (frame.north - frame.south) / ((frame.east - frame.west) * frame.stretch)
    return float(np.clip((WIDTH_IN - 0.8) * shape, 3.0, 11.0))


def _degrees(value: float, names: str) -> str:
    return f"{abs(value):.6g}° {names[0] if value >= 0 else names[1]}"


def _draw_network(axes: Any, scenario: Scenario, frame: Frame, *, segment_alpha: float) -> None:
    """Segments, zones, stations, axes and a scale; no names."""
    from matplotlib.collections import LineCollection
    from shapely.geometry import mapping

    net = scenario.network
    lines = np.stack(
        (
            np.column_stack((net.lon[net.tail], net.lat[net.tail])),
            np.column_stack((net.lon[net.head], net.lat[net.head])),
        ),
        axis=1,
    )
    axes.add_collection(LineCollection(list(lines), colors=MUTED, linewidths=0.6, alpha=segment_alpha, zorder=1))
    for polygon in net.zones.polygons if net.zones is not None else ():
        parts = mapping(polygon)["coordinates"]
        rings = [parts[0]] if polygon.geom_type == "Polygon" else [part[0] for part in parts]
        for ring in rings:
            x, y = zip(*((point[0], point[1]) for point in ring), strict=True)
            axes.fill(x, y, color=ZONE, alpha=0.7, linewidth=0, zorder=0)
    charging = net.pads > 0
    axes.plot(net.lon[charging], net.lat[charging], "o", color=CALM, markersize=4, zorder=2, label="station with pads")
    if not charging.all():
        axes.plot(net.lon[~charging], net.lat[~charging], "s", color=INK, markersize=5, zorder=2, label="no pads")
        axes.legend(fontsize=7, loc="upper left", frameon=False)
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


def _name_zones(placer: LabelPlacer, scenario: Scenario) -> None:
    zones = scenario.network.zones
    for name, polygon in zip(zones.names, zones.polygons, strict=True) if zones is not None else ():
        inside = polygon.representative_point()
        short = textwrap.fill(name, 16)
        placer.centre(
            short, inside.x, inside.y, fontsize=6, color=ZONE_INK, zorder=1, clip_on=True, annotation_clip=True
        )


def _draw_route(axes: Any, composition: Composition, scenario: Scenario) -> None:
    """Legs, stops with what is done there, and the wind of each leg."""
    places, net = composition.stations, scenario.network
    lines: list[_Line] = []
    for service in composition.services:
        path = [(places[key].lon, places[key].lat) for key in (service.origin, *service.via, service.destination)]
        axes.plot(*zip(*path, strict=True), "-", color=ROUTE, linewidth=2.2, zorder=3)
        axes.plot(*zip(*path, strict=True), "o", color=ROUTE, markersize=3.5, zorder=3)
        lines += list(pairwise(path))
    landings = dict.fromkeys(key for service in composition.services for key in (service.origin, service.destination))
    for key in landings:
        axes.plot(places[key].lon, places[key].lat, "o", color=ROUTE, markersize=8, zorder=5, markeredgecolor="white")
    lines += _draw_wind_arrows(axes, composition)
    placer = LabelPlacer(axes, net.lon, net.lat, lines)
    _name_zones(placer, scenario)
    paper = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8}
    stops = {stop.station: stop for stop in composition.stops}
    charging = [key for key in landings if key in stops and stops[key].recharge_s > 0]
    rest = [key for key in composition.route if key not in charging]
    for key in dict.fromkeys((*charging, composition.origin, composition.destination, *rest)):
        text = key
        if key in charging:
            stop = stops[key]
            text += f"\n{100 * stop.soc_from:.0f} > {100 * stop.soc_to:.0f} % in {stop.recharge_s / 60:.0f} min"
            text += f"\nwait {stop.wait_s / 60:.0f} min" if stop.wait_s >= 90 else ""
        size = (8 if len(landings) <= 8 else 7) if key in landings else 6.5
        placer.place(text, places[key].lon, places[key].lat, gap=7, fontsize=size, color=INK, zorder=6, bbox=paper)


def _draw_wind_arrows(axes: Any, composition: Composition) -> list[_Line]:
    """One arrow per leg beside its middle: where its wind prevails to blow to, as long as it is strong on average.

    A leg whose wind has no prevailing direction has no arrow; a key says how strong a wind is.

    Returns the arrows as lines.
    """
    places = composition.stations
    winds = [(service, service.wind.from_deg) for service in composition.services if service.wind.from_deg is not None]
    if not winds:
        return []
    services = [service for service, _ in winds]
    ends = [(places[service.origin], places[service.destination]) for service in services]
    angle = np.radians([from_deg + 180.0 for _, from_deg in winds])
    speed = np.array([service.wind.speed_mps for service in services])
    west, east = axes.get_xlim()
    low, high = axes.get_ylim()
    stretch = math.cos(math.radians((low + high) / 2.0))
    wide = (east - west) * stretch
    course = np.array([math.atan2(b.lat - a.lat, (b.lon - a.lon) * stretch) for a, b in ends]) + math.pi / 2.0
    x = np.array([(a.lon + b.lon) / 2 for a, b in ends]) + 0.03 * wide * np.cos(course) / stretch
    y = np.array([(a.lat + b.lat) / 2 for a, b in ends]) + 0.03 * wide * np.sin(course)
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


def _draw_charge(axes: Any, composition: Composition, zone: ZoneInfo) -> None:
    """State of charge over minutes since the departure, by what the drone does."""
    begin = composition.depart

    def minutes(instant: datetime) -> float:
        return (instant - begin).total_seconds() / 60.0

    pieces: list[tuple[str, datetime, float, datetime, float]] = []
    stops = {stop.station: stop for stop in composition.stops}
    for service in composition.services:
        stop = stops.pop(service.origin, None)
        if stop is not None:
            pad = stop.arrive + timedelta(seconds=stop.wait_s)
            off = pad + timedelta(seconds=stop.recharge_s)
            pieces.append(("wait or hold", stop.arrive, stop.soc_from, pad, stop.soc_from))
            pieces.append(("charge", pad, stop.soc_from, off, stop.soc_to))
            pieces.append(("wait or hold", off, stop.soc_to, service.depart, stop.soc_to))
        pieces.append(("fly", service.depart, service.soc_depart, service.arrive, service.soc_arrive))
    colours = {"fly": INK, "wait or hold": MUTED, "charge": CALM}
    seen: set[str] = set()
    for what, start, soc_start, end, soc_end in pieces:
        if end <= start:
            continue
        label = what if what not in seen else None
        seen.add(what)
        ends = [minutes(start), minutes(end)]
        axes.plot(ends, [100 * soc_start, 100 * soc_end], "-", color=colours[what], linewidth=2, label=label)
    reserve = 100.0 * composition.reserve_soc
    axes.axhline(reserve, color=ROUTE, linewidth=1.0, linestyle="--", label=f"reserve, {reserve:.0f} %")
    axes.set_ylim(0, 103)
    axes.set_xlim(0, 1.01 * minutes(composition.arrive))
    axes.set_xlabel(f"minutes after {begin.astimezone(zone):%Y-%m-%d %H:%M %Z}", fontsize=8)
    axes.set_ylabel("state of charge, %", fontsize=8)
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=7, ncols=4, loc="upper right", frameon=True, edgecolor="none", framealpha=0.8)
    plain_axes(axes)
