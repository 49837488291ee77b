"""Zones of EUROCAE ED-269 (JSON) and ED-318 (GeoJSON), as authorities publish them.

The two differ in words and places: the kind of restriction is ``restriction`` or ``type``, the time ``applicability`` or
``limitedApplicability``, the limits are beside the area or in a ``layer`` inside it. Publications deviate from the
standards; such deviations are accepted.
"""

from __future__ import annotations

import math
from datetime import UTC, tzinfo
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from skyway.models.airspace import areas, geojson_area
from skyway.models.airspace.activation import (
    ALWAYS,
    DAY_S,
    EVERY_DAY,
    SUN_EVENTS,
    Activation,
    Period,
    Window,
    clock_s,
    days_of,
    instant_s,
)
from skyway.models.airspace.limits import in_order, limit_of_number
from skyway.models.airspace.zone import Kind, Volume, Zone
from skyway.models.base.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.models.airspace.notes import Notes

RESTRICTIONS: dict[str, Kind] = {
    "PROHIBITED": "prohibited",
    "REQ_AUTHORISATION": "authorization",
    "REQ_AUTHORIZATION": "authorization",
    "CONDITIONAL": "conditional",
    "NO_RESTRICTION": "information",
    "USPACE": "authorization",
    "U-SPACE": "authorization",
}
"""Kind of zone by the word of either standard; in U-space a flight requires the authorization of a service."""
METADATA_DATES = ("validFrom", "validTo", "issued")


def is_ed269(item: object) -> bool:
    """Whether it looks like a zone of ED-269: it has a list of volumes."""
    if not isinstance(item, dict):
        return False
    geometry = item.get("geometry")
    return "restriction" in item or (
        isinstance(geometry, list) and any(isinstance(one, dict) and "horizontalProjection" in one for one in geometry)
    )


def is_ed318(feature: object) -> bool:
    """Whether it looks like a feature of ED-318."""
    if not isinstance(feature, dict):
        return False
    properties, geometry = feature.get("properties"), feature.get("geometry")
    if isinstance(properties, dict) and str(properties.get("type", "")).upper() in RESTRICTIONS:
        return True
    return isinstance(geometry, dict) and ("layer" in geometry or "extent" in geometry)


def zone_of_ed269(item: dict[str, Any], notes: Notes, source: str) -> Zone | None:
    """Read a zone of ED-269; None, with a fault, if it cannot be placed."""
    volumes = []
    geometry = item.get("geometry")
    parts = geometry if isinstance(geometry, list) else [geometry]
    for part in parts:
        area = _projected(part, notes)
        if area is None or not isinstance(part, dict):
            return None
        unit = part.get("uomDimensions")
        volumes.append(
            _volume(
                area,
                part,
                unit,
                ("lowerLimit", "lowerVerticalReference"),
                ("upperLimit", "upperVerticalReference"),
                notes,
            )
        )
    if not volumes:
        notes.wrong("geometry", "has no volume", None, "give the zone an area, or take it out of the file")
        return None
    kind = _kind(item.get("restriction", item.get("type")), notes)
    return _zone(item, kind, tuple(volumes), _activation(item.get("applicability"), notes, volumes), source)


def zone_of_ed318(feature: dict[str, Any], notes: Notes, source: str) -> Zone | None:
    """Read a feature of ED-318; None, with a fault, if it cannot be placed."""
    properties, geometry = feature.get("properties"), feature.get("geometry")
    item = properties if isinstance(properties, dict) else {}
    volumes = []
    for part, layer in _layers(geometry, None):
        area = geojson_area.area(part, notes)
        if area is None:
            return None
        limits = layer if isinstance(layer, dict) else {}
        volumes.append(
            _volume(area, limits, limits.get("uom"), ("lower", "lowerReference"), ("upper", "upperReference"), notes)
        )
    if not volumes:
        notes.wrong("geometry", "has no area", geometry, "give the zone an area, or take it out of the file")
        return None
    kind = _kind(item.get("type", item.get("restriction")), notes)
    when = item.get("limitedApplicability", item.get("applicability"))
    return _zone(item, kind, tuple(volumes), _activation(when, notes, volumes), source)


