"""Logs of every format give the same telemetry, and damaged ones what they hold."""

import gzip
import math
import shutil
import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from drone_truth import fly
from log_factory import dataflash, multirotor
from tlog_factory import START_US, Recorder

from skyway.link.logs import csv_log
from skyway.link.logs.common import pieces
from skyway.link.logs.common.assembly import Assembler, Stretch
from skyway.link.logs.common.messages import SPOKEN
from skyway.link.logs.csv_log import read_columns
from skyway.link.logs.reader import format_of, open_log
from skyway.link.logs.tlog.tlog import scan
from skyway.models.base.errors import InputError
from skyway.models.drones.telemetry import QUANTITIES, TelemetryTrack

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's and pyulog's own


def one_track(path, **options) -> TelemetryTrack:
    return TelemetryTrack.joined(open_log(path, **options).tracks())


def record(path, truth, system=1, begin=0.0):
    """Write the telemetry of a simulated flight as a tlog."""
    log = Recorder()
    kinds = log.dialect
    track = truth.track(0)
    for row, time_s in enumerate(track.time_s - track.time_s[0]):
        roll, pitch, yaw = (float(track[name][row]) for name in ("roll_rad", "pitch_rad", "yaw_rad"))
        log.add(begin + time_s, kinds.MAVLink_attitude_message(int(time_s * 1000), roll, pitch, yaw, 0, 0, 0), system)
        north, east = (round(100 * float(track[f"vel_{name}_mps"][row])) for name in ("north", "east"))
        log.add(
            begin + time_s,
            kinds.MAVLink_global_position_int_message(
                int(time_s * 1000), 470000000, 80000000, 500000, 60000, north, east, 0, 0
            ),
            system,
        )
        if row % 10 == 0:
            log.add(begin + time_s, kinds.MAVLink_heartbeat_message(2, 12, 128, 4, 4, 3), system)
            log.add(
                begin + time_s,
                kinds.MAVLink_sys_status_message(0, 0, 0, 500, 22000, 2500, round(90 - time_s / 10), 0, 0, 0, 0, 0, 0),
                system,
            )
            log.add(begin + time_s, kinds.MAVLink_extended_sys_state_message(0, 2), system)
    path.write_bytes(log.data)
    return log


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("erle_copter_auto_20141205.BIN", "pymavlink"),
        ("flugdrohne_20230621_log66.ulg", "pyulog"),
        ("pyulog_sample_log_small.ulg", "pyulog"),
    ],
)
def test_real_logs_hold_what_the_makers_own_readers_count(shared_data, name, count):
    path = shared_data / "logs" / name
    summary = open_log(path).summary
    expected: dict[str, int] = {}
    if count == "pymavlink":
        from pymavlink.DFReader import DFReader_binary

        log = DFReader_binary(str(path))
        while (message := log.recv_msg()) is not None:
            expected[message.get_type()] = expected.get(message.get_type(), 0) + 1
        log.filehandle.close()
    else:
        from pyulog import ULog

        for part in ULog(str(path)).data_list:
            expected[part.name] = expected.get(part.name, 0) + len(part.data["timestamp"])
    assert summary.by_type == expected
    assert summary.messages == sum(expected.values())


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_dataflash_log_holds_what_pymavlink_reads(shared_data, tmp_path, seed, capsys):
    from pymavlink.DFReader import DFReader_binary

    generator = np.random.default_rng(seed)
    data = np.frombuffer((shared_data / "logs" / "erle_copter_auto_20141205.BIN").read_bytes(), np.uint8)[
        :300_000
    ].copy()
    start = int(generator.integers(20_000, 250_000))
    data[start : start + 500] = generator.integers(0, 256, 500)
    path = tmp_path / "damaged.bin"
    path.write_bytes(data.tobytes())
    log = DFReader_binary(str(path))
    count = 0
    while log.recv_msg() is not None:
        count += 1
    log.filehandle.close()
    capsys.readouterr()
    summary = open_log(path).summary
    assert summary.messages == count
    assert summary.skipped_bytes > 0


