"""Maps of the network and of a route on it."""

from __future__ import annotations

import math
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.pictures import CALM, INK, MUTED, ROUTE, ZONE, new_figure, save_figure

if TYPE_CHECKING:
    from pathlib import Path

    from models.scenario import Scenario
    from models.services import Composition


def plot_network(scenario: Scenario, path: Path) -> None:
    """Draw stations, segments and no-fly zones."""
    figure = new_figure(9, 9)
    axes = figure.add_subplot()
    _draw_network(axes, scenario, labels=True, segment_alpha=0.5)
    net = scenario.network
    axes.set_title(f"{scenario.name}: {len(net)} stations, {len(net.tail)} directed segments", color=INK, loc="left")
    save_figure(figure, path)


def plot_composition(composition: Composition, scenario: Scenario, path: Path) -> None:
    """Draw the route on the network, and the state of charge over time below it."""
    figure = new_figure(9, 11)
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 1))
    _draw_network(upper, scenario, labels=False, segment_alpha=0.25)
    _draw_route(upper, composition)
    _draw_charge(lower, composition)
    title = f"{composition.origin} > {composition.destination}, {composition.payload_kg:g} kg by {composition.drone}: "
    title += f"{composition.delivery_time_s / 60:.0f} min, {composition.distance_m / 1000:.1f} km"
    upper.set_title(title, color=INK, loc="left")
    save_figure(figure, path)


def _draw_network(axes: Any, scenario: Scenario, *, labels: bool, segment_alpha: float) -> None:
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
    for name, polygon in zip(net.zones.names, net.zones.polygons, strict=True) if net.zones is not None else ():
        parts = mapping(polygon)["coordinates"]
        rings = [parts[0]] if polygon.geom_type == "Polygon" else [part[0] for part in parts]
        for ring in rings:
            x, y = zip(*((point[0], point[1]) for point in ring), strict=True)
            axes.fill(x, y, color=ZONE, alpha=0.7, zorder=0)
        axes.annotate(name, (polygon.centroid.x, polygon.centroid.y), ha="center", va="center", fontsize=6, color=ROUTE)
    charging = net.pads > 0
    axes.plot(net.lon[charging], net.lat[charging], "o", color=CALM, markersize=4, zorder=2)
    axes.plot(net.lon[~charging], net.lat[~charging], "s", color=INK, markersize=5, zorder=2)
    if labels and len(net) <= 150:
        for station in net.stations:
            axes.annotate(
                station.id, (station.lon, station.lat), xytext=(3, 3), textcoords="offset points", fontsize=6, color=INK
            )
    axes.set_aspect(1.0 / math.cos(math.radians(float(np.mean(net.lat)))))
    axes.set_xlabel("longitude, degrees")
    axes.set_ylabel("latitude, degrees")
    axes.tick_params(labelsize=7)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if len(net):
        low, high = np.array([net.lon.min(), net.lat.min()]), np.array([net.lon.max(), net.lat.max()])
        margin = 0.04 * np.maximum(high - low, 0.01)
        axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
        axes.set_ylim(low[1] - margin[1], high[1] + margin[1])


def _draw_route(axes: Any, composition: Composition) -> None:
    places = composition.stations
    stops = {stop.station: stop for stop in composition.stops}
    for service in composition.services:
        path = [places[key] for key in (service.origin, *service.via, service.destination)]
        axes.plot([p.lon for p in path], [p.lat for p in path], "-", color=ROUTE, linewidth=2.2, zorder=3)
    for service in composition.services:
        for key in (service.origin, service.destination):
            place, text = places[key], key
            if key in stops and stops[key].recharge_s > 0:
                stop = stops[key]
                text += f"\n{100 * stop.soc_from:.0f} > {100 * stop.soc_to:.0f} % in {(stop.wait_s + stop.recharge_s) / 60:.0f} min"
            axes.plot(place.lon, place.lat, "o", color=ROUTE, markersize=7, zorder=4, markeredgecolor="white")
            axes.annotate(
                text,
                (place.lon, place.lat),
                xytext=(8, -3),
                textcoords="offset points",
                fontsize=7,
                color=INK,
                zorder=5,
                bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
            )
    _draw_wind_arrows(axes, composition)


def _draw_wind_arrows(axes: Any, composition: Composition) -> None:
    """One arrow per leg: where its wind blows to, as long as it is strong (10 m/s is 1/12 of the picture's width)."""
    places, services = composition.stations, composition.services
    ends = [(places[service.origin], places[service.destination]) for service in services]
    angle = np.radians([service.wind.from_deg + 180.0 for service in services])
    speed = np.array([service.wind.speed_mps for service in services])
    axes.quiver(
        [(a.lon + b.lon) / 2 for a, b in ends],
        [(a.lat + b.lat) / 2 for a, b in ends],
        speed * np.sin(angle),
        speed * np.cos(angle),
        angles="uv",
        scale_units="width",
        scale=120.0,
        width=0.004,
        color=CALM,
        zorder=4,
    )


def _draw_charge(axes: Any, composition: Composition) -> None:
    """State of charge over minutes since the departure."""
    begin = composition.depart
    time: list[float] = []
    charge: list[float] = []

    def add(instant: Any, soc: float) -> None:
        time.append((instant - begin).total_seconds() / 60.0)
        charge.append(100.0 * soc)

    stops = {stop.station: stop for stop in composition.stops}
    for service in composition.services:
        stop = stops.pop(service.origin, None)
        if stop is not None:
            add(stop.arrive, stop.soc_from)
            add(stop.arrive + timedelta(seconds=stop.wait_s), stop.soc_from)
            add(stop.arrive + timedelta(seconds=stop.wait_s + stop.recharge_s), stop.soc_to)
        add(service.depart, service.soc_depart)
        add(service.arrive, service.soc_arrive)
    axes.plot(time, charge, "-", color=INK, linewidth=1.6)
    axes.axhline(100.0 * composition.reserve_soc, color=ROUTE, linewidth=1.0, linestyle="--")
    axes.annotate(
        "reserve",
        (0, 100.0 * composition.reserve_soc),
        xytext=(2, 3),
        textcoords="offset points",
        fontsize=7,
        color=ROUTE,
    )
    axes.set_ylim(0, 103)
    axes.set_xlim(left=0)
    axes.set_xlabel("minutes since departure")
    axes.set_ylabel("state of charge, %")
    axes.tick_params(labelsize=7)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
