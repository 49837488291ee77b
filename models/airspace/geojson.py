"""Zones of plain GeoJSON: our own form, and forms of some authorities.

Ours has in the properties of a feature: ``id``, ``name``, ``kind``, ``floor`` and ``ceiling`` (as pilots write them: ``120 m
AGL``, ``FL65``, ``GND``, ``UNL``), ``from`` and ``until`` (ISO 8601), all of which may be absent: then a zone is prohibited, from
the ground up, at all times. The FAA's UAS facility map has a ceiling for each cell, above which flights need more than the
automatic authorization; the Danish map a buffer in words; the Finnish one a letter.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

from skyway.models.airspace import areas, geojson_area
from skyway.models.airspace.activation import ALWAYS, Activation, Period, instant_s
from skyway.models.airspace.limits import GROUND, M_PER_FT, NO_CEILING, Limit, in_order, limit_of_number, limit_of_text
from skyway.models.airspace.openair import CLASSES
from skyway.models.airspace.zone import KINDS, Kind, Volume, Zone
from skyway.models.base.errors import one_line
from skyway.models.base.formatting import distance_text

if TYPE_CHECKING:
    import shapely

    from skyway.models.airspace.notes import Notes

_BUFFER = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*(km|m)?\s*", re.IGNORECASE)
_KINDS: dict[str, Kind] = {
    **{kind.upper(): kind for kind in KINDS},
    "RESTRICTED": "authorization",
    "DANGER": "authorization",
    "NO-FLY": "prohibited",
    "NO_FLY": "prohibited",
    "NFZ": "prohibited",
    "REQ_AUTHORISATION": "authorization",
    "REQ_AUTHORIZATION": "authorization",
    "NO_RESTRICTION": "information",
    "AUTHORISATION": "authorization",
    **CLASSES,
    "R2": "authorization",
    "L": "authorization",
}
"""Kinds by the words, classes and letters of the forms; in Finland R and R2 are restricted areas, L aerodromes, and D,
which is a danger area there, closes as class D does."""
_DANISH: dict[str, Kind] = {"modelflyveplads": "conditional"}
"""Zones of the Danish map that require no authorization: model airfields, which are only to be notified beforehand."""


def zone_of_feature(feature: dict[str, Any], number: int, notes: Notes, source: str) -> Zone | None:
    """Read one feature; None, with a fault, if it cannot be placed."""
    found = feature.get("properties")
    properties = found if isinstance(found, dict) else {}
    upper = {str(key).upper(): value for key, value in properties.items()}
    if "CEILING" in upper and ("APT1_ICAO" in upper or "MAP_EFF" in upper or "UNIT" in upper):
        return _facility_cell(feature, upper, number, notes, source)
    if "Bufferzone" in properties or "typeId" in properties:
        return _danish(feature, properties, number, notes, source)
    radius = geojson_area.number(properties.get("radius_m", properties.get("radius")))
    area = geojson_area.area(feature.get("geometry"), notes, None if math.isnan(radius) else radius)
    if area is None:
        return None
    identity = feature.get("id", properties.get("id"))
    fallback = f"zone {number + 1}"
    return zone_of(properties, area, _word(identity), notes, source, fallback)


def zone_of(
    properties: dict[str, Any], area: shapely.Geometry, identity: str, notes: Notes, source: str, fallback: str = "zone"
) -> Zone:
    """Return the zone of an area, with properties in our form."""
    name = _word(properties.get("name") or properties.get("title") or properties.get("id")) or identity or fallback
    word = next((properties[key] for key in ("kind", "type", "class") if properties.get(key) not in (None, "")), None)
    kind = _KINDS.get(str(word).strip().upper()) if word is not None else "prohibited"
    if kind is None:
        notes.closed("kind", "is not known", word, "counted as prohibited")
    floor = _limit(properties, ("floor", "lower", "lowerLimit", "lowerCeiling", "bottom"), notes, ceiling=False)
    ceiling = _limit(properties, ("ceiling", "upper", "upperLimit", "upperCeiling", "top"), notes, ceiling=True)
    when = _activation(properties, notes)
    said = _word(properties.get("message") or properties.get("description"))
    volume = Volume(area, *in_order(floor, ceiling, notes))
    return Zone(identity or name, name, kind or "prohibited", (volume,), when, source, said)


def _word(value: object) -> str:
    return one_line(str(value)).strip() if isinstance(value, str | int | float) and not isinstance(value, bool) else ""


def _limit(properties: dict[str, Any], names: tuple[str, ...], notes: Notes, *, ceiling: bool) -> Limit:
    """Read a limit: in words, or a number with ``…_m`` in its name, or openAIP's {value, unit, referenceDatum}."""
    for name in names:
        value = properties.get(name)
        if isinstance(value, dict):
            return limit_of_number(
                value.get("value"), value.get("unit"), value.get("referenceDatum"), notes, ceiling=ceiling
            )
        if value is not None and value != "":
            unit, datum = (properties.get(key) for key in ("uom", f"{name}Reference"))
            if datum is not None:
                return limit_of_number(value, unit, datum, notes, ceiling=ceiling)
            return limit_of_text(str(value), notes, ceiling=ceiling)
        for suffix, reference in (("_m_agl", "AGL"), ("_m_amsl", "AMSL")):
            if properties.get(name + suffix) is not None:
                return limit_of_number(properties[name + suffix], "m", reference, notes, ceiling=ceiling)
    return NO_CEILING if ceiling else GROUND


