"""The simulator speaks by pymavlink's code: what the ground side frames and reads is judged by other code."""

import math
import random
from pathlib import Path
from xml.etree import ElementTree as ET

import pymavlink
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from skyway.link.wire.frames import FrameReader, FrameWriter
from skyway.link.wire.signing import Signing
from skyway.sim_stub.protocols.telemetry import BUILDERS
from skyway.sim_stub.wire.messages import Mavlink, base_bytes, classes, message, message_name

KEY = bytes(range(32))
ANSWERS = (
    *("AUTOPILOT_VERSION", "COMMAND_ACK", "MISSION_ACK", "MISSION_COUNT", "MISSION_ITEM", "MISSION_ITEM_INT"),
    *("MISSION_REQUEST", "MISSION_REQUEST_INT", "PARAM_VALUE", "PING", "STATUSTEXT", "TIMESYNC", "MESSAGE_INTERVAL"),
)
SIZES = {"char": 1, "uint8_t": 1, "int8_t": 1, "uint16_t": 2, "int16_t": 2, "uint32_t": 4, "int32_t": 4, "float": 4}


def values_of(cls, rng):
    values = []
    for kind, name in zip(cls.fieldtypes, cls.fieldnames, strict=True):
        array = cls.array_lengths[cls.ordered_fieldnames.index(name)]
        if kind == "char":
            values.append(b"x" * min(array or 1, 5))
            continue
        pick = (lambda: rng.random() * 100) if kind in ("float", "double") else (lambda: rng.randint(0, 100))
        values.append([pick() for _ in range(array)] if array else pick())
    return values


@pytest.mark.parametrize("number", sorted(dialect.mavlink_map))
def test_every_message_of_the_dialect_reads_on_the_ground_as_pymavlink_wrote_it(number):
    cls = dialect.mavlink_map[number]
    values = values_of(cls, random.Random(number))
    try:
        frame = cls(*values).pack(dialect.MAVLink(None, 1, 1))
    except Exception as error:  # noqa: BLE001  pymavlink cannot pack a few messages of its own
        pytest.skip(f"pymavlink cannot pack {cls.msgname}: {error}")
    ((whole, read),) = FrameReader().feed(frame)
    assert whole == frame
    assert read.name == cls.msgname
    sent = cls(*values).to_dict()
    for name, value in read.fields.items():
        if name in sent and not isinstance(value, (str, tuple)):
            assert math.isclose(value, sent[name], rel_tol=1e-6)


def heard(mavlink, frame):
    return [(m.get_type(), m.get_srcSystem()) for m in mavlink.hear(frame, whole=True)]


@pytest.mark.parametrize("version", [1, 2])
def test_what_the_ground_frames_is_read_by_pymavlink_and_the_other_way_round(version):
    ours = FrameWriter(255, 190, version).frame("COMMAND_LONG", {"command": 400, "param1": 1.0, "target_system": 1})
    (got,) = Mavlink(1).hear(ours, whole=True)
    assert (got.get_type(), got.command, got.param1, got.get_srcSystem()) == ("COMMAND_LONG", 400, 1.0, 255)
    theirs = Mavlink(7).frame(message("MISSION_CURRENT", seq=3, total=9, mission_id=77), version)
    ((_, read),) = FrameReader().feed(theirs)
    assert (read.name, read["seq"], read.system) == ("MISSION_CURRENT", 3, 7)


def test_a_mavlink_1_frame_ends_where_the_definitions_of_mavlink_begin_to_extend_it():
    folder = Path(pymavlink.__file__).parent / "dialects" / "v20"
    found = {}
    for file in ("common.xml", "standard.xml", "minimal.xml", "ardupilotmega.xml"):
        for one in ET.parse(folder / file).getroot().iter("message"):
            kinds = []
            for child in one:
                if child.tag == "extensions":
                    break
                if child.tag == "field":
                    kind, _, count = child.get("type").partition("[")
                    kind = kind.removesuffix("_mavlink_version")
                    kinds.append(SIZES.get(kind, 8) * int(count.rstrip("]") or 1))
            found[one.get("name")] = sum(kinds)
    found["ESC_INFO"] = 46  # of common.xml, but not of pymavlink's copy
    sent = {*ANSWERS, *map(message_name, BUILDERS)}
    assert {name: base_bytes(name) for name in sent} == {name: found[name] for name in sent}
    for name in sorted(sent):
        frame = Mavlink(1).frame(message(name), 1)
        if frame is not None:
            assert frame[1] == found[name]


def test_an_absurd_value_is_clipped_to_what_the_wire_can_carry():
    frame = Mavlink(1).frame(message("GLOBAL_POSITION_INT", lat=1e30, vx=-99999, hdg=-1))
    (read,) = Mavlink(2).hear(frame, whole=True)
    assert (read.lat, read.vx, read.hdg) == (2**31 - 1, -32768, 0)


@settings(max_examples=200)
@given(st.binary(max_size=600), st.integers(1, 40))
def test_a_good_message_is_found_behind_any_garbage(garbage, cut):
    frame = Mavlink(9).frame(message("HEARTBEAT", custom_mode=5))
    whole = Mavlink(1)
    whole.hear(garbage, whole=True)
    assert [m.custom_mode for m in whole.hear(frame, whole=True)] == [5]
    stream, data = Mavlink(1), garbage + bytes(300) + frame * 2
    found = [m for i in range(0, len(data), cut) for m in stream.hear(data[i : i + cut], whole=False)]
    assert any(m.custom_mode == 5 for m in found if m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 9)
    assert len(stream.buf) < 300


def test_signed_links_understand_each_other_and_refuse_replays_forgeries_and_the_unsigned():
    vehicle, writer = Mavlink(1), FrameWriter(255, 190, signing=Signing(KEY, timestamp=5_000_000))
    vehicle.sign(KEY, 5_000_000, 0.0)
    beat = {"type": 6, "autopilot": 8}
    first = writer.frame("HEARTBEAT", beat)
    assert heard(vehicle, first) == [("HEARTBEAT", 255)]
    assert heard(vehicle, first) == [], "the same frame again is a replay"
    assert heard(vehicle, FrameWriter(255, 190).frame("HEARTBEAT", beat)) == [], "unsigned"
    forger = FrameWriter(255, 190, signing=Signing(bytes(32), timestamp=9_000_000_000))
    assert heard(vehicle, forger.frame("HEARTBEAT", beat)) == [], "forged, and from the future"
    assert heard(vehicle, writer.frame("HEARTBEAT", beat)) == [("HEARTBEAT", 255)], "the genuine one goes on"
    reader = FrameReader(signing=Signing(KEY))
    ((_, got),) = reader.feed(vehicle.frame(message("HEARTBEAT")))
    assert (got.name, got.system) == ("HEARTBEAT", 1)
    assert len(classes()) > 250
