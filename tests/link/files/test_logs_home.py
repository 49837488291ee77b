"""Logs are fetched whole from simulated vehicles over bad links, at the rate of the link, and cuts are taken up again."""

import errno
import os
import random
from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wires import FAMILIES, Scene, bad_radio

from skyway.link.files.aboard import LogStore
from skyway.link.files.catalog import known_logs, remember
from skyway.link.files.fetching import fetch, file_crc32
from skyway.link.files.ftp_words import DATA_BYTES, Op, crc32, payload
from skyway.link.files.part_file import Pieces
from skyway.link.files.wide_window import GAINS, GROWS, WideWindow
from skyway.link.protocol.exchange import Exchange
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.models.base.errors import CommandRefusedError, InputError, LinkError, VehicleTimeoutError
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.transports.channel import Impairment

RADIO_BYTEPS = 5760.0
FTP_SHARE, REQUEST_SHARE = 239 / 266, 90 / 109
"""Of the bytes of a frame, those of the file."""
WAYS = ("ftp", "requests")
BOTH = [(family, way) for family in FAMILIES for way in WAYS]


class Depot(Scene):
    """A vehicle with logs, and our driver aboard."""

    def __init__(self, family="px4", *, logs=(1000, 30_000), **how):
        super().__init__(family, logs=logs, **how)
        self.meet()
        self.quiet()
        self.craft = Vehicle(self.connection)

    def store(self, way="auto"):
        return LogStore(self.craft, way)

    def content(self, number=-1):
        return bytes(list(self.vehicle.card.files.values())[number].content)

    def fault(self, text):
        self.vehicle.faults.add(parse_fault(text), self.vehicle.sim_s)
        self.connection.run_for(0.1)


def radio(rate=RADIO_BYTEPS, loss=0.0, delay_s=0.04, jitter_s=0.01, *, flow_control=False):
    return Impairment(loss=loss, delay_s=delay_s, jitter_s=jitter_s, rate_byteps=rate, flow_control=flow_control)


@pytest.mark.parametrize(("family", "way"), BOTH)
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_the_latest_log_arrives_whole(family, way, loss, tmp_path):
    depot = Depot(family, impairment=bad_radio(loss))
    store = depot.store(way)
    logs = store.logs()
    assert [log.size_bytes for log in logs] == [1000, 30_000]
    found = fetch(store, logs[-1], tmp_path)
    assert found.path.read_bytes() == depot.content()
    assert found.by_crc == (way == "ftp")
    assert found.path.name.startswith("vehicle1-")
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize(("family", "way"), BOTH)
def test_several_logs_are_fetched_one_after_the_other_after_the_list_was_ended(family, way, tmp_path):
    """As ``skyway logs fetch all`` does: PX4 forgets the list with LOG_REQUEST_END, and then answers no request for data."""
    depot = Depot(family, logs=(900, 2_000))
    store = depot.store(way)
    logs = store.logs()
    store.end()
    assert [fetch(store, log, tmp_path).path.read_bytes() for log in logs] == [depot.content(0), depot.content(1)]


@pytest.mark.parametrize("firmware", ["4.6", "4.7"])
def test_sessions_are_numbered_as_each_version_does(firmware, tmp_path):
    depot = Depot("ardupilot", firmware=firmware, logs=(5_000, 239 * 20))
    store = depot.store()
    for log in store.logs():
        assert fetch(store, log, tmp_path).by_crc


@pytest.mark.parametrize(
    ("family", "way", "rate", "flow_control", "size"),
    [
        *[(family, way, RADIO_BYTEPS, False, 60_000) for family, way in BOTH],
        *[(family, way, 60_000.0, True, 200_000) for family, way in BOTH],
    ],
)
def test_a_log_comes_as_fast_as_the_link_carries_it(family, way, rate, flow_control, size, tmp_path):
    depot = Depot(family, impairment=radio(rate, flow_control=flow_control), logs=(size,))
    store = depot.store(way)
    found = fetch(store, store.logs()[-1], tmp_path)
    share = found.rate_byteps / rate / (FTP_SHARE if way == "ftp" else REQUEST_SHARE)
    assert share >= 0.8, share
    assert share <= 1.0 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("family", "loss"), [("px4", 0.0), ("ardupilot", 0.0), ("ardupilot", 0.02)])