def check_metadata(document: dict[str, Any], notes: Notes) -> None:
    """Refuse a collection whose dates cannot be read: whether it is in force is unknown."""
    found = document.get("metadata", document.get("datasetMetadata"))
    if isinstance(found, dict):
        for name in METADATA_DATES:
            value = found.get(name)
            if value not in (None, "") and (not isinstance(value, str) or instant_s(value) is None):
                notes.at("metadata")
                notes.wrong(name, "is not a date", value, "a date such as 2026-08-02T10:00:00Z")


def _layers(geometry: object, layer: object) -> Iterator[tuple[object, object]]:
    """Yield each geometry with its own layer, or with that of the collection that contains it."""
    if isinstance(geometry, dict) and geometry.get("type") == "GeometryCollection":
        parts = geometry.get("geometries")
        for part in parts if isinstance(parts, list) else [None]:
            yield from _layers(part, geometry.get("layer", layer))
    elif isinstance(geometry, dict):
        yield geometry, geometry.get("layer", layer)
    else:
        yield geometry, layer


def _volume(
    area: Any, limits: dict[str, Any], unit: object, lower: tuple[str, str], upper: tuple[str, str], notes: Notes
) -> Volume:
    floor = limit_of_number(limits.get(lower[0]), unit, limits.get(lower[1]), notes, ceiling=False)
    ceiling = limit_of_number(limits.get(upper[0]), unit, limits.get(upper[1]), notes, ceiling=True)
    return Volume(area, *in_order(floor, ceiling, notes))


def _projected(part: object, notes: Notes) -> Any:
    """Return the area of a volume of ED-269; radii are in metres whatever the unit of the limits."""
    shape = part.get("horizontalProjection") if isinstance(part, dict) else None
    if not isinstance(shape, dict):
        notes.wrong("horizontalProjection", "is missing", shape, "a Polygon or a Circle")
        return None
    if str(shape.get("type", "")).title() != "Circle" and "radius" not in shape:
        return geojson_area.area({"type": "Polygon", **shape}, notes)
    places = geojson_area.places([shape.get("center", shape.get("coordinates"))], notes)
    radius = geojson_area.number(shape.get("radius"))
    return areas.circle(*places[0], radius, notes) if places else None


def _kind(word: object, notes: Notes) -> Kind:
    kind = RESTRICTIONS.get(str(word or "").strip().upper())
    if kind is None:
        notes.closed("restriction", "is not known", word, "counted as prohibited")
    return kind or "prohibited"


def _zone(item: dict[str, Any], kind: Kind, volumes: tuple[Volume, ...], when: Activation, source: str) -> Zone:
    name = text_of(item.get("name"))
    authorities = item.get("zoneAuthority")
    first = next((one for one in authorities if isinstance(one, dict)), {}) if isinstance(authorities, list) else {}
    contact = ", ".join(filter(None, (text_of(first.get(key)) for key in ("name", "email", "phone"))))
    said = text_of(item.get("message")) or text_of(item.get("restrictionConditions"))
    identity = text_of(item.get("identifier")) or name or "zone without a name"
    return Zone(identity, name or identity, kind, volumes, when, source, said, contact)


def text_of(value: object) -> str:
    """Return a text on one line: plain, of a list, or in English (else the first) of several languages."""
    if isinstance(value, list):
        spoken = [one for one in value if isinstance(one, dict) and one.get("text")]
        english = [one for one in spoken if str(one.get("lang", "")).lower().startswith("en")]
        for one in (*english, *spoken):
            return text_of(one["text"])
        return "; ".join(filter(None, (text_of(one) for one in value if not isinstance(one, dict | list))))
    if isinstance(value, dict):
        return text_of(value.get("text"))
    return one_line(str(value)).strip() if isinstance(value, str | int | float) else ""


