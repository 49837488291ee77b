"""Who is believed: the vehicle meant, with its signature, and nobody twice."""

import random
import socket
import time

import pytest
from wires import Scene, a_mission

from skyway.link.protocol.opening import KEY_FILE_VARIABLE, KEY_VARIABLE, open_connection, read_key
from skyway.link.protocol.verified import UploadState
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameReader, FrameWriter
from skyway.link.wire.signing import Signing
from skyway.models.base.errors import InputError

KEY = bytes(range(32))


def test_a_signed_upload_works_and_an_unsigned_station_is_not_heard():
    scene = Scene("px4", signing_key=KEY, signing=Signing(KEY))
    assert scene.upload(a_mission(5)).verified
    deaf = Scene("px4", signing_key=KEY)
    assert deaf.upload(a_mission(5)).state is UploadState.UNKNOWN
    assert deaf.stored() == []


def test_an_unsigned_vehicle_is_not_believed_by_a_station_with_a_key():
    scene = Scene("px4", signing=Signing(KEY))
    scene.connection.run_for(3.0)
    assert scene.connection.peers == {}
    assert scene.connection.rejected.unsigned > 10


def test_forged_and_replayed_packets_are_rejected_and_counted():
    writer = FrameWriter(1, 1, signing=Signing(KEY, 1000))
    reader = FrameReader(Signing(KEY))
    good = writer.frame("HEARTBEAT", {"type": 2})
    assert len(list(reader.feed(good))) == 1
    assert list(reader.feed(good)) == []
    forger = FrameWriter(1, 1, signing=Signing(bytes(32), 10**12))
    assert list(reader.feed(forger.frame("HEARTBEAT", {"type": 2}))) == []
    assert (reader.rejected.replayed, reader.rejected.forged) == (1, 1)


def test_a_forged_packet_from_the_future_does_not_shut_out_the_genuine_sender():
    writer = FrameWriter(1, 1, signing=Signing(KEY, 1000))
    reader = FrameReader(Signing(KEY))
    list(reader.feed(writer.frame("HEARTBEAT", {})))
    list(reader.feed(FrameWriter(1, 1, signing=Signing(bytes(32), 2**47)).frame("HEARTBEAT", {})))
    assert len(list(reader.feed(writer.frame("HEARTBEAT", {})))) == 1


def test_a_recorded_exchange_played_again_changes_nothing():
    heard = []
    scene = Scene("px4", signing_key=KEY, signing=Signing(KEY))
    scene.link.spoil = lambda _n, _m, frame, up: (None if up else heard.append(frame)) or frame
    scene.upload(a_mission(5))
    peer = scene.connection.peers[1]
    before, played = peer.received, list(heard)
    scene.link.inner.inbox.extend(played)
    scene.connection.pump(0.0)
    assert scene.connection.rejected.replayed >= len(played) - 2
    assert peer.received <= before + 2


@pytest.mark.parametrize("who", [(1, 25), (2, 1)])
def test_another_component_or_system_cannot_answer_for_the_vehicle(who):
    scene = Scene("px4")
    liar = FrameWriter(*who)

    def spoil(number, message, frame, up):
        if message and up and message.name == "PARAM_REQUEST_READ":
            lie = {"param_id": "MPC_XY_CRUISE", "param_value": 99.0, "param_count": 9, "param_type": 9}
            scene.link.inner.inbox.append(liar.frame("HEARTBEAT", {"type": 2, "autopilot": 12}))
            scene.link.inner.inbox.append(liar.frame("PARAM_VALUE", lie))
        return frame

    scene.link.spoil = spoil
    scene.meet()
    assert Vehicle(scene.connection, 1).parameter("MPC_XY_CRUISE").value != 99.0


def test_a_companion_computer_that_is_heard_first_is_not_taken_for_the_autopilot():
    scene = Scene("px4")
    companion = FrameWriter(1, 191).frame("HEARTBEAT", {"type": 18, "autopilot": 12, "mavlink_version": 3})
    scene.link.inner.inbox.append(companion)
    scene.connection.pump(0.0)
    assert scene.connection.peers == {}
    assert scene.meet().component == 1


def test_a_key_comes_from_a_file_only_its_owner_may_read_or_from_the_environment(tmp_path, monkeypatch):
    file = tmp_path / "key"
    file.write_text(KEY.hex() + "\n")
    file.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        read_key(file)
    file.chmod(0o600)
    assert read_key(file) == KEY
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    assert read_key() is None
    monkeypatch.setenv(KEY_VARIABLE, KEY.hex())
    assert read_key() == KEY
    for wrong in ("secret123", "ab" * 16):
        monkeypatch.setenv(KEY_VARIABLE, wrong)
        with pytest.raises(InputError, match="64 hexadecimal digits") as caught:
            read_key()
        assert wrong not in str(caught.value)
    monkeypatch.delenv(KEY_VARIABLE)
    monkeypatch.setenv(KEY_FILE_VARIABLE, str(file))
    assert read_key() == KEY