def test_a_tlog_gives_back_the_flight_that_was_recorded(tmp_path):
    truth = fly(duration_s=20.0)
    path = tmp_path / "flight.tlog"
    record(path, truth)
    log = open_log(path)
    track = TelemetryTrack.joined(log.tracks())
    assert len(track) == 200
    assert track["pitch_rad"] == pytest.approx(truth.track(0)["pitch_rad"], abs=1e-6)
    assert track["vel_north_mps"] == pytest.approx(truth.velocity[:, 0, 0], abs=0.006)
    assert track["power_w"][50] == pytest.approx(22.0 * 25.0)
    assert track["armed"][50] == 1.0
    assert track["landed"][50] == 0.0
    assert log.summary.time_base.absolute
    assert log.summary.start_s == pytest.approx(START_US / 1e6)


def test_a_live_link_gives_the_same_samples_as_the_log(tmp_path):
    path = tmp_path / "flight.tlog"
    record(path, fly(duration_s=5.0))
    from_log = list(one_track(path).samples())
    from pymavlink import mavutil

    live = Assembler(1)
    from_link = []
    source = mavutil.mavlogfile(str(path))
    while (message := source.recv_msg()) is not None:
        fields = {name: getattr(message, name) for name in message.get_fieldnames()}
        told = {name: float(value) for name, value in SPOKEN[message.get_type()](fields).items()}
        sample = live.feed_one(message._timestamp, told) if told else None
        if sample is not None:
            from_link.append(sample)
    source.close()
    assert len(from_link) == len(from_log)
    for one, other in zip(from_link[5:], from_log[5:], strict=True):
        assert one.time_s == pytest.approx(other.time_s)
        # what came with the same stamp, but after the attitude, the live sample cannot hold yet
        assert (one.roll_rad, one.pitch_rad, one.soc, one.landed) == pytest.approx(
            (other.roll_rad, other.pitch_rad, other.soc, other.landed), abs=0.011
        )


def test_quantities_that_are_old_are_not_known_any_more():
    stretch = Stretch()
    stretch.add([0.0], {"vel_north_mps": [5.0]})
    stretch.add([0.0, 1.0, 3.0], {"roll_rad": [0.1, 0.1, 0.1]})
    track = Assembler(1).feed(stretch)
    assert track["vel_north_mps"][:2].tolist() == [5.0, 5.0]
    assert math.isnan(track["vel_north_mps"][2])


def test_pieces_of_a_stream_give_the_same_as_the_whole():
    whole, parts = Assembler(1), Assembler(1)
    full, first, second = Stretch(), Stretch(), Stretch()
    times = np.arange(20.0) / 4
    for stretch, chosen in ((full, slice(None)), (first, slice(0, 9)), (second, slice(9, None))):
        stretch.add(times[chosen], {"roll_rad": times[chosen]})
        stretch.add(times[chosen][::3], {"soc": times[chosen][::3]})
    together = parts.feed(first), parts.feed(second)
    assert TelemetryTrack.joined(together)["roll_rad"] == pytest.approx(whole.feed(full)["roll_rad"])


def test_a_heartbeat_of_a_ground_station_does_not_arm_the_vehicle():
    assert SPOKEN["HEARTBEAT"]({"type": 6, "autopilot": 8, "base_mode": 128, "custom_mode": 0}) == {}


def test_wind_messages_point_the_same_way():
    wind = SPOKEN["WIND"]({"direction": -90.0, "speed": 5.0, "speed_z": 0.0})  # FROM the west
    cov = SPOKEN["WIND_COV"]({"wind_x": 0.0, "wind_y": 5.0})  # TOWARDS the east
    for name in ("wind_north_mps", "wind_east_mps"):
        assert float(wind[name]) == pytest.approx(float(cov[name]), abs=1e-9)
    assert math.isnan(float(SPOKEN["WIND"]({"direction": -180.0, "speed": 0.0})["wind_north_mps"]))


def test_unknown_battery_values_are_not_known():
    sensors = {f"onboard_control_sensors_{name}": 0 for name in ("present", "enabled", "health")}
    told = SPOKEN["SYS_STATUS"](sensors | {"voltage_battery": 0, "current_battery": -1, "battery_remaining": -1})
    assert all(math.isnan(float(told[name])) for name in ("voltage_v", "current_a", "soc"))
    assert told["airspeed_ok"] == 0.0


