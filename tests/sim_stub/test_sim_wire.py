"""Frames of our own making are what pymavlink reads and writes."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from skyway.sim_stub.wire.frames import FrameReader, FrameWriter, Signing
from skyway.sim_stub.wire.messages import spec, specs


def peer() -> dialect.MAVLink:
    mav = dialect.MAVLink(None, 255, 190)
    mav.robust_parsing = True
    return mav


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
def test_every_message_of_the_dialect_reads_as_pymavlink_wrote_it(number):
    cls = dialect.mavlink_map[number]
    values = values_of(cls, random.Random(number))
    try:
        frame = cls(*values).pack(peer())
    except Exception as error:  # noqa: BLE001  pymavlink cannot pack a few messages of its own
        pytest.skip(f"pymavlink cannot pack {cls.msgname}: {error}")
    (message,) = FrameReader().feed(frame)
    assert message.name == cls.msgname
    sent = cls(*values).to_dict()
    for name, value in message.fields.items():
        if name in sent and not isinstance(value, (str, tuple)):
            assert math.isclose(value, sent[name], rel_tol=1e-6)


def test_pymavlink_reads_our_frames_with_and_without_extensions():
    for version in (1, 2):
        writer = FrameWriter(7, 1, version)
        frame = writer.frame(spec("MISSION_ACK"), spec("MISSION_ACK").pack({"type": 3, "opaque_id": 77}))
        (got,) = peer().parse_buffer(frame)
        assert (got.get_type(), got.type, got.get_srcSystem()) == ("MISSION_ACK", 3, 7)


@pytest.mark.parametrize("name", ["MISSION_ACK", "COMMAND_ACK", "BATTERY_STATUS", "STATUSTEXT", "SYS_STATUS"])
def test_a_mavlink_1_frame_carries_no_extension_fields(name):
    sizes = {"MISSION_ACK": 3, "COMMAND_ACK": 3, "BATTERY_STATUS": 36, "STATUSTEXT": 51, "SYS_STATUS": 31}
    frame = FrameWriter(1, 1, 1).frame(spec(name), spec(name).pack({}))
    assert frame[1] == sizes[name]


def test_an_absurd_value_is_clipped_to_what_the_wire_can_carry():
    payload = spec("GLOBAL_POSITION_INT").pack({"lat": 1e30, "vx": -99999, "hdg": -1})
    fields = spec("GLOBAL_POSITION_INT").unpack(payload)
    assert (fields["lat"], fields["vx"], fields["hdg"]) == (2**31 - 1, -32768, 0)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=600), st.integers(1, 40))
def test_a_good_message_is_found_behind_any_garbage(garbage, cut):
    frame = FrameWriter(9, 1).frame(spec("HEARTBEAT"), spec("HEARTBEAT").pack({"custom_mode": 5}))
    whole = FrameReader(whole=True)
    list(whole.feed(garbage))
    assert [m["custom_mode"] for m in whole.feed(frame)] == [5]
    stream, data = FrameReader(), garbage + frame + bytes(600)
    found = [m for i in range(0, len(data), cut) for m in stream.feed(data[i : i + cut])]
    assert any(m.system == 9 and m["custom_mode"] == 5 for m in found if m.name == "HEARTBEAT")


def test_signed_frames_are_those_of_pymavlink_and_replays_are_refused():
    key = bytes(range(32))
    mav = peer()
    mav.signing.secret_key = key
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = 5_000_000
    frame = dialect.MAVLink_heartbeat_message(6, 8, 0, 4, 0, 3).pack(mav)
    reader = FrameReader(signing=Signing(key))
    assert len(list(reader.feed(frame))) == 1
    assert not list(reader.feed(frame)), "the same frame again is a replay"
    unsigned = dialect.MAVLink_heartbeat_message(6, 8, 0, 4, 0, 3).pack(peer())
    assert not list(reader.feed(unsigned))
    writer = FrameWriter(1, 1, signing=Signing(key, timestamp=6_000_000))
    (got,) = mav.parse_buffer(writer.frame(spec("HEARTBEAT"), spec("HEARTBEAT").pack({})))
    assert got.get_signed()
    assert len(specs()[0]) > 250