def test_a_fast_and_long_link_without_flow_control_is_filled_by_many_reads(family, loss, tmp_path):
    rate = 200_000.0
    depot = Depot(family, impairment=radio(rate, loss, 0.02, 0.01), logs=(3_000_000,))
    store = depot.store("ftp")
    found = fetch(store, store.logs()[-1], tmp_path)
    assert found.path.read_bytes() == depot.content()
    assert found.rate_byteps / rate / FTP_SHARE >= 0.8


@given(st.floats(8.0, 500.0), st.floats(0.01, 0.3))
def test_as_many_reads_are_put_under_way_as_fill_a_link(filling, round_s):
    """An ideal link: what more than `filling` reads ask for waits in it."""
    now_s, came = 0.0, 0.0
    wide = WideWindow(16.0, now_s, 0)
    while not wide.settled and now_s < 1000.0 * round_s:
        took_s = round_s * max(wide.window / filling, 1.0)
        now_s += took_s
        came += wide.window * DATA_BYTES
        wide.learn(now_s, int(came), took_s, round_s)
    assert wide.settled
    assert wide.window == wide.best_window
    assert wide.best_byteps >= min(filling, 512.0) * DATA_BYTES / round_s / GAINS - 1.0
    assert wide.best_window <= max(filling * GROWS, 16.0)
    assert filling > 400.0 or wide.full


class AtOnce(Exchange):
    """So many reads at once; answers are counted for a second."""

    def __init__(self, target, session, reads):
        super().__init__(target)
        self.session, self.reads, self.answered = session, reads, 0

    def begin(self, now_s):
        for n in range(self.reads):
            asked = payload(5000 + 2 * n, Op.READ, session=self.session, offset=DATA_BYTES * n, size=DATA_BYTES)
            self.send("FILE_TRANSFER_PROTOCOL", payload=asked)
        self.next_s = now_s + 1.0

    def hear(self, message, now_s):
        self.answered += message.name == "FILE_TRANSFER_PROTOCOL"

    def tick(self, now_s):
        self.finish()


@pytest.mark.parametrize(("family", "answered"), [("px4", 20), ("ardupilot", 5)])
def test_ardupilot_lets_five_requests_wait_and_loses_more(family, answered):
    """``GCS_FTP.h``: ``ObjectBuffer<Transaction> requests{AP_MAVLINK_FTP_MAX_SESSIONS}``."""
    depot = Depot(family, logs=(100 * DATA_BYTES,))
    store = depot.store("ftp")
    session, _ = store.ftp.open(store.logs()[-1].path)
    asked = AtOnce(depot.craft.peer.target, session, 20)
    depot.craft.carry_out(asked)
    assert asked.answered == answered


def test_what_is_lost_is_asked_for_singly(tmp_path):
    depot = Depot("px4", impairment=radio(60_000.0, loss=0.02, flow_control=True), logs=(200_000,))
    store = depot.store("ftp")
    found = fetch(store, store.logs()[-1], tmp_path)
    assert found.path.read_bytes() == depot.content()
    assert found.rate_byteps / 60_000.0 / FTP_SHARE >= 0.8


@pytest.mark.parametrize(("family", "way"), BOTH)
def test_a_cut_is_taken_up_where_it_stopped(family, way, tmp_path):
    depot = Depot(family, impairment=radio(), logs=(40_000,))
    store = depot.store(way)
    log = store.logs()[-1]
    depot.fault("link-loss@4s")
    with pytest.raises(LinkError, match=r"are kept in .*run the same command to continue"):
        fetch(store, log, tmp_path)
    (part,) = tmp_path.iterdir()
    kept = part.stat().st_size
    assert 0 < kept < 40_000
    assert part.read_bytes() == depot.content()[:kept]
    again = Depot(family, impairment=radio(), logs=(40_000,))
    store = again.store(way)
    found = fetch(store, store.logs()[-1], tmp_path)
    assert found.path.read_bytes() == again.content()
    assert found.came_bytes == 40_000 - kept
    assert "resumed after" in found.notes[0]