@pytest.mark.parametrize("column", ["Inst", "Instance", "I"])
def test_the_first_of_several_batteries_is_read(tmp_path, column):
    log = dataflash(multirotor(fly(seed=1, duration_s=20.0)))
    for second in range(20):
        for battery, volts in enumerate((22.0, 5.0)):
            log.add("BAT", "QBff", f"TimeUS,{column},Volt,Curr", 2_000_000 + second * 1_000_000, battery, volts, 10.0)
    path = tmp_path / "two.bin"
    path.write_bytes(log.data)
    told = np.concatenate([track["voltage_v"] for track in open_log(path).tracks()])
    assert set(told[np.isfinite(told)]) == {22.0}


def test_an_old_autopilots_vertical_speed_is_turned_and_said_so(tmp_path):
    log = Recorder()
    kinds = log.dialect
    for second in range(60):
        time_s = second / 2
        log.add(time_s, kinds.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))
        log.add(
            time_s, kinds.MAVLink_global_position_int_message(0, 470000000, 80000000, 0, second * 1000, 0, 0, 200, 0)
        )
    path = tmp_path / "old.tlog"
    path.write_bytes(log.data)
    opened = open_log(path)
    assert "upwards" in opened.summary.time_base.doubts[0]
    assert TelemetryTrack.joined(opened.tracks())["vel_down_mps"][10] == pytest.approx(-2.0)


def test_a_vehicles_clock_that_goes_otherwise_than_the_recorders_is_doubted(tmp_path):
    for factor, doubted in ((1.0, False), (4.0, True)):
        log = Recorder()
        for second in range(60):
            boot_ms = round(1000 * factor * second) if second < 40 else round(1000 * (second - 40))  # restarts at 40 s
            log.add(float(second), log.dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0))
        path = tmp_path / f"{factor}.tlog"
        path.write_bytes(log.data)
        doubts = " ".join(open_log(path).summary.time_base.doubts)
        assert ("the clock of vehicle 1 went" in doubts) is doubted


def test_two_vehicles_give_two_tracks(tmp_path):
    first, second = tmp_path / "1.tlog", tmp_path / "2.tlog"
    record(first, fly(duration_s=5.0, speed_mps=10.0), system=1)
    record(second, fly(duration_s=5.0, speed_mps=5.0), system=2, begin=5.0)
    both = tmp_path / "both.tlog"
    both.write_bytes(first.read_bytes() + second.read_bytes())
    log = open_log(both)
    assert log.summary.systems == (1, 2)
    speeds = {track.system: float(track["vel_north_mps"].mean()) for track in log.tracks()}
    assert speeds[1] == pytest.approx(10.0, abs=0.1)
    assert speeds[2] == pytest.approx(5.0, abs=0.1)


def test_a_clock_that_is_set_back_is_said_and_time_goes_on(tmp_path):
    first, second = tmp_path / "1.tlog", tmp_path / "2.tlog"
    record(first, fly(duration_s=30.0), begin=3600.0)
    record(second, fly(duration_s=30.0), begin=0.0)
    both = tmp_path / "both.tlog"
    both.write_bytes(first.read_bytes() + second.read_bytes())
    log = open_log(both)
    assert "set back once, by" in " ".join(log.summary.time_base.doubts)
    track = TelemetryTrack.joined(log.tracks())
    assert (np.diff(track.time_s) > 0.0).all()
    assert len(track) >= 598


def stepped(data, at_share, by_s):
    """The stamps of a recording whose clock is set by so much after a share of its messages."""
    log, positions = bytearray(data), list(stamps_of(data))
    for position in positions[round(at_share * len(positions)) :]:
        (stamp,) = struct.unpack_from(">Q", log, position)
        struct.pack_into(">Q", log, position, stamp + round(by_s * 1e6))
    return bytes(log)


def stamps_of(data):
    """Positions of the stamps of an undamaged tlog."""
    position = 0
    while position < len(data):
        yield position
        second = data[position + 8] == 0xFD
        position += 8 + data[position + 9] + (12 if second else 8)


