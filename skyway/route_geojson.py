"""A composition as GeoJSON: legs as lines, numbered from 1, stations as points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.models.base.geodesy import line_geometry
from skyway.models.base.units import iso

if TYPE_CHECKING:
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import Stop


def route_geojson(composition: Composition) -> dict[str, Any]:
    """Return a FeatureCollection that any map program shows: a station that is landed at twice is there twice, once for each stop."""
    out = len(composition.services)
    whole = composition.there_and_back
    items: list[dict[str, Any]] = []
    for number, service in enumerate(whole.services, start=1):
        places = [whole.stations[key] for key in (service.origin, *service.via, service.destination)]
        items.append(
            {
                "type": "Feature",
                "geometry": line_geometry([(place.lat, place.lon) for place in places]),
                "properties": {
                    "leg": number,
                    "part": "delivery" if number <= out else "way back",
                    "from": service.origin,
                    "to": service.destination,
                    "depart": iso(service.depart),
                    "arrive": iso(service.arrive),
                    "distance_m": service.distance_m,
                    "ground_speed_mps": service.ground_speed_mps,
                    "soc_depart": service.soc_depart,
                    "soc_arrive": service.soc_arrive,
                    "diverts": list(service.diverts),
                },
            }
        )
    for key in dict.fromkeys(whole.route):
        place = whole.stations[key]
        properties = {"id": key, "name": place.name, "pads": place.pads}
        landed = [_stop(stop) for stop in whole.stops if stop.station == key]
        point = {"type": "Point", "coordinates": [place.lon, place.lat]}
        items += (
            {"type": "Feature", "geometry": point, "properties": properties | stop}
            for stop in landed or [dict[str, Any]()]
        )
    return {"type": "FeatureCollection", "features": items}


def _stop(stop: Stop) -> dict[str, Any]:
    return {
        "arrive": iso(stop.arrive),
        "wait_s": stop.wait_s,
        "recharge_s": stop.recharge_s,
        "soc_from": stop.soc_from,
        "soc_to": stop.soc_to,
    }
