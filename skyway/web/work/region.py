"""The scenario on the map: stations, segments, zones, wind by the hour, expected queues by the hour."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway import typed_values
from skyway.models.base.geodesy import about, middle_longitude, wrapped
from skyway.models.base.units import S_PER_H, from_posix, iso
from skyway.models.queues.waiting_times import STEP_S, forecast_waits
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, PLANNERS
from skyway.planning import Conditions
from skyway.plots.wind_summary import wind_report
from skyway.web.folder import stamp
from skyway.web.work.weather_and_zones import given

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.airspace.zone import Volume
    from skyway.models.network.network import Network
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble

ARROWS = 8
"""Wind arrows across the longer side of the region."""
HEIGHTS = 240
"""Heights of the ground across the region, each way."""
HOURS = 24
"""Number of hours of wind and queues on the page."""


def loaded(scenario: str | None) -> Scenario:
    """Return a scenario; read once, and again when one of its files has changed."""
    return _kept(scenario, stamp(scenario))


@lru_cache(maxsize=2)
def _kept(scenario: str | None, stamp: tuple[tuple[str, int, int], ...]) -> Scenario:  # noqa: ARG001  the stamp is the key
    return Conditions(scenario=None if scenario is None else Path(scenario), **given().region()).loaded()


def region(scenario: str | None) -> dict[str, Any]:
    """Return stations, segments, zones, drones and planners; longitudes are next to those of the middle."""
    world = loaded(scenario)
    network = world.network
    middle = middle_longitude(network.lon)
    lon = about(network.lon, middle)
    pairs = {(min(pair), max(pair)) for pair in zip(network.tail.tolist(), network.head.tolist(), strict=True)}
    return {
        "name": world.name,
        "timezone": world.timezone,
        "warnings": list(world.warnings),
        "terrain": network.over is not None,
        "stations": [
            {
                "id": one.id,
                "name": one.name,
                "lat": one.lat,
                "lon": x,
                "pads": one.pads,
                "spots": one.holding_spots,
                "elevation_m": one.elevation_m,
                "bend": one.flyover,
            }
            for one, x in zip(network.stations, lon.tolist(), strict=True)
        ],
        "segments": sorted(pairs),
        "zones": _zones(network, middle, _highest_m(scenario, network)),
        "drones": [
            {"id": one.id, "name": one.name, "max_payload_kg": one.max_payload_kg, "wind_limit_mps": one.wind_limit_mps}
            for one in world.drones
        ],
        "planners": [name for name in PLANNERS if name not in CLAIRVOYANT_PLANNERS],
        "clairvoyant": list(CLAIRVOYANT_PLANNERS),
        "bounds": [float(lon.min()), float(network.lat.min()), float(lon.max()), float(network.lat.max())],
    }


def ground(scenario: str | None) -> dict[str, Any]:
    """Return heights of the ground over the region, rows from the north at equal distances on a Mercator map; nothing without terrain.

    Heights are metres above mean sea level, None if the model has none.
    """
    world = loaded(scenario)
    if world.network.over is None:
        return {}
    middle = middle_longitude(world.network.lon)
    lon = about(world.network.lon, middle)
    margin = 0.08 * max(float(np.ptp(lon)), float(np.ptp(world.network.lat)), 0.05)
    west, east = float(lon.min()) - margin, float(lon.max()) + margin
    south, north = (
        max(-85.0, min(85.0, one)) for one in (world.network.lat.min() - margin, world.network.lat.max() + margin)
    )
    top, low = np.arctanh(np.sin(np.radians([north, south]))).tolist()
    flat = np.linspace(top, low, HEIGHTS)
    lat, x = np.meshgrid(np.degrees(np.arcsin(np.tanh(flat))), np.linspace(west, east, HEIGHTS), indexing="ij")
    found = world.network.over.terrain.ground_m(lat.ravel(), np.array([wrapped(one) for one in x.ravel().tolist()]))
    heights = [None if np.isnan(one) else round(one) for one in found.tolist()]
    return {"box": [west, south, east, north], "rows": HEIGHTS, "columns": HEIGHTS, "heights_m": heights}


def _zones(network: Network, middle: float, top_m: float) -> list[dict[str, Any]]:
    """Zones with the outer rings of their volumes, and whether each closes the air in which drones cruise."""
    if network.zones is None:
        return []
    found = []
    for zone in network.zones.zones:
        rings = []
        for volume in zone.volumes:
            for part in getattr(volume.area, "geoms", [volume.area]):
                ring = np.array(part.exterior.coords)[:, :2]
                turns = round((float(ring[:, 0].mean()) - middle) / 360.0)
                rings.append(np.round(ring - (360.0 * turns, 0.0), 6).tolist())
        words = "; ".join(str(volume) for volume in zone.volumes[:3])
        closed = network.zones.is_closed(zone) and any(
            _low(volume, network.zones.cruise_height_m, top_m) for volume in zone.volumes
        )
        found.append(
            {
                "id": zone.id, "name": zone.label, "kind": zone.kind, "closed": closed, "rings": rings, "limits": words,
                "when": str(zone.activation), "message": zone.message[:500],
            }
        )  # fmt: skip
    return found


def _highest_m(scenario: str | None, network: Network) -> float:
    """Highest ground of the region as far as known; infinite if that of a station is unknown."""
    heights = [math.inf if one.elevation_m is None else one.elevation_m for one in network.stations]
    known: list[float] = [one for one in ground(scenario).get("heights_m", ()) if one is not None]
    return max([*heights, *known])


def _low(volume: Volume, cruise_height_m: float, top_m: float) -> bool:
    """Whether a volume may reach down to where drones cruise, over ground up to `top_m`."""
    floor_m, over_ground = volume.floor.lowest()
    return floor_m <= cruise_height_m + (0.0 if over_ground else top_m)


def winds(scenario: str | None, conditions: dict[str, Any], hours: int = HOURS) -> dict[str, Any]:
    """Return the wind at cruise height on a grid of points, hour by hour: mean vector and its spread, and mean and 80 % range of the speed.

    Vectors are where the wind blows TO, m/s; the spread is the standard deviation of the members in either direction; `conditions` are fields of `skyway.planning.Conditions` as typed.
    """
    world = loaded(scenario)
    asked = Conditions(**(given().weather() | conditions))
    with typed_values.as_typed():
        depart = asked.instant
        known, _ = asked.winds(world, depart, None)
    report = wind_report(known.forecast, world, hours)
    wind = known.forecast.at_height(world.rules.cruise_height_m, world.rules.wind_profile_exponent)
    lat, lon = _grid(world.network)
    weights = wind.weights(lat, np.array([wrapped(one) for one in lon.tolist()]))
    count = len(report.hours)
    north, east, strays = _mean_and_spread(wind, count, weights)
    return {
        "height_m": world.rules.cruise_height_m,
        "members": len(wind),
        "points": np.round(np.column_stack((lat, lon)), 5).tolist(),
        "hours": [
            {
                "time": hour.start,
                "north": np.round(north[slot], 2).tolist(),
                "east": np.round(east[slot], 2).tolist(),
                "spread": np.round(strays[slot], 2).tolist(),
                "mean_mps": hour.mean_mps,
                "p10_mps": hour.p10_mps,
                "p90_mps": hour.p90_mps,
                "from_deg": hour.from_deg,
                "p_hold": hour.p_hold,
            }
            for slot, hour in enumerate(report.hours)
        ],
        "notes": [*known.notes, *known.forecast.notes],
    }


def _mean_and_spread(
    wind: WindEnsemble, count: int, weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return mean north, mean east and spread of the members, shape (hours, points) each."""
    means, variance = [], 0.0
    for part in (wind.north, wind.east):
        at = np.einsum("mts,ps->mtp", part[:, :count], weights)
        mean = np.einsum("m,mtp->tp", wind.probability, at)
        variance = variance + np.einsum("m,mtp->tp", wind.probability, (at - mean) ** 2) / 2.0
        means.append(mean)
    return means[0], means[1], np.sqrt(variance)