@pytest.mark.parametrize("by_s", [300.0, 12 * 3600.0, 3 * 365 * 86_400.0])
def test_a_clock_that_is_set_forward_in_flight_is_said_and_the_flight_stays_whole(tmp_path, by_s):
    """As on a companion computer that finds a network in the air."""
    steady, path = tmp_path / "steady.tlog", tmp_path / "set.tlog"
    record(steady, fly(duration_s=60.0))
    whole = open_log(steady)
    path.write_bytes(stepped(steady.read_bytes(), 0.5, by_s))
    found = open_log(path)
    assert "set forward once while the vehicle's ran on" in " ".join(found.summary.time_base.doubts)
    assert found.summary.end_s == pytest.approx(whole.summary.end_s, abs=0.2)
    tracks = [TelemetryTrack.joined(log.tracks()) for log in (found, whole)]
    assert len(tracks[0]) == len(tracks[1])
    assert tracks[0].time_s == pytest.approx(tracks[1].time_s, abs=0.2)
    late = whole.summary.start_s + 45.0
    assert len(TelemetryTrack.joined(found.tracks(late, late + 5.0))) >= 49


def test_a_pause_of_the_recording_in_which_the_vehicles_clock_goes_on_stays_a_pause(tmp_path):
    log = Recorder()
    for second in (*range(30), *range(900, 930)):
        log.add(float(second), log.dialect.MAVLink_attitude_message(1000 * second, 0, 0, 0, 0, 0, 0))
    path = tmp_path / "paused.tlog"
    path.write_bytes(log.data)
    found = open_log(path).summary
    assert found.end_s - found.start_s == pytest.approx(929.0)
    assert "set forward" not in " ".join(found.time_base.doubts)


@pytest.mark.parametrize("lasting_s", [0.0, 900.0])
def test_a_step_of_the_clock_at_the_edge_of_a_chunk_is_judged_by_the_next(tmp_path, lasting_s):
    """The clock of the vehicle goes on for `lasting_s` in each step: 0 if the recorder's was set."""
    for before in range(256, 274):  # a chunk of 64 kB ends in one of these rows, before its attitude
        log = Recorder()
        for row in range(before + 100):
            late = row >= before
            boot_ms, time_s = 100 * row + round(1000 * lasting_s * late), 0.1 * row + 900.0 * late
            for _ in range(5):
                log.add(time_s, log.dialect.MAVLink_vfr_hud_message(0.0, 0.0, 0, 50, 500.0, 0.0))
            log.add(time_s, log.dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0))
        path = tmp_path / "edge.tlog"
        path.write_bytes(log.data)
        index = scan(path, chunk_bytes=1 << 16)
        assert index.last_s - index.first_s == pytest.approx(0.1 * (before + 99) + lasting_s, abs=0.2), before


def test_two_vehicles_with_one_system_id_are_said(tmp_path):
    log = Recorder()
    for row in range(100):
        for since_ms in (0, 400_000):
            log.add(0.1 * row, log.dialect.MAVLink_attitude_message(since_ms + 100 * row, 0, 0, 0, 0, 0, 0))
    path = tmp_path / "both.tlog"
    path.write_bytes(log.data)
    assert "several vehicles have this system id" in " ".join(open_log(path).summary.time_base.doubts)


def test_a_part_from_the_middle_is_the_same_as_that_part_of_the_whole(tmp_path):
    path = tmp_path / "flight.tlog"
    record(path, fly(duration_s=300.0))
    log = open_log(path)
    begin = log.summary.start_s + 200.0
    whole = TelemetryTrack.joined(log.tracks()).between(begin, begin + 10.0)
    part = TelemetryTrack.joined(log.tracks(begin, begin + 10.0))
    assert part.time_s == pytest.approx(whole.time_s)
    assert np.nan_to_num(part.values) == pytest.approx(np.nan_to_num(whole.values))


