"""Reading airspace files: the content decides the format, not the name."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from skyway.models.airspace import ed
from skyway.models.airspace.geojson import zone_of_feature
from skyway.models.airspace.kml import read_kml, unpacked
from skyway.models.airspace.notes import CLOSES_NOTHING, Notes
from skyway.models.airspace.openair import Reader, is_openair
from skyway.models.airspace.pressure import NOT_TOLD, split_pressure
from skyway.models.base.errors import Fault, InputError, one_line, refuse
from skyway.models.base.files import read_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.models.airspace.pressure import Pressure
    from skyway.models.airspace.zone import Zone

MAX_BYTES = 64 * 1024 * 1024
WRAPPERS = ("UASZoneList", "UASZoneVersion", "uasZoneList", "zones")
"""Members under which ED-269 publications put their list of zones, beside ``features``."""

LON_LAT = ("CRS84", ":4326", ":4258")
"""Ends of the names of coordinate systems in degrees: WGS-84, and ETRS89, which is within a metre of it."""


@dataclass(frozen=True, slots=True)
class AirspaceFile:
    """Contents of an airspace file.

    Attributes
    ----------
    path : str
        The file.
    form : str
        ``ED-269``, ``ED-318``, ``GeoJSON``, ``OpenAir`` or ``KML``.
    zones : tuple of Zone
        In their order.
    notes : tuple of Fault
        Items that were not understood and count as closed.
    faults : tuple of Fault
        Items that cannot be placed.
    """

    path: str
    form: str
    zones: tuple[Zone, ...]
    notes: tuple[Fault, ...]
    faults: tuple[Fault, ...]


def inspect_airspace(path: Path) -> AirspaceFile:
    """Read an airspace file of any form, with its faults. Raises an `InputError` if it is not one.

    The pressure of the day may follow its name (`split_pressure`): it determines the heights of flight levels.
    """
    path, pressure = split_pressure(path)
    file = str(path)
    data = read_bytes(path, max_bytes=MAX_BYTES)
    if data.startswith(b"PK\x03\x04"):
        data = unpacked(data, file, MAX_BYTES)
    text = _text(data, file)
    notes = Notes(Fault("", file))
    first = text.lstrip()[:1]
    if not first:
        raise InputError("is empty", file, remedy="give a file with zones: ED-269, ED-318, GeoJSON, OpenAir or KML")
    if first in "{[":
        form, zones = _json(text, file, notes)
    elif first == "<":
        form, zones = "KML", read_kml(text, notes, file)
    elif is_openair(text):
        form, zones = "OpenAir", Reader(notes, file).read(text)
    else:
        shown = one_line(text.lstrip().splitlines()[0])[:40]
        raise InputError(
            "is not an airspace file", file, None, "first line", shown, "ED-269, ED-318, GeoJSON, OpenAir or KML"
        )
    if not zones and not notes.faults:
        notes.at("")
        if form in ("OpenAir", "KML"):
            notes.wrong("", "has no zones", None, "give a file with zones, or none")
        else:  # an empty list reports itself
            notes.closed("", "has no zones", None, CLOSES_NOTHING)
    if pressure is not NOT_TOLD:
        zones = [_on_a_day(zone, pressure) for zone in zones]
    return AirspaceFile(file, form, tuple(zones), tuple(notes.taken), tuple(notes.faults))


def _on_a_day(zone: Zone, pressure: Pressure) -> Zone:
    volumes = tuple(
        replace(one, floor=replace(one.floor, pressure=pressure), ceiling=replace(one.ceiling, pressure=pressure))
        for one in zone.volumes
    )
    return replace(zone, volumes=volumes)


def read_airspace(paths: Sequence[Path]) -> tuple[tuple[Zone, ...], tuple[Fault, ...]]:
    """Read the zones of some files, and the items that count as closed because they were not understood.

    An `InputError` contains every fault of every file.
    """
    faults: list[Fault] = []
    zones: list[Zone] = []
    notes: list[Fault] = []
    for path in paths:
        try:
            found = inspect_airspace(path)
        except InputError as error:
            faults += error.faults
            continue
        faults += found.faults
        zones += found.zones
        notes += found.notes
    refuse(faults)
    return tuple(zones), tuple(notes)


def _text(data: bytes, file: str) -> str:
    """Decode a file: UTF-8 with or without a mark, UTF-16 with one, else the code page of old OpenAir files."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    nul = data.find(0)
    if nul >= 0:
        raise InputError(f"is not text: byte {nul} is NUL", file, remedy="ED-269, ED-318, GeoJSON, OpenAir, KML or KMZ")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _json(text: str, file: str, notes: Notes) -> tuple[str, list[Zone]]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", file) from error
    features = _features(document, file)
    if isinstance(document, dict):
        ed.check_metadata(document, notes)
        _check_crs(document, notes)
    forms = [form for form, known in (("ED-269", ed.is_ed269), ("ED-318", ed.is_ed318)) if any(map(known, features))]
    form = forms[0] if forms else "GeoJSON"
    zones = []
    for number, feature in enumerate(features):
        notes.at(_label(feature, number))
        if not isinstance(feature, dict):
            notes.wrong("", "is not a zone", feature, "an object with geometry and properties")
            continue
        known = len(notes.faults)
        if ed.is_ed269(feature):
            zone = ed.zone_of_ed269(feature, notes, file)
        elif ed.is_ed318(feature):
            zone = ed.zone_of_ed318(feature, notes, file)
        else:
            zone = zone_of_feature(feature, number, notes, file)
        if zone is not None:
            zones.append(zone)
        elif len(notes.faults) == known:
            notes.wrong("geometry", "cannot be placed", feature.get("geometry"))
    return form, zones


def _check_crs(document: dict[str, Any], notes: Notes) -> None:
    """Refuse coordinates that are not longitudes and latitudes."""
    crs = document.get("crs")
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = str(properties.get("name", "")) if isinstance(properties, dict) else ""
    if name and not name.upper().endswith(LON_LAT):
        notes.at("crs")
        notes.wrong("", "is not in longitude and latitude", name, "save it in WGS-84 (EPSG:4326)")


def _features(document: object, file: str) -> list[Any]:
    """Return the zones of a document: a list, a collection, one feature, or a bare geometry."""
    if isinstance(document, list):
        return document
    if not isinstance(document, dict):
        raise InputError("is not an airspace file", file, None, None, document, "expected an object or a list")
    for name in ("features", *WRAPPERS):
        found = document.get(name)
        if isinstance(found, dict):  # a wrapper in a wrapper
            return _features(found, file)
        if isinstance(found, list):
            return found
        if found is not None or (name == "features" and document.get("type") == "FeatureCollection"):
            raise InputError("must be a list", file, None, name, found)
    if document.get("type") == "Feature" or ed.is_ed269(document):
        return [document]
    if "coordinates" in document or "geometries" in document:
        return [{"type": "Feature", "geometry": document, "properties": {}}]
    raise InputError("is not GeoJSON, nor ED-269", file, remedy="expected a FeatureCollection, or a list of zones")


def _label(feature: object, number: int) -> str:
    """Return the designation of a feature in its file, for people: its number, and its name if it has one."""
    names: list[str] = []
    if isinstance(feature, dict):
        properties = feature.get("properties")
        places = (feature, properties if isinstance(properties, dict) else {})
        names = [
            ed.text_of(one[key]) for key in ("identifier", "id", "name", "title") for one in places if one.get(key)
        ]
    return f"features[{number}]" + (f" {names[0][:60]}" if names and names[0] else "")