def _activation(value: object, notes: Notes, volumes: Sequence[Volume]) -> Activation:
    """Read when a zone is active: always if nothing limits it, or if the limit is not understood."""
    if value in (None, "", []):
        return ALWAYS
    entries = value if isinstance(value, list) else [value]
    middle = volumes[0].area.centroid
    periods = [_period(entry, notes, (float(middle.y), float(middle.x))) for entry in entries]
    return Activation(tuple(periods))


def _period(entry: object, notes: Notes, place: tuple[float, float]) -> Period:
    if not isinstance(entry, dict):
        notes.closed("applicability", "is not understood", entry, "counted as always")
        return Period()
    begin_s, end_s = -math.inf, math.inf
    if str(entry.get("permanent", "NO")).upper() != "YES":
        begin_s = _instant(entry.get("startDateTime"), -math.inf, notes)
        end_s = _instant(entry.get("endDateTime"), math.inf, notes)
        if begin_s > end_s:
            notes.closed("applicability", "ends before it begins", entry, "counted as always")
            begin_s, end_s = -math.inf, math.inf
    found = entry.get("schedule") or entry.get("dailyPeriod") or ()
    windows = [_window(one, notes, place) for one in (found if isinstance(found, list | tuple) else [found])]
    if any(window is None for window in windows):
        return Period(begin_s, end_s)
    return Period(begin_s, end_s, tuple(window for window in windows if window is not None))


def _instant(value: object, missing: float, notes: Notes) -> float:
    if value in (None, ""):
        return missing
    found = instant_s(value) if isinstance(value, str) else None
    if found is None:
        notes.closed("applicability", "is not a date", value, "counted as no limit")
        return missing
    return found


def _window(entry: object, notes: Notes, place: tuple[float, float]) -> Window | None:
    """Read hours of days; None means all day. Hours by the sun are those at a place."""
    if not isinstance(entry, dict):
        notes.closed("schedule", "is not understood", entry, "counted as all day")
        return None
    named = entry.get("day")
    days = days_of(named if isinstance(named, list) else [named])
    if days is None:
        notes.closed("day", "is not a day of the week", named, "counted as any day")
        days = EVERY_DAY
    begin, end = (entry.get(f"{which}Time") for which in ("start", "end"))
    first, last = (str(entry.get(name) or "").strip().upper() for name in ("startEvent", "endEvent"))
    events = [one for one in (first, last) if one]
    known = all(one in SUN_EVENTS for one in events)
    if events and not (known and find_spec("astral")):
        problem = "depends on the sun" if known else "is not an event of the sun"
        counted = "counted as the whole day and night" + ("; install skyway-planner[weather]" if known else "")
        notes.closed("schedule", problem, ", ".join(events), counted)
        # a night that begins on a day ends on the next
        return None if days == EVERY_DAY else Window(0.0, 2.0 * DAY_S, days)
    begin, end = ("" if event else time for event, time in ((first, begin), (last, end)))
    clocks = [clock_s(value) if isinstance(value, str) and value.strip() else (0.0, None) for value in (begin, end)]
    if clocks[0] is None or clocks[1] is None:
        notes.closed("schedule", "is not a time of day", f"{begin} to {end}", "counted as all day")
        return None if days == EVERY_DAY else Window(-DAY_S / 2, 1.5 * DAY_S, days)
    zone = clocks[0][1] or clocks[1][1] or UTC
    if events:
        return Window(clocks[0][0], clocks[1][0], days, zone, (first, last), place)
    if days == EVERY_DAY and clocks[0][0] == clocks[1][0]:
        return None
    begin_s, end_s = clocks[0][0], clocks[1][0]
    if clocks[1][1] is not None:  # an end on another clock is converted to the clock of the begin
        end_s = (end_s + _offset_s(zone) - _offset_s(clocks[1][1])) % DAY_S if clocks[1][1] != zone else end_s
    return Window(begin_s, end_s, days, zone)


def _offset_s(zone: tzinfo) -> float:
    offset = zone.utcoffset(None)
    return offset.total_seconds() if offset is not None else 0.0