def test_a_csv_with_our_names_needs_no_mapping(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,roll_rad,soc\n0.0,0.1,0.9\n0.1,,0.8\nrubbish,1,2\n0.05,0.2,0.7\n")
    log = open_log(path)
    track = TelemetryTrack.joined(log.tracks())
    assert track["soc"].tolist() == [0.9, 0.8, 0.7]
    assert math.isnan(track["roll_rad"][1])
    assert track.time_s.tolist() == [0.0, 0.1, 0.1]
    assert log.summary.skipped_bytes == len("rubbish,1,2\n")
    assert not log.summary.time_base.absolute
    assert any("earlier" in doubt for doubt in log.summary.time_base.doubts)


def test_names_of_columns_may_have_capitals_and_positions_short_names(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("Timestamp,Lat,Lon,Roll_Rad\n1.5,46.5,6.6,0.1\n2.5,46.6,6.7,0.2\n")
    track = one_track(path)
    assert track.time_s.tolist() == [1.5, 2.5]
    assert track["lat_deg"].tolist() == [46.5, 46.6]
    assert track["lon_deg"].tolist() == [6.6, 6.7]
    assert track["roll_rad"].tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    ("header", "time"),
    [("time", "2013-07-10T18:00:01Z"), ("Timestamp", "2013-07-10 14:00:01-04:00"), ("time_utc", "2013-07-10 18:00:01")],
)
def test_times_of_a_csv_may_be_text(tmp_path, header, time):
    path = tmp_path / "log.csv"
    path.write_text(f"{header},soc\nrubbish,0.9\n{time},0.8\n")
    log = open_log(path)
    assert log.summary.time_base.absolute
    assert log.summary.start_s == datetime(2013, 7, 10, 18, 0, 1, tzinfo=UTC).timestamp()
    assert TelemetryTrack.joined(log.tracks())["soc"].tolist() == [0.8]


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("time,soc\n2013-07-10 18:00,0.9\n", "time: the time has no UTC offset .*18:00.*; write it as .*, or name the column time_utc"),
        ("time,soc\nnoon,0.9\n", "time: is not a time .*noon.*; a number in s"),
        ("time,soc,soc\n1,0.9,0.8\n", "soc: the column appears twice"),
        ("time\tsoc\n1\t0.9\n", "separated by tabs"),
    ],
)  # fmt: skip
def test_a_csv_that_cannot_be_read_is_refused_with_what_is_wrong(tmp_path, table, told):
    (tmp_path / "log.csv").write_text(table)
    with pytest.raises(InputError, match=told):
        open_log(tmp_path / "log.csv")


def test_a_csv_separated_by_semicolons_is_the_same_log(tmp_path):
    text = "time_s,roll_rad,soc\n0.0,0.1,0.9\n0.1,,0.8\n"
    tracks = []
    for name, table in (("commas.csv", text), ("semicolons.csv", text.replace(",", ";"))):
        (tmp_path / name).write_text(table)
        tracks.append(one_track(tmp_path / name))
    assert np.array_equal(tracks[0].values, tracks[1].values, equal_nan=True)
    (tmp_path / "decimal.csv").write_text("time_s;roll_rad;soc\n0;0;0,9\n")
    with pytest.raises(
        InputError, match=r"decimal\.csv:2: has a decimal comma between semicolons .*0,9.*; write decimal points"
    ):
        open_log(tmp_path / "decimal.csv")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_csv_in_utf_16_is_named_as_such(tmp_path, encoding):
    (tmp_path / "log.csv").write_bytes("time_s,roll_rad,soc\n0.0,0.1,0.9\n".encode(encoding))
    with pytest.raises(InputError, match=r"log\.csv: is UTF-16 text; save it with the encoding UTF-8"):
        open_log(tmp_path / "log.csv")