def test_a_part_of_another_log_is_not_gone_on_with(tmp_path):
    depot = Depot("ardupilot", logs=(20_000,))
    store = depot.store("requests")
    log = store.logs()[-1]
    (tmp_path / "vehicle1-00000001.bin.part").write_bytes(b"x" * 9000)
    found = fetch(store, log, tmp_path)
    assert found.path.read_bytes() == depot.content()
    assert "another log" in found.notes[0]


@pytest.mark.parametrize("way", WAYS)
def test_a_log_that_is_still_written_is_followed_to_its_end(way, tmp_path):
    depot = Depot("ardupilot", impairment=radio(20_000.0), logs=(30_000,))
    store = depot.store(way)
    log = store.logs()[-1]
    file = list(depot.vehicle.card.files.values())[-1]
    file.content += os.urandom(7_000)
    found = fetch(store, log, tmp_path)
    assert found.path.read_bytes() == depot.content()
    assert found.size_bytes == 37_000
    assert "still being written" in found.notes[0]


@pytest.mark.parametrize(("family", "way"), BOTH)
def test_a_link_that_is_silent_while_a_part_is_compared_costs_nothing_of_the_part(family, way, tmp_path):
    depot = Depot(family, impairment=radio(), logs=(40_000,))
    store = depot.store(way)
    log = store.logs()[-1]
    part = tmp_path / f"vehicle1-{log.name.replace('/', '-').lower()}.part"
    part.write_bytes(depot.content()[:30_000])
    depot.fault("log-stall")
    with pytest.raises(LinkError, match="run the same command to continue"):
        fetch(store, log, tmp_path)
    assert part.read_bytes() == depot.content()[:30_000]


@pytest.mark.parametrize("way", WAYS)
def test_the_beginning_of_a_log_that_never_stops_growing_is_kept_and_said_to_be_that(way, tmp_path):
    """As with LOG_DISARMED and SDLOG_MODE 2: the vehicle is disarmed, and logs."""
    depot = Depot("ardupilot", impairment=radio(20_000.0), logs=(30_000,))
    file = list(depot.vehicle.card.files.values())[-1]

    def grow():
        file.content += os.urandom(500)

    depot.connection.every_second.append(grow)
    store = depot.store(way)
    found = fetch(store, store.logs()[-1], tmp_path)
    assert found.path.read_bytes() == depot.content()[: found.size_bytes]
    assert found.size_bytes > 30_000
    assert (found.by_crc, found.grows) == (False, True)
    assert found.verified_by == "size (the log still grows)"
    assert "this is its beginning" in found.notes[-1]
    depot.connection.every_second.remove(grow)
    rest = fetch(store, store.logs()[-1], tmp_path)
    assert rest.path.read_bytes() == depot.content()
    assert rest.came_bytes == len(depot.content()) - found.size_bytes


@pytest.mark.parametrize("family", FAMILIES)
def test_a_list_with_an_entry_that_never_comes_is_given_up(family):
    """The vehicle answers each request for it, with other entries."""
    its, wanted = FrameWriter(1, 1), 1 + (family == "ardupilot")

    def spoil(number, message, frame, up):
        if up or message is None or message.name not in ("LOG_ENTRY", "HEARTBEAT"):
            return frame
        if message.name == "LOG_ENTRY" and message["id"] == wanted:
            return its.frame("LOG_ENTRY", message.fields | {"id": wanted - 1})
        other = {"id": wanted - 1, "num_logs": 3, "last_log_num": wanted + 1, "size": 900}
        return frame + (its.frame("LOG_ENTRY", other) if message.name == "HEARTBEAT" else b"")

    depot = Depot(family, logs=(900, 2_000, 3_000), spoil=spoil)
    begun_s = depot.connection.clock.now_s()
    with pytest.raises(VehicleTimeoutError, match=r"list of its logs \(2 came\)"):
        depot.store("requests").logs()
    assert depot.connection.clock.now_s() < begun_s + 15.0


