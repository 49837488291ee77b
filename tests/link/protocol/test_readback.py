"""What was sent and what is aboard are compared field by field; no difference passes, on either way."""

import math
from dataclasses import replace

import pytest
from wires import FAMILIES, Scene, a_mission, as_stored, changed_frame, waypoint

from skyway.link.protocol.verified import UploadState, compare, encode
from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem

OLD = a_mission(5, height=90.0)
AT = 3
"""Number on the wire of the item that is meddled with."""
_DELAY = MissionItem(Command.NAV_DELAY, Frame.MISSION, 30.0, 1.0, 2.0, 3.0)


def new(family, field):
    """A mission whose item 3 on the wire keeps the field: a delay keeps all four parameters, a waypoint its place."""
    items = list(a_mission(6, height=40.0).items)
    if field.startswith("param"):
        items[AT - (family == "ardupilot")] = _DELAY
    return Mission(tuple(items))


CHANGES = {
    "command": lambda f: {"command": 22},
    "frame": lambda f: {"frame": 0},
    "param1": lambda f: {"param1": f["param1"] + 7.0},
    "param2": lambda f: {"param2": f["param2"] + 7.0},
    "param3": lambda f: {"param3": f["param3"] + 7.0},
    "param4": lambda f: {"param4": f["param4"] + 7.0},
    "x": lambda f: {"x": f["x"] + 40},
    "y": lambda f: {"y": f["y"] - 40},
    "z": lambda f: {"z": f["z"] + 1.0},
    "autocontinue": lambda f: {"autocontinue": 0},
    "seq": lambda f: {"seq": f["seq"] + 2},
    "mission_type": lambda f: {"mission_type": 1},
}
FOUND_AS = {"frame": "altitude reference"}
NOT_TAKEN = ("seq", "mission_type")
"""An item with another number, or of another list, is not the one that was waited for: it is asked for again."""


def meaningless(family, field):
    """ArduPilot keeps no autocontinue and always goes on: another value means the same to it."""
    return family == "ardupilot" and field == "autocontinue"


@pytest.mark.parametrize("field", CHANGES)
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("way", ["on its way to the vehicle", "once when read back"])
def test_a_change_in_any_field_is_found_and_put_right(family, field, way):
    changed = []

    def spoil(_number, message, frame, up):
        right_way = up == (way == "on its way to the vehicle")
        if message and message.name == "MISSION_ITEM_INT" and right_way and message["seq"] == AT and not changed:
            changed.append(message["seq"])
            return changed_frame(message, **CHANGES[field](message.fields))
        return frame

    mission = new(family, field)
    scene = Scene(family, spoil=spoil)
    outcome = scene.upload(mission)
    assert changed
    assert outcome.verified
    assert scene.stored() == as_stored(mission)
    kept = way == "on its way to the vehicle" and field not in NOT_TAKEN and not meaningless(family, field)
    assert outcome.attempts == (2 if kept else 1)


@pytest.mark.parametrize("field", CHANGES)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_change_that_stays_is_named_and_never_called_verified(family, field):
    mission = new(family, field)
    before_wire = encode(OLD, family_named(family))

    def spoil(_number, message, frame, up):
        if not (up and message and message.name == "MISSION_ITEM_INT" and message["seq"] == AT):
            return frame
        old = message["seq"] < len(before_wire) and message["x"] == before_wire[AT].x and message["z"] > 85.0
        return frame if old else changed_frame(message, **CHANGES[field](message.fields))

    scene = Scene(family)
    assert scene.upload(OLD).verified
    before = scene.stored()
    scene.link.spoil = spoil
    outcome = scene.upload(mission)
    if meaningless(family, field) or (outcome.verified and field in NOT_TAKEN):
        assert outcome.verified
        assert scene.stored() == as_stored(mission)
        return
    assert outcome.state in (UploadState.ROLLED_BACK, UploadState.REFUSED), outcome
    assert scene.stored() == before
    if field not in NOT_TAKEN:
        assert outcome.differences
        assert {d.item for d in outcome.differences} == {AT - (family == "ardupilot")}
        assert {d.field for d in outcome.differences} == {FOUND_AS.get(field, field)}


@pytest.mark.parametrize("by", [-1, 1])
@pytest.mark.parametrize("up", [True, False], ids=["to the vehicle", "when read back"])
@pytest.mark.parametrize("family", FAMILIES)
def test_another_count_is_found_and_put_right(family, up, by):
    changed = []

    def spoil(_number, message, frame, way):
        if message and message.name == "MISSION_COUNT" and way == up and message["count"] > 1 and not changed:
            changed.append(message["count"])
            return changed_frame(message, count=message["count"] + by)
        return frame

    scene = Scene(family, spoil=spoil)
    mission = a_mission(6, height=40.0)
    outcome = scene.upload(mission)
    assert changed
    assert outcome.verified, outcome
    assert scene.stored() == as_stored(mission)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_field_of_every_item_is_compared_or_means_nothing(family):
    """Without a vehicle: what is read back differs in one field of one item, for all of them."""
    mission = Mission((waypoint(0, command=Command.NAV_TAKEOFF), waypoint(1), _DELAY, waypoint(2)))
    wire = encode(mission, family_named(family))
    assert compare(mission, wire, family_named(family)) == ()
    shift = int(family == "ardupilot")
    missed = set()
    for number in range(shift, len(wire)):
        for field in ("command", "frame", "param1", "param2", "param3", "param4", "x", "y", "z", "autocontinue"):
            was = getattr(wire[number], field)
            other = {"command": 18, "frame": 0, "autocontinue": 0}.get(field, 50.0 if math.isnan(was) else was + 50)
            read = [*wire[:number], replace(wire[number], **{field: other}), *wire[number + 1 :]]
            if not compare(mission, read, family_named(family)):
                missed.add((mission.items[number - shift].name, field))
    assert missed == NOT_KEPT[family]


NOT_KEPT = {
    "px4": {
        *(("NAV_TAKEOFF", f"param{n}") for n in (1, 2, 3)),
        ("NAV_WAYPOINT", "param3"),
        *(("NAV_DELAY", name) for name in ("frame", "x", "y", "z")),
    },
    "ardupilot": {
        *(("NAV_TAKEOFF", f"param{n}") for n in (2, 3, 4)),
        *(("NAV_WAYPOINT", f"param{n}") for n in (2, 3, 4)),
        *(("NAV_DELAY", name) for name in ("frame", "x", "y", "z")),
        *((name, "autocontinue") for name in ("NAV_TAKEOFF", "NAV_WAYPOINT", "NAV_DELAY")),
    },
}
"""What an autopilot does not keep, or does not act on, by command: the documented rule that makes two items equal."""
