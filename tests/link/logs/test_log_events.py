"""What a log tells of the flight in its events, and whether the vehicle is in the air at its end."""

import numpy as np
import pytest
from drone_truth import fly
from log_factory import DataFlashWriter, dataflash, multirotor, tlog, ulog

from skyway.link.logs.dataflash.messages import EVENTS, error_text
from skyway.link.logs.reader import open_log
from skyway.link.logs.tlog.events import mode_name
from skyway.link.replay.replay import replay

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own
FLIGHT = multirotor(fly(seed=3, duration_s=60.0))


def texts(path):
    summary = open_log(path).summary
    return {event.text: round(event.time_s - summary.start_s, 1) for event in summary.events}


def small_dataflash(timed=True):
    """A flight that ends in a crash, with times on every message or, as before 2015, on none of these."""
    log = DataFlashWriter()

    def say(name, letters, columns, second, *values):
        if timed:
            log.add(name, "Q" + letters, "TimeUS," + columns, round(1e6 * second), *values)
        else:
            log.add(name, letters, columns, *values)

    def move(second):
        stamp = ("Q", "TimeUS", round(1e6 * second)) if timed else ("I", "TimeMS", round(1e3 * second))
        log.add("ATT", stamp[0] + "ccc", stamp[1] + ",Roll,Pitch,Yaw", stamp[2], 3.0, second % 7, 0.0)
        log.add("EKF1", stamp[0] + "fff", stamp[1] + ",VN,VE,VD", stamp[2], 4.0 + 0.1 * (second % 3), 1.0, 0.0)

    for tenth in range(600):
        second = 1.0 + tenth / 10.0
        move(second)
        if tenth == 0:
            say("MSG", "Z", "Message", second, "ArduCopter V3.6.12")
        if tenth == 20:
            say("EV", "B", "Id", second, 10)
            say(
                "MODE",
                "MBB" if timed else "MB",
                "Mode,ModeNum,Rsn" if timed else "Mode,ThrCrs",
                second,
                *((3, 3, 1) if timed else (3, 1)),
            )
        if tenth == 50:
            say("EV", "B", "Id", second, 28)
        if tenth == 300:
            say("ERR", "BB", "Subsys,ECode", second, 5, 1)
            say(
                "MODE",
                "MBB" if timed else "MB",
                "Mode,ModeNum,Rsn" if timed else "Mode,ThrCrs",
                second,
                *((6, 6, 4) if timed else (6, 1)),
            )
        if tenth == 500:
            say("ERR", "BB", "Subsys,ECode", second, 12, 1)
            say("EV", "B", "Id", second, 11)
    return log


@pytest.mark.parametrize("timed", [True, False])
def test_a_dataflash_log_tells_arming_modes_failsafes_and_the_crash_with_their_times(tmp_path, timed):
    path = tmp_path / "flight.bin"
    path.write_bytes(small_dataflash(timed).data)
    told = texts(path)
    expected = {
        "armed": 2.0,
        "mode AUTO": 2.0,
        "has left the ground": 5.0,
        "error: radio failsafe: triggered": 30.0,
        "mode RTL": 30.0,
        "error: crash detected": 50.0,
        "disarmed": 50.0,
    }
    for text, second in expected.items():
        assert told[text] == pytest.approx(second, abs=0.15)


def test_after_a_crash_nothing_is_still_in_the_air(tmp_path):
    path = tmp_path / "flight.bin"
    path.write_bytes(small_dataflash().data)
    found = replay(open_log(path))
    (leg,) = found.legs
    assert leg.end_s - found.summary.start_s == pytest.approx(50.0, abs=1.5)
    assert not any("still in the air" in event.text for event in found.events)


@pytest.mark.parametrize("form", [dataflash, tlog, ulog])
def test_a_log_that_ends_in_flight_says_so(tmp_path, form):
    path = tmp_path / "flight.log"
    path.write_bytes(form(FLIGHT).data)
    assert any("still in the air" in event.text for event in replay(open_log(path)).events)


def test_a_log_that_ends_a_moment_after_landing_does_not(tmp_path):
    log = ulog(FLIGHT)
    log.add("vehicle_land_detected", 62.0, 1)
    log.add("vehicle_status", 62.1, 3, 1, 0, 1, 0, 0, 2, 1)
    log.add("vehicle_attitude", 63.0, 1.0, 0.0, 0.0, 0.0)
    path = tmp_path / "flight.ulg"
    path.write_bytes(log.data)
    found = replay(open_log(path))
    assert not any("still in the air" in event.text for event in found.events)
    assert any("landed" in event.text for event in found.events)


