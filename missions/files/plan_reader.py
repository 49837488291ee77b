"""Reader of QGroundControl ``.plan`` files and older ``.mission`` files.

Format: "Plan File Format" of the QGroundControl developer guide. Simple items come in three generations: seven
``params``; four ``params`` and a ``coordinate``; ``param1`` … ``param4`` and a ``coordinate``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.missions.files.jumps import resolved
from skyway.missions.items import fence_items
from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, frame_of
from skyway.missions.items.commands import LOCATED_COMMANDS, command_of
from skyway.missions.items.coordinates import Point, to_e7
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.json_fields import MAX_PARAM, JsonField
from skyway.missions.items.mission import ComplexItem, Home, Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.missions.patterns import patterns
from skyway.missions.patterns.patterns import MAX_ITEMS
from skyway.models.base.errors import Fault, InputError, refuse

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_FAULTS = 20
PLAN_VERSION = 1
MISSION_VERSION = 2
UNKNOWN_KEY = "skywayUnknown"
"""Key of ours in the mission: the keys required by QGroundControl that are only placeholders."""

_NUMBERS = (int, float)
_OLD_PARAMS = ("param1", "param2", "param3", "param4")
_ITEM_KEYS = frozenset({"autoContinue", "command", "doJumpId", "frame", "params", "type"})
_OLD_ITEM_KEYS = _ITEM_KEYS | {"coordinate", *_OLD_PARAMS, "id"}
_MISSION_KEYS = frozenset(
    {
        "items",
        "plannedHomePosition",
        "cruiseSpeed",
        "hoverSpeed",
        "firmwareType",
        "vehicleType",
        "version",
        UNKNOWN_KEY,
    }
)
_OLD_FILE_KEYS = frozenset({"groundStation", "MAV_AUTOPILOT", "complexItems"})
"""Keys of a ``.mission`` file besides those of a mission."""
_PLAN_KEYS = frozenset({"fileType", "version", "groundStation", "mission", "geoFence", "rallyPoints"})


def loads(data: bytes | str, file: str = "plan") -> MissionDocument:
    """Read the text of a ``.plan`` or ``.mission`` file, which errors name.

    An `InputError` refuses a text that is not JSON, of an unknown version, with fields that are missing or wrong, or
    with complex items that cannot be expanded.
    """
    try:
        raw = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", file) from error
    plan = JsonField(raw, file)
    if "mission" not in plan and "items" in plan:
        mission, strays = _read_mission(plan, old=True)
        return _with_strays(MissionDocument(mission=mission), strays, file)
    if str(plan["schema"].value or "").startswith("skyway.composition"):
        remedy = "make missions of it with skyway mission"
        raise plan["schema"].fault("is a composition, not a mission", plan["schema"].value, remedy)
    kind = plan.get("fileType", "Plan")
    if kind.value != "Plan":
        raise kind.fault("is not a mission plan", kind.value, 'expected "Plan"')
    if "mission" not in plan:
        remedy = "QGroundControl writes one even where it has no items"
        raise plan["mission"].fault("is not a mission plan: it has no mission", remedy=remedy)
    _check_version(plan, "plan", PLAN_VERSION)
    mission, strays = _read_mission(plan["mission"])
    fence, rally = (plan[key].of(plan[key].value or {}) for key in ("geoFence", "rallyPoints"))
    document = MissionDocument(mission, _read_fence(fence), _read_rally(rally), plan.without(*_PLAN_KEYS))
    return _with_strays(document, strays, file)


def _check_version(source: JsonField, what: str, *known: object) -> None:
    """Refuse unknown versions; without a version, the last known one is assumed."""
    version = source.get("version", known[-1])
    if version.value not in known:
        raise version.fault(f"is an unknown {what} version", version.value, f"known: {', '.join(map(str, known))}")


def _with_strays(document: MissionDocument, strays: Sequence[MissionItem], file: str) -> MissionDocument:
    """Move fence and rally items out of the mission into fence and rally points."""
    if not strays:
        return document
    fence = fence_items.to_fence([item for item in strays if fence_items.is_fence_item(item)], file)
    rally = fence_items.to_rally([item for item in strays if fence_items.is_rally_item(item)], file)
    return replace(
        document,
        fence=fence_items.merge(document.fence, fence),
        rally=replace(document.rally, points=(*document.rally.points, *rally.points)),
    )


def _read_mission(source: JsonField, *, old: bool = False) -> tuple[Mission, list[MissionItem]]:
    """Return the mission, and the fence and rally points among its items; `old`: of a ``.mission`` file."""
    _check_version(source, "mission", "1.0", MISSION_VERSION)
    raw_items = source["items"]
    if len(raw_items.elements()) > MAX_ITEMS:
        raise raw_items.fault(f"has more than {MAX_ITEMS} items", len(raw_items.value))
    if source["complexItems"].value:
        raise source["complexItems"].fault("not supported: complex items of the oldest format")
    items, ids, complex_items = _read_items(raw_items)
    strays = [item for item in items if fence_items.is_fence_item(item) or fence_items.is_rally_item(item)]
    if strays:
        outside = set(strays)
        kept = [number for number, item in enumerate(items) if item not in outside]
        items, ids, complex_items = [items[n] for n in kept], [ids[n] for n in kept], ()
    unknown = source[UNKNOWN_KEY].value
    source = source.of(source.without(*map(str, unknown if isinstance(unknown, list) else ())))

    def kind(key: str) -> int | None:
        return None if source[key].value is None else source[key].whole(most=255)

    def ambiguous(index: int, wanted: int) -> InputError:
        problem = f"the jump of item {index} is ambiguous: several items have doJumpId {wanted}"
        return raw_items.fault(problem, wanted, "number the items one by one")

    mission = Mission(
        resolved(items, ids, 1, ambiguous),
        _read_home(source["plannedHomePosition"]),
        source["cruiseSpeed"].number_or_none(),
        source["hoverSpeed"].number_or_none(),
        kind("MAV_AUTOPILOT" if old and "MAV_AUTOPILOT" in source else "firmwareType"),
        kind("vehicleType"),
        complex_items,
        source.without(*_MISSION_KEYS, *(_OLD_FILE_KEYS if old else ())),
    )
    return mission, strays


def _read_home(home: JsonField) -> Home | None:
    if isinstance(home.value, dict):  # the first generation kept home as an item
        home = home.of(home.value.get("coordinate"))
    if home.value is None:
        return None
    triple = home.elements()
    if len(triple) > 1 and triple[0].value in (None, 0) and triple[1].value in (None, 0):
        return None  # fences without a mission, and generators without a home
    return Home(home.place(), triple[2].number_or_none() if len(triple) > 2 else None)


def _read_items(raw_items: JsonField) -> tuple[list[MissionItem], list[int | None], tuple[ComplexItem, ...]]:
    """Return the items with complex ones expanded, the doJumpId of each, and the complex ones."""
    items: list[MissionItem] = []
    ids: list[int | None] = []
    complex_items: list[ComplexItem] = []
    faults: list[Fault] = []
    for source in raw_items.elements():
        try:
            if source.mapping().get("type", "SimpleItem") in ("SimpleItem", "missionItem"):
                items.append(_read_item(source))
                ids.append(_jump_id(source))
                continue
            inner, is_built = patterns.expand(source, len(items))
            expanded = [source.of(one) for one in inner]
            complex_items.append(ComplexItem(len(items), len(expanded), source.mapping(), is_built))
            items += [_read_item(one) for one in expanded]
            ids += [_jump_id(one) for one in expanded]
        except InputError as error:
            faults += error.faults
            if len(faults) >= MAX_FAULTS:
                break
    refuse(faults[:MAX_FAULTS])
    return items, ids, tuple(complex_items)


def _jump_id(source: JsonField) -> int | None:
    value = source["doJumpId"]
    return None if value.value is None else value.whole(most=2**31 - 1)


def _parameters(source: JsonField) -> list[Any]:
    """Return seven raw parameters, for an item of any generation."""
    fields = source.mapping()
    raw = [*source["params"].sequence()] if "params" in fields else [fields.get(key, 0) for key in _OLD_PARAMS]
    if "coordinate" in fields:
        place = source["coordinate"]
        if len(raw) == 7:
            problem = "repeats, perhaps differently, the seven parameters: QGroundControl refuses such a plan"
            raise place.fault(problem, place.value, "remove it, or parameters 5 to 7")
        raw += place.sequence()
    if len(raw) != 7:
        raise source["params"].fault("does not have 7 parameters", len(raw))
    return raw


def _read_item(source: JsonField) -> MissionItem:
    """Read an item; files contain up to 100,000, so fields are named only if they are wrong."""
    fields = source.mapping()
    for key in ("command", "frame"):
        if key not in fields:
            raise source[key].fault("is missing")
    command, frame = command_of(source["command"].whole(most=65535)), frame_of(source["frame"].whole(most=255))
    raw, params = _parameters(source), source["params"]
    values = [float(v) if type(v) in _NUMBERS and abs(v) < MAX_PARAM else params.of(v).number() for v in raw]
    one, two, three, four, lat, lon, z = values
    if command in LOCATED_COMMANDS and frame in GLOBAL_FRAMES:
        if raw[4] is not None and raw[5] is not None and not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            JsonField(raw[4:6], source.file, f"{params.name}[4:6]").place()
    else:
        for i in (4, 5):
            if abs(values[i]) > MAX_PARAM:
                raise JsonField(raw[i], source.file, f"{params.name}[{i}]").fault("is too large for a mission", raw[i])
    autocontinue = fields.get("autoContinue", True)
    if not isinstance(autocontinue, (bool, int)):
        raise source["autoContinue"].fault("is neither true nor false", autocontinue)
    return MissionItem(
        command,
        frame,
        one,
        two,
        three,
        four,
        None if raw[4] is None else to_e7(lat),
        None if raw[5] is None else to_e7(lon),
        z,
        bool(autocontinue),
        source.without(*_OLD_ITEM_KEYS),
    )


def _read_fence(source: JsonField) -> Geofence:
    _check_version(source, "fence", 1, 2)
    polygons: list[FencePolygon] = []
    if source["polygon"].value:  # version 1: one polygon to stay inside
        polygons.append(FencePolygon(_vertices(source["polygon"])))
    for entry in _list(source["polygons"]):
        vertices, extra = _vertices(entry["polygon"]), entry.without("polygon", "inclusion", "version")
        entry[fence_items.CLAIMED_COUNT].number()
        polygons.append(FencePolygon(vertices, entry["inclusion"].flag(), extra))
    circles = [_read_circle(entry) for entry in _list(source["circles"])]
    back = source["breachReturn"]
    return_altitude = None
    if isinstance(back.value, list) and len(back.value) > 2:
        return_altitude = back[2].number_or_none()
    return Geofence(
        tuple(polygons),
        tuple(circles),
        back.place() if back.value else None,
        return_altitude or 0.0,
        source.without("polygon", "polygons", "circles", "breachReturn", "version"),
    )


def _list(field: JsonField) -> list[JsonField]:
    """Elements of a list that may be omitted."""
    return field.elements() if field.value else []


def _read_circle(entry: JsonField) -> FenceCircle:
    circle = entry["circle"]
    radius = circle["radius"].number()
    if not radius > 0:
        raise circle["radius"].fault("is not a positive length", circle["radius"].value)
    extra = dict(entry.without("circle", "inclusion", "version"))
    if inner := circle.without("center", "radius"):
        extra["circle"] = inner
    return FenceCircle(circle["center"].place(), radius, entry["inclusion"].flag(), extra)


def _vertices(polygon: JsonField) -> tuple[Point, ...]:
    vertices = polygon.elements()
    if len(vertices) > MAX_ITEMS:
        raise polygon.fault(f"has more than {MAX_ITEMS} vertices", len(vertices))
    if len(vertices) < 3:
        raise polygon.fault("is not a polygon: it has fewer than 3 vertices", len(vertices))
    return tuple(vertex.place() for vertex in vertices)


def _read_rally(source: JsonField) -> RallyPoints:
    _check_version(source, "rally", 1, 2)
    points = []
    for entry in _list(source["points"]):
        point, rest = entry.place(), entry.elements()[2:]
        points.append(RallyPoint(point, (rest[0].number_or_none() if rest else None) or 0.0))
    return RallyPoints(tuple(points), source.without("points", "version"))