def test_a_vehicle_without_file_transfers_is_asked_for_logs(tmp_path):
    for family in FAMILIES:
        depot = Depot(family, faults=(parse_fault("no-ftp"),))
        store = depot.store()
        log = store.logs()[-1]
        assert store.way == "requests"
        assert fetch(store, log, tmp_path / family).path.read_bytes() == depot.content()


def test_one_that_says_that_it_has_them_and_is_silent_is_asked_for_logs():
    depot = Depot("px4")
    depot.vehicle.ftp.hear = lambda *_: None
    depot.vehicle.radio.serve({"FILE_TRANSFER_PROTOCOL": lambda *_: None})
    store = depot.store()
    assert len(store.logs()) == 2
    assert store.way == "requests"


@pytest.mark.parametrize(("family", "way"), BOTH)
def test_a_transfer_that_stalls_is_told_in_one_line_and_kept(family, way, tmp_path):
    depot = Depot(family, impairment=radio(), logs=(40_000,))
    store = depot.store(way)
    log = store.logs()[-1]
    depot.fault("log-stall@3s")
    with pytest.raises(LinkError) as told:
        fetch(store, log, tmp_path)
    assert "\n" not in str(told.value)
    assert "kept" in str(told.value)


def test_a_size_that_is_a_lie_is_found_out(tmp_path):
    depot = Depot("px4", faults=(parse_fault("log-size=3"),))
    store = depot.store("ftp")
    found = fetch(store, store.logs()[-1], tmp_path / "ftp")
    assert found.path.read_bytes() == depot.content()
    assert "wrong size" in found.notes[0]
    requests = depot.store("requests")
    with pytest.raises(LinkError, match=r"should have 90000.*30.0 kB that came are in vehicle1-.*\.part"):
        fetch(requests, requests.logs()[-1], tmp_path / "requests")
    shorter = Depot("px4", faults=(parse_fault("log-size=0.5"),))
    store = shorter.store("ftp")
    with pytest.raises(LinkError, match=r"differs from the vehicle.s log"):
        fetch(store, store.logs()[-1], tmp_path / "short")
    assert list((tmp_path / "short").iterdir()) == []


def test_a_log_that_vanishes_and_one_that_comes_wrong(tmp_path):
    depot = Depot("ardupilot", logs=(110_000,))
    store = depot.store()
    log = store.logs()[-1]
    depot.fault("log-rot")
    with pytest.raises(LinkError, match="Check its card"):
        fetch(store, log, tmp_path)
    depot.fault("log-gone")
    with pytest.raises(CommandRefusedError, match="no such file"):
        fetch(store, log, tmp_path)
    with pytest.raises(CommandRefusedError, match="is its card in"):
        store.logs()


def test_names_that_lead_elsewhere_are_left_alone():
    depot = Depot("ardupilot")
    for name in ("../../../etc/evil.bin", ".hidden.bin", "a\x1b[2Jb.bin"):
        depot.vehicle.card.files[f"/APM/LOGS/{name.replace('/', chr(92))}"] = depot.vehicle.card.files[
            "/APM/LOGS/00000001.BIN"
        ]
    store = depot.store()
    assert [log.name for log in store.logs()] == ["00000001.BIN", "00000002.BIN"]
    assert len(store.skipped) == 3
    assert all(name.isprintable() for name in store.skipped)


def test_a_file_that_is_there_is_compared_and_never_overwritten(tmp_path):
    depot = Depot("px4")
    store = depot.store()
    log = store.logs()[-1]
    first = fetch(store, log, tmp_path)
    assert fetch(store, log, tmp_path).came_bytes == 0
    first.path.write_bytes(depot.content()[:-1] + b"?")
    with pytest.raises(InputError, match="exists already and differs"):
        fetch(store, log, tmp_path)
    assert fetch(store, log, tmp_path, force=True).path.read_bytes() == depot.content()