def test_a_position_of_zero_zero_and_a_power_beyond_numbers_are_unknown(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,lat_deg,lon_deg,voltage_v,current_a\n0,0,0,1e308,10\n1,0,8,22,10\n2,47,0,22,10\n")
    track = one_track(path)  # a warning would be an error
    assert [math.isnan(one) for one in track["lat_deg"]] == [True, False, False]
    assert [math.isnan(one) for one in track["lon_deg"]] == [True, False, False]
    assert [math.isnan(one) for one in track["power_w"]] == [True, False, False]


def test_a_csv_is_read_by_a_mapping(tmp_path):
    mapping = tmp_path / "columns.toml"
    mapping.write_text(
        'schema = "skyway.log-columns/1"\ntime = "when"\ntime_unit = "iso"\n'
        '[columns.roll_rad]\ncolumn = "Roll"\nfactor = 0.017453292519943295\n[columns.payload_kg]\ncolumn = "Load"\nfactor = 0.001\n'
    )
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"when,Roll,Load\n2023-01-01T00:00:00Z,90,500\n2023-01-01T00:00:01Z,45,500\n"))
    log = open_log(path, read_columns(mapping))
    assert one_track(path, columns=read_columns(mapping))["roll_rad"][0] == pytest.approx(math.pi / 2)
    assert log.payload_kg == 0.5
    assert log.summary.start_s == 1672531200.0


def test_a_mapping_tells_every_fault(tmp_path):
    mapping = tmp_path / "columns.toml"
    mapping.write_text('time_unit = "h"\n[columns.rol_rad]\ncolumn = "Roll"\n')
    with pytest.raises(InputError) as caught:
        read_columns(mapping)
    text = str(caught.value)
    assert "time_unit" in text
    assert "rol_rad" in text
    assert "time: is missing" in text


def test_velocities_of_the_m100_flights_agree_with_their_positions(shared_data):
    """Body velocity (forward, left, up) turned by an east-north-up attitude, against GPS over 5 s."""
    track = one_track(shared_data / "power" / "m100_flight_269.csv")
    grid = np.arange(track.time_s[0], track.time_s[-1], 5.0)
    for name, position in (
        ("vel_north_mps", track["lat_deg"] * 111_100.0),
        ("vel_east_mps", track["lon_deg"] * 111_320.0 * math.cos(math.radians(40.46))),
    ):
        step = np.diff(track.time_s)
        way = np.concatenate(([0.0], np.cumsum(0.5 * (track[name][1:] + track[name][:-1]) * step)))
        difference = np.diff(np.interp(grid, track.time_s, position)) - np.diff(np.interp(grid, track.time_s, way))
        assert np.std(difference / 5.0) < 0.2


@pytest.mark.parametrize(
    ("name", "data", "expected"),
    [
        ("a.bin", b"ULog\x01\x12\x35\x01" + bytes(8), "ulog"),
        ("a.ulg", b"\xa3\x95\x80" + bytes(100), "dataflash"),
        ("a.log", b"time_s,soc\n0,1\n", "csv"),
        ("a.csv", struct.pack(">Q", START_US) + b"\xfe\x09\x00\x01\x01\x00" + bytes(20), "tlog"),
        ("a.tlog", b"\xff\x00\xff\x01rubbish\x00", "tlog"),
    ],
)
def test_a_format_is_told_by_its_content_not_its_name(tmp_path, name, data, expected):
    path = tmp_path / name
    path.write_bytes(data)
    assert format_of(path) == expected


def test_an_empty_file_a_folder_and_a_picture_are_no_logs(tmp_path):
    empty = tmp_path / "empty.tlog"
    empty.touch()
    picture = tmp_path / "flight.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    for path, why in (
        (empty, "is empty"),
        (picture, "not a known flight log format"),
        (tmp_path, "cannot be read"),
        (tmp_path / "x", "cannot be read"),
    ):
        with pytest.raises(InputError, match=why):
            open_log(path)


