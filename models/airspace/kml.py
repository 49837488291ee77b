"""Zones of KML and KMZ: polygons of Google Earth and the map services of some authorities.

Limits and kind are in ``ExtendedData``, under the names of `models.airspace.geojson`. Altitudes of the corners define how a
polygon is drawn, not where the zone ends: they are not limits.
"""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from skyway.models.airspace import areas
from skyway.models.airspace.geojson import zone_of
from skyway.models.airspace.notes import CLOSES_NOTHING
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import shapely

    from skyway.models.airspace.areas import Place
    from skyway.models.airspace.notes import Notes
    from skyway.models.airspace.zone import Zone

MAX_DEPTH = 200


def unpacked(data: bytes, file: str, max_bytes: int) -> bytes:
    """Return the KML inside a KMZ."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            if not names:
                raise InputError("has no .kml", file, remedy="a KMZ file is a ZIP archive with one")
            name = "doc.kml" if "doc.kml" in names else names[0]
            with archive.open(name) as stream:
                text = stream.read(max_bytes + 1)
    except (zipfile.BadZipFile, OSError, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"is not a valid KMZ file: {error}", file) from error
    if len(text) > max_bytes:
        raise InputError(f"holds more than {max_bytes / 1e6:.0f} MB", file)
    return text


def read_kml(text: str, notes: Notes, source: str) -> list[Zone]:
    """Return the zones of the placemarks that have areas; a placemark without one is a fault."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("has a document type", source, remedy="KML needs none: take the line <!DOCTYPE …> out")
    try:
        root = ET.fromstring(text)  # noqa: S314  without a document type there are no entities to expand
    except (ET.ParseError, RecursionError, ValueError) as error:
        raise InputError(f"is not XML: {error}", source) from error
    if _name(root) != "kml":
        raise InputError("is not KML", source, None, "root element", _name(root))
    zones = []
    for number, placemark in enumerate(one for one in root.iter() if _name(one) == "Placemark"):
        label = _text(placemark, "name") or f"Placemark {number + 1}"
        notes.at(label)
        parts = [_polygon(one, notes) for one in placemark.iter() if _name(one) == "Polygon"]
        if not parts:
            others = [
                _name(one)
                for one in placemark.iter()
                if _name(one) in ("Point", "LineString", "LinearRing", "Model", "Track")
            ]
            if others == ["Point"]:
                notes.closed(
                    "geometry", "is a point: a label, no area", None, f"{CLOSES_NOTHING}; draw a polygon if it should"
                )
            else:
                notes.wrong("geometry", "is not a polygon", others[0] if others else None, "zones are polygons")
            continue
        if any(part is None for part in parts):
            continue
        area = areas.joined([part for part in parts if part is not None])
        properties = {"name": label, "description": "", **dict(_data(placemark))}
        zones.append(zone_of(properties, area, str(placemark.get("id") or ""), notes, source))
    return zones


def _name(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _text(element: ET.Element, name: str) -> str:
    return next(((child.text or "").strip() for child in element if _name(child) == name), "")


def _data(placemark: ET.Element) -> Iterator[tuple[str, object]]:
    for one in placemark.iter():
        key = one.get("name")
        if key and _name(one) == "Data":
            yield key, next(((child.text or "").strip() for child in one if _name(child) == "value"), "")
        elif key and _name(one) == "SimpleData":
            yield key, (one.text or "").strip()


def _polygon(element: ET.Element, notes: Notes) -> shapely.Geometry | None:
    rings: list[list[Place]] = []
    for boundary in ("outerBoundaryIs", "innerBoundaryIs"):
        for one in element.iter():
            if _name(one) == boundary:
                rings += [_ring(child, notes) for child in one.iter() if _name(child) == "coordinates"]
    return areas.polygon(rings, notes) if all(rings) else None


def _ring(element: ET.Element, notes: Notes) -> list[Place]:
    found = []
    for part in (element.text or "").split():
        try:
            lon, lat = (float(number) for number in part.split(",")[:2])
        except ValueError:
            notes.wrong("coordinates", "is not a position", part, "longitude,latitude[,altitude]")
            return []
        found.append((lon, lat))
    if not found:
        notes.wrong("coordinates", "has no coordinates", None, "longitude,latitude[,altitude] …")
    return found