def test_the_key_is_in_no_recording_and_no_log(tmp_path, caplog):
    caplog.set_level("DEBUG")
    connection = open_connection("udpin:127.0.0.1:0", record=tmp_path, key=KEY)
    vehicle, writer = signed_vehicle(connection.transport.port, KEY)
    vehicle.send(writer.frame("HEARTBEAT", {"type": 2, "autopilot": 12, "mavlink_version": 3}))
    assert connection.wait(lambda: 1 in connection.peers, 2.0)
    connection.send("PARAM_REQUEST_LIST", 1)
    vehicle.close()
    connection.close()
    (file,) = tmp_path.glob("*.tlog")
    assert file.stat().st_size > 60
    assert KEY not in file.read_bytes()
    assert KEY.hex() not in caplog.text


def test_a_key_is_never_shown():
    assert KEY.hex() not in repr(Signing(KEY))
    assert str(KEY) not in repr(Signing(KEY))


def test_no_bytes_make_the_reader_fail_or_grow():
    luck = random.Random(7)
    reader = FrameReader()
    frame = FrameWriter(1, 1).frame("ATTITUDE", {"roll": 1.0})
    for _ in range(3000):
        noise = bytearray(luck.randbytes(luck.randrange(60)) + frame)
        for _ in range(luck.randrange(3)):
            noise[luck.randrange(len(noise))] = luck.randrange(256)
        list(reader.feed(bytes(noise)))
        assert len(reader._rest) < 600
    reader._rest = b""
    assert len(list(reader.feed(frame))) == 1


def signed_vehicle(port, key, system=1, stamp=0):
    """A vehicle on a UDP socket of its own, signing with a key."""
    there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    there.connect(("127.0.0.1", port))
    signing = Signing(key)
    signing.advance_to(time.time() + stamp)
    writer = FrameWriter(system, 1, signing=signing)
    return there, writer


def test_a_signed_vehicle_may_change_its_address_and_nobody_else_may():
    connection = open_connection("udpin:127.0.0.1:0", record=None, key=KEY)
    beat = {"type": 2, "autopilot": 12, "mavlink_version": 3}
    first, writer = signed_vehicle(connection.transport.port, KEY)
    first.send(writer.frame("HEARTBEAT", beat))
    assert connection.wait(lambda: 1 in connection.peers, 2.0)
    liar, forger = signed_vehicle(connection.transport.port, bytes(32))
    radio = FrameWriter(1, 1).frame("RADIO_STATUS", {"rssi": 9})  # radios cannot sign: anybody can say this
    for words in (forger.frame("HEARTBEAT", beat), FrameWriter(1, 1).frame("HEARTBEAT", beat), radio):
        liar.send(words)
    assert connection.wait(lambda: connection.rejected.untrusted == 2, 2.0)
    connection.send("PARAM_REQUEST_LIST", 1)
    first.settimeout(1.0)
    assert first.recv(300)
    moved, _ = signed_vehicle(connection.transport.port, KEY)
    moved.send(writer.frame("HEARTBEAT", beat))
    assert connection.wait(lambda: connection.peers[1].received == 2, 2.0)
    connection.send("PARAM_REQUEST_LIST", 1)
    moved.settimeout(1.0)
    assert [message.name for _, message in FrameReader().feed(moved.recv(300))] == ["PARAM_REQUEST_LIST"]
    liar.settimeout(0.05)
    with pytest.raises(TimeoutError):
        liar.recv(300)
    for one in (first, liar, moved, connection):
        one.close()


@pytest.mark.parametrize("datagrams", [False, True])
def test_a_packet_that_is_not_believed_holds_up_none_after_it(datagrams):
    """Signatures and payloads hold bytes that look like the beginning of a frame."""
    writer = FrameWriter(1, 1, signing=Signing(KEY, 10**9))
    reader = FrameReader(Signing(KEY), datagrams=datagrams)
    for number in range(300):
        forger = FrameWriter(1, 1, signing=Signing(number.to_bytes(32, "big"), 10**9))
        assert list(reader.feed(forger.frame("PARAM_SET", {"param_id": "\xfe\xfd", "param_value": 1e9 + number}))) == []
        assert len(list(reader.feed(writer.frame("HEARTBEAT", {"custom_mode": 0xFDFE})))) == 1
    assert reader.rejected.forged == 300


def test_a_damaged_datagram_holds_up_none_after_it():
    reader, writer, luck = FrameReader(datagrams=True), FrameWriter(1, 1), random.Random(3)
    for _ in range(300):
        damaged = bytearray(writer.frame("PARAM_SET", {"param_id": "ABCDEFGH", "param_value": luck.random()}))
        damaged[luck.randrange(10, len(damaged))] ^= luck.randrange(1, 256)
        list(reader.feed(bytes(damaged) + b"\xfd\xfe"))
        assert len(list(reader.feed(writer.frame("HEARTBEAT", {})))) == 1