def test_a_file_of_the_same_size_and_other_data_is_another_log_where_no_checksum_tells_them_apart(tmp_path):
    """As after a card was formatted: the numbers begin again, and logs of flash memory have the sizes of its pages."""
    depot = Depot("ardupilot", logs=(20_000,))
    store = depot.store("requests")
    log = store.logs()[-1]
    first = fetch(store, log, tmp_path)
    assert fetch(store, log, tmp_path).notes == ("it was already here",)
    first.path.write_bytes(depot.content()[:200] + bytes(len(depot.content()) - 200))
    with pytest.raises(InputError, match="the same size, but other data"):
        fetch(store, log, tmp_path)
    assert fetch(store, log, tmp_path, force=True).path.read_bytes() == depot.content()


def test_an_armed_vehicle_is_left_in_peace(tmp_path):
    depot = Depot("px4")
    store = depot.store()
    log = store.logs()[-1]
    depot.craft.start(30.0) if depot.vehicle.autopilot.stores[0] else depot.craft.arm(30.0)
    with pytest.raises(CommandRefusedError, match="disarmed"):
        fetch(store, log, tmp_path)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS])
def test_a_disk_that_does_not_take_it_is_told_in_one_line(number, tmp_path, monkeypatch):
    depot = Depot("px4")
    store = depot.store()
    log = store.logs()[-1]

    def fails(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(Pieces, "put", fails)
    with pytest.raises(InputError, match="cannot be written"):
        fetch(store, log, tmp_path)


def test_a_disk_with_too_little_room_is_told_before(tmp_path, monkeypatch):
    depot = Depot("px4")
    store = depot.store()
    log = store.logs()[-1]
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10_000})())
    with pytest.raises(InputError, match="the disk is full"):
        fetch(store, log, tmp_path)


def test_a_vehicle_that_is_gone_is_told(tmp_path):
    depot = Depot("px4")
    store = depot.store("ftp")
    log = store.logs()[-1]
    depot.fault("link-loss")
    with pytest.raises(LinkError, match=r"did not answer within [67] s: open .*; nothing came"):
        fetch(store, log, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_recording_holds_no_second_copy(tmp_path):
    depot = Depot("px4", logs=(60_000,))
    sizes = []
    depot.connection.recorder = type("Kept", (), {"frame": lambda _, data: sizes.append(len(data)), "close": None})()
    store = depot.store()
    fetch(store, store.logs()[-1], tmp_path)
    assert sum(sizes) < 30_000


def test_what_was_fetched_is_listed_beside_it(tmp_path):
    depot = Depot("px4")
    store = depot.store()
    found = fetch(store, store.logs()[-1], tmp_path)
    for _ in range(2):
        remember(found, 1, (tmp_path / "a.tlog",))
    with (tmp_path / "logs-fetched.jsonl").open("a") as stream:
        stream.write("no JSON\n")
    (entry,) = known_logs(tmp_path)
    assert (entry.log, entry.recordings) == (found.path.name, ("a.tlog",))
    assert entry.crc32 == f"{file_crc32(found.path):08x}"


@given(st.binary(max_size=300), st.integers(0, 300))
def test_the_checksum_is_the_bitwise_one_of_autopilots(data, cut):
    expected = 0
    for byte in data:
        expected ^= byte
        for _ in range(8):
            expected = expected >> 1 ^ (0xEDB88320 if expected & 1 else 0)
    assert crc32(data[cut:], crc32(data[:cut])) == expected


@given(
    st.integers(1, 400),
    st.randoms(use_true_random=False),
    st.lists(st.tuples(st.integers(0, 400), st.integers(1, 60)), max_size=60),
)
def test_pieces_in_any_order_make_the_file(size, luck, given_pieces):
    content = random.Random(size).randbytes(size)
    stream = BytesIO()
    pieces = Pieces(stream)
    new = 0
    for offset, length in given_pieces:
        new += pieces.put(offset, content[offset : offset + length])
        assert stream.getvalue() == content[: pieces.end]
        missing = {n for offset, length in pieces.holes(7) for n in range(offset, offset + length)}
        assert new == pieces.top - len(missing)
        assert pieces.end == min(missing, default=pieces.top)
    order = list(range(0, size, 13))
    luck.shuffle(order)
    for offset in order:
        pieces.put(offset, content[offset : offset + 13])
    assert stream.getvalue() == content
    assert list(pieces.holes(7)) == []
