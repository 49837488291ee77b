"""Reader of QGroundControl ``.plan`` files and older ``.mission`` files.

Format: "Plan File Format" of the QGroundControl developer guide. Simple items come in three generations: seven
``params``; four ``params`` and a ``coordinate``; ``param1`` … ``param4`` and a ``coordinate``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.missions.items import fence_items
from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, frame_of
from skyway.missions.items.commands import INDEX_COMMANDS, LOCATED_COMMANDS, Command, command_of
from skyway.missions.items.coordinates import to_e7
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.json_fields import MAX_PARAM, fault, integer, mapping, number, place, sequence, without
from skyway.missions.items.mission import ComplexItem, Home, Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.missions.patterns import patterns
from skyway.missions.patterns.patterns import MAX_ITEMS
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MAX_FAULTS = 20
PLAN_VERSION = 1
MISSION_VERSION = 2
UNKNOWN_KEY = "skywayUnknown"
"""Key of ours in the mission: which of the keys that QGroundControl requires are only filled in."""

_ITEM_KEYS = frozenset({"autoContinue", "command", "doJumpId", "frame", "params", "type"})
_OLD_ITEM_KEYS = _ITEM_KEYS | {"coordinate", "param1", "param2", "param3", "param4", "id"}
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
NO_KEYS: frozenset[str] = frozenset()
_PLAN_KEYS = frozenset({"fileType", "version", "groundStation", "mission", "geoFence", "rallyPoints"})


def loads(data: bytes | str, file: str = "plan") -> MissionDocument:
    """Read the text of a ``.plan`` or ``.mission`` file.

    Parameters
    ----------
    data : bytes or str
        JSON.
    file : str
        Named in errors.

    Raises
    ------
    InputError
        Not JSON, of a version we do not know, with fields that are missing or wrong, or with complex items that
        cannot be expanded.
    """
    try:
        raw = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(Fault(f"is not JSON: {error}", file)) from error
    plan = mapping(raw, file, "the file")
    if "mission" not in plan and "items" in plan:
        mission, strays = _read_mission(plan, file, "")
        return _with_strays(MissionDocument(mission=mission), strays, file)
    if str(plan.get("schema", "")).startswith("skyway.composition"):
        remedy = "make missions of it with skyway mission"
        raise fault("is a composition, not a mission", file, "schema", plan["schema"], remedy)
    kind = plan.get("fileType", "Plan")
    if kind != "Plan":
        raise fault("is not a mission plan", file, "fileType", kind, 'expected "Plan"')
    if "mission" not in plan:
        remedy = "QGroundControl writes one even where it has no items"
        raise fault("is not a mission plan: it has no mission", file, "mission", remedy=remedy)
    version = plan.get("version", PLAN_VERSION)
    if version != PLAN_VERSION:
        raise fault("is an unknown plan version", file, "version", version, f"expected {PLAN_VERSION}")
    mission, strays = _read_mission(mapping(plan["mission"], file, "mission"), file, "mission.")
    document = MissionDocument(
        mission,
        _read_fence(mapping(plan.get("geoFence") or {}, file, "geoFence"), file),
        _read_rally(mapping(plan.get("rallyPoints") or {}, file, "rallyPoints"), file),
        without(plan, _PLAN_KEYS),
    )
    return _with_strays(document, strays, file)


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


def _read_mission(source: Mapping[str, Any], file: str, at: str) -> tuple[Mission, list[MissionItem]]:
    """Return the mission, and the fence and rally points that stood among its items."""
    version = source.get("version", MISSION_VERSION)
    if version not in (MISSION_VERSION, "1.0"):
        remedy = f"version {MISSION_VERSION} is understood"
        raise fault("is an unknown mission version", file, f"{at}version", version, remedy)
    raw_items = sequence(source.get("items"), file, f"{at}items")
    if len(raw_items) > MAX_ITEMS:
        raise fault(f"has more than {MAX_ITEMS} items", file, f"{at}items", len(raw_items))
    if source.get("complexItems"):
        raise fault("not supported: complex items of the oldest format", file, f"{at}complexItems")
    items, ids, complex_items = _read_items(raw_items, file, f"{at}items")
    strays = [item for item in items if fence_items.is_fence_item(item) or fence_items.is_rally_item(item)]
    if strays:
        outside = set(strays)
        kept = [number for number, item in enumerate(items) if item not in outside]
        items, ids, complex_items = [items[n] for n in kept], [ids[n] for n in kept], ()
    unknown = source.get(UNKNOWN_KEY)
    source = without(source, frozenset(str(key) for key in unknown) if isinstance(unknown, list) else NO_KEYS)

    def optional(key: str) -> float | None:
        return None if source.get(key) is None else number(source[key], file, f"{at}{key}")

    def optional_int(key: str) -> int | None:
        return None if source.get(key) is None else integer(source[key], file, f"{at}{key}", most=255)

    mission = Mission(
        _resolve_jumps(items, ids, file, f"{at}items"),
        _read_home(source.get("plannedHomePosition"), file, f"{at}plannedHomePosition"),
        optional("cruiseSpeed"),
        optional("hoverSpeed"),
        optional_int("firmwareType" if at or "MAV_AUTOPILOT" not in source else "MAV_AUTOPILOT"),
        optional_int("vehicleType"),
        complex_items,
        without(source, _MISSION_KEYS if at else _MISSION_KEYS | _OLD_FILE_KEYS),
    )
    return mission, strays


def _read_home(value: object, file: str, field: str) -> Home | None:
    if isinstance(value, dict):  # the first generation kept home as an item
        value = value.get("coordinate")
    if value is None:
        return None
    triple = sequence(value, file, field)
    if len(triple) > 1 and triple[0] in (None, 0) and triple[1] in (None, 0):
        return None  # fences without a mission, and generators that know no home
    altitude = number(triple[2], file, f"{field}[2]") if len(triple) > 2 and triple[2] is not None else None
    return Home(place(triple, file, field), altitude)


def _read_items(
    raw_items: object, file: str, at: str
) -> tuple[list[MissionItem], list[int | None], tuple[ComplexItem, ...]]:
    """Return the items with complex ones expanded, the doJumpId of each, and the complex ones."""
    items: list[MissionItem] = []
    ids: list[int | None] = []
    complex_items: list[ComplexItem] = []
    faults: list[Fault] = []
    for index, raw in enumerate(sequence(raw_items, file, at)):
        field = f"{at}[{index}]"
        try:
            source = mapping(raw, file, field)
            if source.get("type", "SimpleItem") in ("SimpleItem", "missionItem"):
                items.append(_read_item(source, file, field))
                ids.append(_jump_id(source, file, field))
                continue
            inner, is_built = patterns.expand(source, len(items), file, field)
            expanded = [_read_item(mapping(i, file, field), file, field) for i in inner]
            complex_items.append(ComplexItem(len(items), len(expanded), source, is_built))
            items += expanded
            ids += [_jump_id(i, file, field) for i in inner]
        except InputError as error:
            faults += error.faults
            if len(faults) >= MAX_FAULTS:
                break
    if faults:
        raise InputError(faults[:MAX_FAULTS])
    return items, ids, tuple(complex_items)


def _jump_id(source: Mapping[str, Any], file: str, field: str) -> int | None:
    value = source.get("doJumpId")
    return None if value is None else integer(value, file, f"{field}.doJumpId", most=2**31 - 1)


def _parameters(source: Mapping[str, Any], file: str, field: str) -> list[Any]:
    """Return seven raw parameters, whatever generation the item is of."""
    if "params" in source:
        raw = list(sequence(source["params"], file, f"{field}.params"))
    else:
        raw = [source.get(f"param{i}", 0) for i in (1, 2, 3, 4)]
    if "coordinate" in source and len(raw) == 7:
        problem = "repeats, perhaps differently, the seven parameters: QGroundControl refuses such a plan"
        raise fault(problem, file, f"{field}.coordinate", source["coordinate"], "remove it, or parameters 5 to 7")
    if "coordinate" in source:
        raw += [*sequence(source["coordinate"], file, f"{field}.coordinate")]
    if len(raw) != 7:
        raise fault("does not have 7 parameters", file, f"{field}.params", len(raw))
    return raw


def _read_item(source: Mapping[str, Any], file: str, field: str) -> MissionItem:
    if "command" not in source or "frame" not in source:
        missing = "command" if "command" not in source else "frame"
        raise fault("is missing", file, f"{field}.{missing}")
    command = command_of(integer(source["command"], file, f"{field}.command", most=65535))
    frame = frame_of(integer(source["frame"], file, f"{field}.frame", most=255))
    raw = _parameters(source, file, field)
    values = [
        value if type(value) is float and abs(value) < MAX_PARAM else number(value, file, f"{field}.params")
        for value in raw
    ]
    if command in LOCATED_COMMANDS and frame in GLOBAL_FRAMES:
        if raw[4] is not None and raw[5] is not None:
            place(raw[4:6], file, f"{field}.params[4:6]")
    else:
        for i in (4, 5):
            if abs(values[i]) > MAX_PARAM:
                raise fault("is too large for a mission", file, f"{field}.params[{i}]", raw[i])
    autocontinue = source.get("autoContinue", True)
    if not isinstance(autocontinue, (bool, int)):
        raise fault("is neither true nor false", file, f"{field}.autoContinue", autocontinue)
    extra = without(source, _OLD_ITEM_KEYS)
    return MissionItem(
        command,
        frame,
        values[0],
        values[1],
        values[2],
        values[3],
        None if raw[4] is None else to_e7(values[4]),
        None if raw[5] is None else to_e7(values[5]),
        values[6],
        bool(autocontinue),
        extra,
    )


def _resolve_jumps(items: list[MissionItem], ids: list[int | None], file: str, at: str) -> tuple[MissionItem, ...]:
    """Turn references by doJumpId into item numbers; one that leads nowhere stays out of range."""
    if not any(item.command in INDEX_COMMANDS for item in items):
        return tuple(items)
    numbers: dict[int, int] = {}
    repeated: set[int] = set()
    for index, jump_id in enumerate(ids):
        if jump_id is None:
            continue
        if jump_id in numbers:
            repeated.add(jump_id)
        numbers[jump_id] = index
    for index, item in enumerate(items):
        wanted = item.jump_target
        if wanted is None or (item.command == Command.DO_SET_MISSION_CURRENT and wanted < 0):
            continue
        if wanted in repeated:
            problem = f"the jump of item {index} is ambiguous: several items have doJumpId {wanted}"
            raise fault(problem, file, f"{at}.doJumpId", wanted, "number the items one by one")
        target = numbers.get(wanted, wanted - 1)
        if wanted not in numbers and 0 <= target < len(items):
            target += len(items)
        items[index] = replace(item, param1=float(target))
    return tuple(items)


def _read_fence(source: Mapping[str, Any], file: str) -> Geofence:
    version = source.get("version", 2)
    if version not in (1, 2):
        raise fault("is an unknown fence version", file, "geoFence.version", version, "1 and 2 are understood")
    polygons: list[FencePolygon] = []
    old = source.get("polygon")  # version 1: one polygon to stay inside
    if old:
        polygons.append(FencePolygon(_vertices(old, file, "geoFence.polygon")))
    for index, raw in enumerate(sequence(source.get("polygons") or [], file, "geoFence.polygons")):
        field = f"geoFence.polygons[{index}]"
        entry = mapping(raw, file, field)
        vertices = _vertices(entry.get("polygon"), file, f"{field}.polygon")
        extra = without(entry, frozenset({"polygon", "inclusion", "version"}))
        number(entry.get(fence_items.CLAIMED_COUNT), file, f"{field}.{fence_items.CLAIMED_COUNT}")
        polygons.append(FencePolygon(vertices, _inclusion(entry, file, field), extra))
    circles = []
    for index, raw in enumerate(sequence(source.get("circles") or [], file, "geoFence.circles")):
        field = f"geoFence.circles[{index}]"
        entry = mapping(raw, file, field)
        circles.append(_read_circle(entry, file, field))
    back = source.get("breachReturn")
    return_altitude = 0.0
    if isinstance(back, list) and len(back) > 2 and back[2] is not None:
        return_altitude = number(back[2], file, "geoFence.breachReturn[2]")
    return Geofence(
        tuple(polygons),
        tuple(circles),
        None if not back else place(back, file, "geoFence.breachReturn"),
        return_altitude,
        without(source, frozenset({"polygon", "polygons", "circles", "breachReturn", "version"})),
    )


def _read_circle(entry: Mapping[str, Any], file: str, field: str) -> FenceCircle:
    circle = mapping(entry.get("circle"), file, f"{field}.circle")
    radius = number(circle.get("radius"), file, f"{field}.circle.radius")
    if not radius > 0:
        raise fault("is not a positive length", file, f"{field}.circle.radius", circle.get("radius"))
    extra = dict(without(entry, frozenset({"circle", "inclusion", "version"})))
    inner = without(circle, frozenset({"center", "radius"}))
    if inner:
        extra["circle"] = inner
    center = place(circle.get("center"), file, f"{field}.circle.center")
    return FenceCircle(center, radius, _inclusion(entry, file, field), extra)


def _inclusion(entry: Mapping[str, Any], file: str, field: str) -> bool:
    value = entry.get("inclusion")
    if not isinstance(value, bool):
        raise fault("is neither true nor false", file, f"{field}.inclusion", value)
    return value


def _vertices(value: object, file: str, field: str) -> tuple[Any, ...]:
    raw = sequence(value, file, field)
    if len(raw) > MAX_ITEMS:
        raise fault(f"has more than {MAX_ITEMS} vertices", file, field, len(raw))
    vertices = tuple(place(vertex, file, f"{field}[{i}]") for i, vertex in enumerate(raw))
    if len(vertices) < 3:
        raise fault("is not a polygon: it has fewer than 3 vertices", file, field, len(vertices))
    return vertices


def _read_rally(source: Mapping[str, Any], file: str) -> RallyPoints:
    version = source.get("version", 2)
    if version not in (1, 2):
        raise fault(
            "is an unknown rally version",
            file,
            "rallyPoints.version",
            version,
            "1 and 2 are understood",
        )
    points = []
    for index, raw in enumerate(sequence(source.get("points") or [], file, "rallyPoints.points")):
        field = f"rallyPoints.points[{index}]"
        point = place(raw, file, field)
        altitude = number(raw[2], file, f"{field}[2]") if len(raw) > 2 and raw[2] is not None else 0.0
        points.append(RallyPoint(point, altitude))
    return RallyPoints(tuple(points), without(source, frozenset({"points", "version"})))