def _activation(properties: dict[str, Any], notes: Notes) -> Activation:
    listed = properties.get("activationTimes")
    given = [properties] if {"from", "until"} & set(properties) else listed if isinstance(listed, list) else []
    periods = []
    for one in given:
        times = []
        for names, missing in ((("from", "start"), -math.inf), (("until", "end"), math.inf)):
            value = next((one[name] for name in names if one.get(name)), None) if isinstance(one, dict) else "?"
            time_s = missing if value is None else instant_s(str(value))
            if time_s is None:
                notes.closed(names[0], "is not a date", value, "counted as no limit")
            times.append(missing if time_s is None else time_s)
        begin_s, end_s = times
        periods.append(Period(begin_s, end_s) if begin_s <= end_s else Period())
    return Activation(tuple(periods)) if periods else ALWAYS


def _facility_cell(
    feature: dict[str, Any], upper: dict[str, Any], number: int, notes: Notes, source: str
) -> Zone | None:
    """Return a cell of the FAA's UAS facility map: free below its ceiling, by authorization above; feet over ground."""
    area = geojson_area.area(feature.get("geometry"), notes)
    if area is None:
        return None
    feet = geojson_area.number(upper["CEILING"])
    if not feet >= 0.0:
        notes.closed("CEILING", "is not a height", upper["CEILING"], "counted as 0")
        feet = 0.0
    name = _word(upper.get("APT1_NAME")) or _word(upper.get("UNIT")) or "UAS facility map"
    key = _word(upper.get("GLOBALID")) or _word(upper.get("OBJECTID")) or str(number + 1)
    identity = f"{_word(upper.get('APT1_ICAO')) or 'UASFM'}-{key}"
    said = f"flights below {feet:.0f} ft need the automatic authorization (LAANC) all the same"
    floor = Limit(feet * M_PER_FT, "AGL") if feet > 0.0 else GROUND
    return Zone(identity, name, "authorization", (Volume(area, floor),), ALWAYS, source, said, _word(upper.get("UNIT")))


def _danish(feature: dict[str, Any], properties: dict[str, Any], number: int, notes: Notes, source: str) -> Zone | None:
    """Return a zone of the Danish map: no limits of height, and a distance to keep from the place or its outline."""
    told = properties.get("Bufferzone")
    found = _BUFFER.fullmatch(str(told)) if told not in (None, "") else None
    metres = 0.0 if found is None else float(found[1].replace(",", ".")) * (1000.0 if found[2] in ("km", "KM") else 1.0)
    if told not in (None, "") and found is None:
        notes.closed("Bufferzone", "is not a distance", told, "counted as 5 km")
        metres = 5000.0
    geometry = feature.get("geometry")
    if isinstance(geometry, dict) and geometry.get("type") == "Point" and metres == 0.0:
        notes.closed("Bufferzone", "is missing for a point", told, f"counted as {distance_text(areas.THIN_M)}")
        metres = areas.THIN_M
    area = geojson_area.area(geometry, notes, metres)
    if area is None:
        return None
    if isinstance(geometry, dict) and geometry.get("type") != "Point" and metres > 0.0:
        area = areas.widened([area], metres)[0]
    word = _word(properties.get("typeId"))
    name = _word(properties.get("title")) or word or f"zone {number + 1}"
    key = _word(properties.get("OBJECTID")) or str(number + 1)
    dates = {"from": properties.get("datoTidSTART"), "until": properties.get("datoTidSLUT")}
    when = _activation({key: value for key, value in dates.items() if value}, notes)
    kind: Kind = _DANISH.get(word.lower(), "authorization")
    return Zone(f"DK-{key}", name, kind, (Volume(area),), when, source, word)
