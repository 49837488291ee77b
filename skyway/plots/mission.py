"""Picture of a mission: map with fence and rally points, and height profile."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.missions.checks.route import fly
from skyway.missions.items.geofence import FencePolygon
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import about, middle_longitude, wrapped
from skyway.plots.pictures import new_figure, save_figure

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from skyway.missions.checks.route import Route
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.document import MissionDocument

MAX_LABELS = 60


def plot_mission(document: MissionDocument, path: Path, *, title: str = "") -> None:
    """Draw a mission into a file; an `InputError` where there is nothing to draw."""
    route = fly(document.mission)
    if not (route.steps or document.fence.areas or document.rally.points):
        raise InputError("there is nothing to draw", str(path))
    figure = new_figure(9, 10)
    top, bottom = figure.subplots(2, 1, height_ratios=(3, 1))
    _map(top, document, route)
    _profile(bottom, route)
    figure.suptitle(title)
    save_figure(figure, path)


def _middle(document: MissionDocument, route: Route) -> float:
    """Longitude in the middle of what is drawn: about the antimeridian, east lies beyond 180 degrees."""
    places = [step.point for step in route.steps] + [p.point for p in document.rally.points]
    for area in document.fence.areas:
        places += list(area.vertices) if isinstance(area, FencePolygon) else [area.center]
    return middle_longitude([place.lon for place in places])


def _map(axes: Any, document: MissionDocument, route: Route) -> None:
    middle = _middle(document, route)

    def east(points: Iterable[Point]) -> Any:
        return about([point.lon for point in points], middle)

    for area in document.fence.areas:
        colour = "tab:green" if area.inclusion else "tab:red"
        if isinstance(area, FencePolygon):
            outline = [(vertex.lat, vertex.lon) for vertex in (*area.vertices, area.vertices[0])]
        else:
            turns = np.linspace(0.0, 360.0, 73)
            outline = [geodesy.direct(area.center.lat, area.center.lon, t, area.radius_m) for t in turns]
        lat, far = zip(*outline, strict=True)
        lon = about(far, middle)
        axes.fill(lon, lat, facecolor=colour, alpha=0.08)
        axes.plot(lon, lat, color=colour, linewidth=1.0, linestyle="--")
    for number, leg in enumerate(route.legs):
        points = [step.point for step in leg.steps]
        points = [leg.start, *points] if leg.start else points
        colour = f"C{number % 10}"
        axes.plot(east(points), [p.lat for p in points], color=colour, marker=".", linewidth=1.5)
    labels: dict[Point, list[int]] = {}
    for step in route.steps:
        labels.setdefault(step.point, []).append(step.item)
    for point, items in list(labels.items())[:MAX_LABELS]:
        text = ", ".join(str(item) for item in dict.fromkeys(items[:6]))
        axes.annotate(text, (float(east([point])[0]), point.lat), textcoords="offset points", xytext=(4, 4), fontsize=7)
    home = document.mission.home
    if home is not None:
        axes.plot(east([home.point]), [home.point.lat], "k^", label="home")
    if document.rally.points:
        axes.plot(
            east(p.point for p in document.rally.points),
            [p.point.lat for p in document.rally.points],
            "b*",
            label="rally points",
        )
    low, high = axes.get_ylim()
    axes.set_aspect(1.0 / max(math.cos(math.radians((low + high) / 2.0)), 0.01), adjustable="datalim")
    axes.ticklabel_format(useOffset=False)
    axes.xaxis.set_major_formatter(lambda value, _: f"{wrapped(value):.6g}")
    axes.set_xlabel("longitude, degrees")
    axes.set_ylabel("latitude, degrees")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best", fontsize=8)


def _profile(axes: Any, route: Route) -> None:
    along_m = 0.0
    for number, leg in enumerate(route.legs):
        distance: list[float] = []
        height: list[float] = []
        before = leg.start
        for step in leg.steps:
            if before is not None:
                along_m += geodesy.distance_m(before.lat, before.lon, step.point.lat, step.point.lon)
            before = step.point
            distance.append(along_m / 1000.0)
            height.append(step.height_m)
        axes.plot(distance, height, color=f"C{number % 10}", marker=".")
    axes.set_xlabel("way, km")
    axes.set_ylabel("height above home, m")
    axes.grid(alpha=0.3)