def test_a_disarmed_vehicle_is_not_in_the_air_whatever_its_height(tmp_path):
    log = tlog(FLIGHT)
    for second in range(61, 64):
        log.add(second, log.dialect.MAVLink_heartbeat_message(2, 3, 1, 5, 3, 3), first_version=True)
        log.add(second, log.dialect.MAVLink_attitude_message(second * 1000, 0.1, 0, 0, 0, 0, 0), first_version=True)
        message = log.dialect.MAVLink_global_position_int_message(
            second * 1000, 470000000, 80000000, 500000, 60000, 0, 0, 0, 0
        )
        log.add(second, message, first_version=True)
    path = tmp_path / "flight.tlog"
    path.write_bytes(log.data)
    found = replay(open_log(path))
    assert not any("still in the air" in event.text for event in found.events)


def test_a_tlog_tells_modes_arming_failsafe_and_texts_that_come_in_pieces(tmp_path):
    log = tlog({name: values[:50] for name, values in FLIGHT.items()}, modes=lambda row: 0 if row < 20 else 6)
    kinds = log.dialect
    log.add(6.0, kinds.MAVLink_heartbeat_message(2, 3, 1, 6, 5, 3))
    long = b"EKF3 IMU0 forced reset because of something that takes more than fifty bytes"
    log.add(6.1, kinds.MAVLink_statustext_message(4, long[:50], 7, 0))
    log.add(6.1, kinds.MAVLink_statustext_message(4, long[50:], 7, 1))
    log.add(6.2, kinds.MAVLink_statustext_message(2, b"Crash: Disarming"))
    path = tmp_path / "flight.tlog"
    path.write_bytes(log.data)
    told = texts(path)
    assert told["mode STABILIZE"] == 0.0
    assert told["mode RTL"] == pytest.approx(2.0)
    assert told["armed"] == 0.0
    assert told["failsafe"] == pytest.approx(6.0)
    assert told["disarmed"] == pytest.approx(6.0)
    assert long.decode() in told
    assert "Crash: Disarming" in told


def test_a_ulog_tells_modes_failsafes_failures_and_disarming(tmp_path):
    log = ulog({name: values[:50] for name, values in FLIGHT.items()})
    log.topic("failsafe_extra", value="uint8_t")
    log.add("vehicle_status", 8.0, 5, 2, 1, 1, 0, 0, 2, 1)
    log.add("vehicle_status", 9.0, 18, 2, 1, 1, 0, 0, 2, 1)
    log.text(9.5, "Failsafe activated")
    log.add("vehicle_status", 10.0, 18, 1, 0, 1, 0, 0, 2, 1)
    path = tmp_path / "flight.ulg"
    path.write_bytes(log.data)
    told = texts(path)
    assert told["mode mission"] == 0.0
    assert told["mode return"] == pytest.approx(6.0)
    assert told["failsafe"] == pytest.approx(6.0)
    assert told["mode land"] == pytest.approx(7.0)
    assert told["Failsafe activated"] == pytest.approx(7.5)
    assert told["failsafe over"] == pytest.approx(8.0)
    assert told["disarmed"] == pytest.approx(8.0)


def test_events_stay_the_same_however_the_log_is_cut_into_pieces(tmp_path, monkeypatch):
    from skyway.link.logs.common import pieces

    for form in (dataflash(FLIGHT, modes=lambda row: 5 if row < 200 else 9), ulog(FLIGHT)):
        path = tmp_path / "flight.log"
        path.write_bytes(form.data)
        whole = open_log(path)
        monkeypatch.setattr(pieces, "PIECE_BYTES", 10_000)
        small = open_log(path)
        assert small.summary.events == whole.summary.events
        assert small.summary.vehicles == whole.summary.vehicles
        late = list(small.tracks(whole.summary.start_s + 50.0))
        assert np.isfinite(np.concatenate([track["armed"] for track in late])).all()
        monkeypatch.undo()


def test_every_number_of_an_error_an_event_and_a_mode_has_words():
    for subsystem in range(256):
        for code in range(8):
            assert error_text("multirotor", subsystem, code)
    assert all(EVENTS.values())
    assert mode_name(3, "multirotor", 9) == "LAND"
    assert mode_name(3, "VTOL", 19) == "QLOITER"
    assert mode_name(3, "unknown", 19) == "number 19"
    assert mode_name(12, "multirotor", 4 << 16 | 5 << 24) == "return"
    assert mode_name(0, "unknown", 7) == "number 7"
