"""A composition as KML, for Google Earth and other map programs."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from skyway.models.base.formatting import duration, percent
from skyway.models.base.units import iso

if TYPE_CHECKING:
    from skyway.models.composition.composition import Composition


def route_kml(composition: Composition) -> str:
    """Return a document with a line for each leg, at the cruise height above ground, and a point for each station that is landed at."""
    c, out = composition.there_and_back, len(composition.services)
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>',
        f"<name>{_text(f'{c.origin} to {composition.destination}')}</name>",
        '<Style id="leg"><LineStyle><color>ffad5c0b</color><width>4</width></LineStyle></Style>',
        '<Style id="back"><LineStyle><color>ff8c8c8c</color><width>3</width></LineStyle></Style>',
    ]
    for number, leg in enumerate(c.services, start=1):
        places = (c.stations[name] for name in (leg.origin, *leg.via, leg.destination))
        line = " ".join(f"{place.lon:.7f},{place.lat:.7f},{c.cruise_height_m:g}" for place in places)
        name, style = ("Leg", "leg") if number <= out else ("Way back, leg", "back")
        says = f"{iso(leg.depart)} to {iso(leg.arrive)}, {percent(leg.soc_depart)} to {percent(leg.soc_arrive)}"
        parts.append(
            f"<Placemark><name>{_text(f'{name} {number}: {leg.origin} to {leg.destination}')}</name><description>{_text(says)}</description>"
            f"<styleUrl>#{style}</styleUrl><LineString><altitudeMode>relativeToGround</altitudeMode><coordinates>{line}</coordinates>"
            "</LineString></Placemark>"
        )
    for name in dict.fromkeys((c.origin, *(stop.station for stop in c.stops), composition.destination, c.destination)):
        place = c.stations[name]
        says = place.name or name
        for stop in c.stops:
            if stop.station == name and stop.recharge_s:
                says += (
                    f"; waits {duration(stop.wait_s)}, charges {duration(stop.recharge_s)} to {percent(stop.soc_to)}"
                )
        point = f"<Point><coordinates>{place.lon:.7f},{place.lat:.7f}</coordinates></Point>"
        parts.append(
            f"<Placemark><name>{_text(name)}</name><description>{_text(says)}</description>{point}</Placemark>"
        )
    return "".join((*parts, "</Document></kml>\n"))


def _text(words: str) -> str:
    """Escape a text, without what XML may not hold."""
    return escape("".join(one if one.isprintable() else " " for one in words))