def _grid(network: Network) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points over the region, at equal distances: latitude and longitude, shape (points,) each."""
    lon = about(network.lon, middle_longitude(network.lon))
    west, east, south, north = lon.min(), lon.max(), network.lat.min(), network.lat.max()
    stretch = max(float(np.cos(np.radians((south + north) / 2.0))), 0.05)
    step = max(north - south, (east - west) * stretch, 0.01) / ARROWS
    rows = np.arange(south - step / 2.0, north + step, step)
    columns = np.arange(west - step / stretch / 2.0, east + step / stretch, step / stretch)
    lat, x = np.meshgrid(np.clip(rows, -89.0, 89.0), columns, indexing="ij")
    return lat.ravel(), x.ravel()


def queues(scenario: str | None, conditions: dict[str, Any], hours: int = HOURS) -> dict[str, Any]:
    """Return the queue at each station with pads, hour by hour: expected wait, s, and probability of a free pad."""
    world = loaded(scenario)
    start_s = Conditions(**conditions).instant.timestamp()
    stations = [i for i, one in enumerate(world.network.stations) if one.pads > 0]
    waits = forecast_waits(world.load, world.network.pads, stations, start_s, hours, {})
    every = round(S_PER_H / STEP_S)
    return {
        "times": [iso(from_posix(start_s + S_PER_H * hour)) for hour in range(hours)],
        "stations": {
            world.network.stations[i].id: {
                "wait_s": np.round(one.wait_s[: hours * every : every], 0).tolist(),
                "p_free": np.round(one.p_free[: hours * every : every], 3).tolist(),
            }
            for i, one in waits.items()
        },
    }