@pytest.mark.parametrize(
    "name",
    [
        "cuav_quadplane_flight.tlog",
        "erle_copter_auto_20141205.BIN",
        "flugdrohne_20230621_log66.ulg",
        "pyulog_sample_log_small.ulg",
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_a_log_cut_short_or_overwritten_in_places_never_breaks_the_reader(shared_data, tmp_path, name, seed):
    generator = np.random.default_rng(seed)
    data = np.frombuffer((shared_data / "logs" / name).read_bytes(), np.uint8)[
        : int(generator.integers(1000, 400_000))
    ].copy()
    for _ in range(20):
        at = int(generator.integers(0, len(data)))
        data[at : at + 30] = generator.integers(0, 256, len(data[at : at + 30]))
    path = tmp_path / name
    path.write_bytes(data.tobytes())
    try:
        log = open_log(path)
    except InputError:
        return  # said so; anything else is a fault of the reader
    for track in log.tracks():
        assert track.values.shape[1] == len(QUANTITIES)
        assert (np.diff(track.time_s) >= 0.0).all()


def test_a_cut_log_holds_its_beginning(shared_data, tmp_path):
    for name in ("cuav_quadplane_flight.tlog", "erle_copter_auto_20141205.BIN", "flugdrohne_20230621_log66.ulg"):
        source = shared_data / "logs" / name
        path = tmp_path / name
        shutil.copy(source, path)
        path.chmod(0o644)
        path.write_bytes(source.read_bytes()[: source.stat().st_size * 2 // 3])
        whole, cut = open_log(source).summary, open_log(path).summary
        assert 0.4 * whole.messages < cut.messages < whole.messages


def test_a_ulog_says_what_it_skipped_and_prints_nothing(shared_data, tmp_path, capsys):
    source = (shared_data / "logs" / "flugdrohne_20230621_log66.ulg").read_bytes()
    assert open_log(shared_data / "logs" / "flugdrohne_20230621_log66.ulg").summary.skipped_bytes == 0
    path = tmp_path / "damaged.ulg"
    path.write_bytes(source[:2_000_000] + bytes(500) + source[2_000_000:3_000_000])
    summary = open_log(path).summary
    assert summary.skipped_bytes >= 500
    assert summary.messages > 20_000
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", ["erle_copter_auto_20141205.BIN", "flugdrohne_20230621_log66.ulg"])
def test_the_size_of_the_pieces_a_log_is_read_in_does_not_matter(shared_data, monkeypatch, name):
    path = shared_data / "logs" / name
    whole = open_log(path)
    monkeypatch.setattr(pieces, "PIECE_BYTES", 100_000)
    small = open_log(path)
    assert small.summary == whole.summary
    first, second = (TelemetryTrack.joined(log.tracks()) for log in (whole, small))
    assert len(list(small.tracks())) > 5
    assert first.time_s == pytest.approx(second.time_s)
    assert np.nan_to_num(first.values) == pytest.approx(np.nan_to_num(second.values))


@pytest.mark.parametrize("name", ["erle_copter_auto_20141205.BIN", "flugdrohne_20230621_log66.ulg"])
def test_a_part_from_the_middle_of_any_log_is_that_part_of_the_whole(shared_data, monkeypatch, name):
    monkeypatch.setattr(pieces, "PIECE_BYTES", 100_000)
    log = open_log(shared_data / "logs" / name)
    middle = 0.6 * log.summary.start_s + 0.4 * log.summary.end_s
    whole = TelemetryTrack.joined(log.tracks()).between(middle, middle + 5.0)
    part = TelemetryTrack.joined(log.tracks(middle, middle + 5.0))
    assert part.time_s == pytest.approx(whole.time_s)
    assert np.nan_to_num(part["roll_rad"]) == pytest.approx(np.nan_to_num(whole["roll_rad"]))
    assert np.nan_to_num(part["vel_north_mps"]) == pytest.approx(np.nan_to_num(whole["vel_north_mps"]))
    again = TelemetryTrack.joined(log.tracks(middle, middle + 5.0))
    assert np.array_equal(again.values, part.values, equal_nan=True), "what lasts is known each time"


def test_a_table_is_read_in_pieces_and_an_endless_line_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("time_s,soc\n" + "".join(f"{row / 10},{1.0 - row / 1000}\n" for row in range(500)))
    whole = one_track(path)
    monkeypatch.setattr(csv_log, "PIECE_ROWS", 37)
    log = open_log(path)
    tracks = list(log.tracks())
    assert len(tracks) > 10
    assert TelemetryTrack.joined(tracks)["soc"].tolist() == whole["soc"].tolist()
    path.write_text("time_s,soc\n" + "1" * (csv_log.MAX_LINE + 10))
    with pytest.raises(InputError, match="longer than"):
        open_log(path)
