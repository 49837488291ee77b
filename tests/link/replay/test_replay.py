"""A log gone through as if it were live, and played to a ground station."""

import json
import math
import socket
import threading

import numpy as np
import pytest
from drone_truth import fly
from test_log_readers import record
from tlog_factory import START_US, mixed_log

from skyway.link.logs.reader import open_log
from skyway.link.replay.player import Player, packets_of
from skyway.link.replay.replay import ReplayOptions, flight_blocks, replay
from skyway.link.replay.report import Table, replay_report
from skyway.link.replay.server import ControlServer, play
from skyway.link.wire.address import parse_address
from skyway.link.wire.transport import open_transport
from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.json_text import plain
from skyway.models.calibration.airspeed import identify_airspeed
from skyway.models.drones.airspeed import AirspeedModel
from skyway.models.drones.drag import DragModel
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.measurement import airspeed_wind

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own
KNOWN = DragModel(linear_per_s=0.15, quadratic_per_m=0.010)


def _as_json(found):
    return plain(replay_report(found))


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A simulated flight of 4 minutes as a tlog, and its truth."""
    truth = fly(seed=3, duration_s=240.0, courses_deg=(0.0, 180.0), sigma_mps=0.7)
    path = tmp_path_factory.mktemp("logs") / "flight.tlog"
    record(path, truth)
    return path, truth


def test_a_replay_finds_the_wind_the_leg_and_the_energy(flight):
    path, truth = flight
    found = replay(open_log(path))
    assert found.drag_source == "identified"
    miss = found.wind.wind[60:].mean(axis=0) - truth.wind[600:, 0].mean(axis=0)
    assert np.hypot(*miss) < 1.0
    (leg,) = found.legs
    assert leg.end_s - leg.start_s == pytest.approx(240.0, abs=3.0)
    assert leg.distance_m == pytest.approx(16.0 * 240.0, rel=0.1)
    assert leg.energy_j == pytest.approx(550.0 * 240.0, rel=0.02)
    assert leg.soc_start == pytest.approx(0.9)


def test_a_replay_as_json_is_complete_and_plain(flight):
    path, _ = flight
    report = _as_json(replay(open_log(path), ReplayOptions(forecast=lambda *_: (-4.0, 3.0))))
    text = json.dumps(report, allow_nan=False)
    assert report["schema"] == "skyway.replay/1"
    for key in (
        "format",
        "messages",
        "by_type",
        "skipped_bytes",
        "systems",
        "start",
        "end",
        "legs",
        "wind",
        "energy",
        "events",
    ):
        assert key in report
    assert report["messages"] == sum(report["by_type"].values())
    assert report["start"] == "2023-11-14T22:13:20Z"
    assert set(report["wind"][0]) == {"t", "speed_mps", "from_deg", "sigma_mps", "covariance_m2ps2"}
    assert report["wind_summary"]["forecast"]["speed_mps"] == 5.0
    assert report["energy"]["phases"]["cruise"]["mean_power_w"] == pytest.approx(550.0, abs=1.0)
    assert "NaN" not in text


def replay_to(table, path):
    """Replay a log and write its table, as ``--csv`` does."""
    with table.open("wb") as stream:
        writer = Table(stream)
        found = replay(open_log(path), ReplayOptions(drag=KNOWN), listener=writer.add)
        writer.close()
    return found


def test_the_table_of_a_replay_is_a_log_itself(flight, tmp_path):
    path, _ = flight
    table = tmp_path / "flight.csv"
    first = replay_to(table, path)
    second = replay(open_log(table), ReplayOptions(drag=KNOWN))
    assert len(second.seconds) == len(first.seconds)
    assert second.legs[0].distance_m == pytest.approx(first.legs[0].distance_m, rel=0.01)


def test_a_part_of_a_log_is_replayed_alone(flight):
    path, _ = flight
    log = open_log(path)
    found = replay(log, ReplayOptions(from_s=log.summary.start_s + 60.0, to_s=log.summary.start_s + 120.0))
    assert len(found.seconds) == pytest.approx(60, abs=1)


def test_second_by_second_or_all_at_once_is_the_same_replay(flight):
    path, _ = flight
    heard = []
    fast = replay(open_log(path), ReplayOptions(drag=KNOWN))
    slow = replay(open_log(path), ReplayOptions(drag=KNOWN), notice=heard.append)
    assert _as_json(fast) == _as_json(slow)
    assert [notice.time_s for notice in heard] == sorted(notice.time_s for notice in heard)
    assert {notice.kind for notice in heard} >= {"wind", "battery", "mission"}


def test_what_is_followed_does_not_depend_on_what_comes_later(flight):
    path, _ = flight
    log = open_log(path)
    whole, early = [], []
    cut = log.summary.start_s + 100.0
    replay(log, ReplayOptions(drag=KNOWN), notice=whole.append)
    replay(log, ReplayOptions(drag=KNOWN, to_s=cut), notice=early.append)
    assert [one for one in early if one.time_s < cut - 1.0] == [one for one in whole if one.time_s < cut - 1.0]
    assert len(early) > 10


def test_a_replay_keeps_pace_with_the_time_of_the_log(flight):
    path, _ = flight
    log = open_log(path)
    stamps, waited = [], []
    replay(
        log,
        ReplayOptions(drag=KNOWN),
        notice=lambda one: stamps.append((one.time_s, waited[-1] if waited else -math.inf)),
        wait_until=waited.append,
    )
    assert waited == sorted(waited)
    assert len(waited) == pytest.approx(240, abs=1)
    assert all(time_s <= heard_s for time_s, heard_s in stamps)


def test_the_monitors_need_no_more_memory_for_a_longer_flight():
    from skyway.link.replay.flight_monitor import MAX_ROWS, Thinned

    kept = Thinned(TelemetryTrack, most=100)
    for begin in range(0, 10_000, 7):
        times = np.arange(begin, min(begin + 7, 10_000), dtype=float)
        kept.add(TelemetryTrack.of_columns(1, times, {}))
    assert kept.rows().time_s.tolist() == list(range(0, 10_000, 128))
    assert MAX_ROWS < 100_000


def test_a_vehicle_that_is_not_in_the_log_is_an_input_error(flight):
    path, _ = flight
    with pytest.raises(InputError, match="these did: 1"):
        replay(open_log(path), ReplayOptions(system=9))


def test_a_simulated_log_without_any_wind_finds_none(tmp_path):
    path = tmp_path / "calm.tlog"
    record(path, fly(duration_s=120.0, mean=(0.0, 0.0), sigma_mps=1e-6, tilt_sigma_mps2=0.05, leg_s=30.0))
    found = replay(open_log(path), ReplayOptions(drag=KNOWN))
    assert np.hypot(*found.wind.wind[40:].mean(axis=0)) < 0.5


def test_a_log_without_telemetry_is_told_without_any(tmp_path):
    from tlog_factory import Recorder

    log = Recorder()
    log.add(0.0, log.dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), 255)
    path = tmp_path / "station.tlog"
    path.write_bytes(log.data)
    report = _as_json(replay(open_log(path)))
    assert report["system"] is None
    assert report["systems"] == []
    assert report["legs"] == []
    assert report["wind"] == []
    json.dumps(report, allow_nan=False)


def test_every_real_log_is_replayed(shared_data):
    folder = shared_data / "logs"
    for path in sorted(folder.iterdir()):
        if path.suffix != ".md":
            json.dumps(_as_json(replay(open_log(path))), allow_nan=False)


@pytest.fixture(scope="module")
def quadplane(shared_data):
    return flight_blocks(open_log(shared_data / "logs" / "cuav_quadplane_flight.tlog"), 2)


def test_the_quadplanes_own_wind_is_that_of_airspeed_and_ground_velocity_once_its_sensors_are_calibrated(quadplane):
    """Read plainly, airspeed along the heading is 2.3 m/s off: the sensor reads 7 % too much and it flies 9 degrees askew.

    The last 40 s of the wing-borne part, when the autopilot's filter has seen a turn; it does not use side slip.
    """
    fit = identify_airspeed(quadplane)
    print(f"factor {fit.model.factor:.3f}, offset {math.degrees(fit.model.heading_offset_rad):.1f} degrees")
    differences = []
    for sensor in (AirspeedModel(), fit.model):
        taken = airspeed_wind(quadplane, sensor)
        own = quadplane.autopilot[np.isin(quadplane.time_s, taken.time_s)]
        settled = taken.time_s > taken.time_s[-1] - 40.0
        difference = np.median(taken.wind[settled], axis=0) - np.median(own[settled], axis=0)
        differences.append(float(np.hypot(*difference)))
    print("difference of the medians, m/s: plain, calibrated", np.round(differences, 2))
    assert differences[1] < 0.8
    assert differences[1] < 0.4 * differences[0]


def test_the_quadplanes_own_wind_is_that_of_the_length_of_its_airspeed_alone(quadplane):
    """|ground velocity - wind| = factor x airspeed needs no heading; it agrees with what the autopilot settles at."""
    fit = identify_airspeed(quadplane)
    own = np.nanmedian(quadplane.autopilot[-30:], axis=0)
    apart = math.hypot(fit.wind_north_mps - own[0], fit.wind_east_mps - own[1])
    print(
        f"wind by length alone {fit.wind_north_mps:.2f}, {fit.wind_east_mps:.2f}; own {own.round(2)}; apart {apart:.2f}"
    )
    assert apart < 0.5


class Sink:
    def __init__(self):
        self.packets = []

    def __call__(self, data):
        self.packets.append(bytes(data))


def test_a_tlog_is_played_byte_for_byte(tmp_path):
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed_log(4, 500))
    log = open_log(path)
    sink = Sink()
    player = Player(packets_of(log), sink, speed=math.inf)
    player.step(0.1)
    assert player.ended
    data = path.read_bytes()
    assert len(sink.packets) == 500
    assert sum(len(packet) + 8 for packet in sink.packets) == len(data)
    assert all(packet in data for packet in sink.packets)


def test_speed_pause_seek_and_reverse(tmp_path):
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed_log(4, 500))  # one message each 0.02 s
    sink = Sink()
    player = Player(packets_of(open_log(path)), sink, speed=2.0)
    assert player.step(1.0) == pytest.approx(100, abs=2)
    player.command('{"do": "pause"}')
    assert player.step(1.0) == 0
    player.command('{"do": "play"}')
    assert player.command('{"do": "seek", "to": 8.0}')["position_s"] == pytest.approx(8.0)
    player.command('{"do": "speed", "to": 1}')
    forwards = len(sink.packets)
    player.step(1.0)
    ahead = sink.packets[forwards:]
    player.command('{"do": "reverse"}')
    backwards = len(sink.packets)
    player.step(1.0)
    assert sink.packets[backwards:] == ahead[::-1]
    player.step(100.0)
    assert player.ended


@pytest.mark.parametrize(
    "line",
    [
        "",
        "[]",
        "{",
        '{"do": "fly"}',
        '{"do": "seek"}',
        '{"do": "speed", "to": 0}',
        '{"do": "seek", "to": 1e400}',
        '{"do": "speed", "to": "x"}',
    ],
)
def test_a_wrong_command_is_answered_and_changes_nothing(tmp_path, line):
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed_log(4, 50))
    player = Player(packets_of(open_log(path)), Sink())
    before = player.status()
    assert "error" in player.command(line)
    assert player.status() == before


@pytest.mark.parametrize("name", ["erle_copter_auto_20141205.BIN", "flugdrohne_20230621_log66.ulg"])
def test_other_logs_can_be_sought_in_too(shared_data, name):
    log = open_log(shared_data / "logs" / name)
    sink = Sink()
    player = Player(packets_of(log), sink)
    length_s = log.summary.end_s - log.summary.start_s
    for share in (0.9, 0.1, 0.6, 0.95, 0.3, 0.8, 0.2):
        player.seek(share * length_s)
        player.step(0.1)
    assert sink.packets


def test_a_csv_is_played_as_messages_that_pymavlink_reads(flight, tmp_path):
    from pymavlink.dialects.v20 import common

    path, _ = flight
    table = tmp_path / "flight.csv"
    replay_to(table, path)
    sink = Sink()
    Player(packets_of(open_log(table)), sink, speed=math.inf).step(1.0)
    reader = common.MAVLink(None)
    messages = [message for packet in sink.packets for message in reader.parse_buffer(packet) or []]
    names = {message.get_type() for message in messages}
    assert {"HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT", "SYS_STATUS", "VFR_HUD"} == names


def test_a_log_is_served_to_a_ground_station_and_obeys_it(tmp_path):
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed_log(4, 300))
    station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    station.bind(("127.0.0.1", 0))
    station.settimeout(5.0)
    output = open_transport(parse_address(f"udpout:127.0.0.1:{station.getsockname()[1]}"))
    player = Player(packets_of(open_log(path)), output.write, speed=5.0)
    control = ControlServer(player, 0)
    thread = threading.Thread(target=play, args=(player, control), daemon=True)
    thread.start()
    with socket.create_connection(("127.0.0.1", control.port), timeout=5.0) as client:
        client.sendall(b'{"do": "status"}\n')
        status = json.loads(client.makefile().readline())
        assert status["length_s"] == pytest.approx(5.98, abs=0.1)
        assert station.recv(2048)[0] in (0xFD, 0xFE)
        client.sendall(b'{"do": "speed", "to": 1000}\n')
        assert json.loads(client.makefile().readline())["speed"] == 1000.0
    thread.join(timeout=5.0)
    assert not thread.is_alive()
    control.close()
    output.close()
    station.close()


def test_pymavlink_reads_what_is_served_and_pause_seek_speed_and_reverse_are_obeyed(flight):
    from pymavlink import mavutil

    path, _ = flight
    log = open_log(path)
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="common")
    output = open_transport(parse_address(f"udpout:127.0.0.1:{station.port.getsockname()[1]}"))
    player = Player(packets_of(log), output.write, speed=20.0)
    control = ControlServer(player, 0)
    thread = threading.Thread(target=play, args=(player, control), kwargs={"hold": False}, daemon=True)
    thread.start()

    def heard():
        """Time since boot of the next attitude, s."""
        message = station.recv_match(type="ATTITUDE", blocking=True, timeout=5.0)
        assert message is not None
        return message.time_boot_ms / 1000.0

    with socket.create_connection(("127.0.0.1", control.port), timeout=5.0) as client:
        lines = client.makefile()

        def order(**what):
            client.sendall(json.dumps(what).encode() + b"\n")
            return json.loads(lines.readline())

        assert heard() < heard()
        assert order(do="pause")["paused"]
        while station.recv_msg() is not None:
            pass
        assert order(do="seek", to=200.0)["position_s"] == 200.0
        assert station.recv_msg() is None, "nothing is sent while it is paused"
        assert order(do="reverse")["speed"] == -20.0
        assert not order(do="play")["paused"]
        first, second = heard(), heard()
        assert 190.0 < second < first <= 200.0
        assert order(do="speed", to=1000)["speed"] == 1000.0
    thread.join(timeout=5.0)
    assert player.ended
    for one in (control, output, station):
        one.close()


def test_a_port_in_use_is_a_link_error(tmp_path):
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed_log(4, 10))
    player = Player(packets_of(open_log(path)), Sink())
    first = ControlServer(player, 0)
    with pytest.raises(LinkError, match="cannot listen"):
        ControlServer(player, first.port)
    first.close()


def test_an_empty_log_plays_nothing(tmp_path):
    path = tmp_path / "none.tlog"
    path.write_bytes(b"\x00" * 20)
    sink = Sink()
    player = Player(packets_of(open_log(path)), sink)
    assert player.ended
    assert player.step(1.0) == 0
    assert START_US
