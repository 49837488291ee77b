"""Simulated vehicles write logs of their flights as the real ones do: our readers, and others', find the flight in them."""

import math

import numpy as np
import pytest
from wires import FAMILIES, Scene, a_mission

from skyway.link.logs.reader import open_log
from skyway.link.vehicle.vehicle import Vehicle
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.sim_stub.plant.physics import offset_m


def flies(scene):
    """Fly a short mission; returns when and where it was seen."""
    craft = scene.craft
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)
    body = scene.vehicle.body
    seen = (scene.vehicle.posix_s, body.lat, body.lon, body.alt_m)
    assert scene.connection.wait(lambda: not craft.armed, 300.0)
    scene.connection.run_for(3.0)
    return seen


def aboard(family, room_bytes=5_000_000):
    scene = Scene(family, log_room_bytes=room_bytes)
    scene.craft = Vehicle(scene.connection)
    scene.craft.request_telemetry()
    scene.craft.upload(a_mission(3, height=28.0))
    return scene


@pytest.fixture(scope="module", params=FAMILIES)
def twice(request):
    """A vehicle that has flown twice."""
    scene = aboard(request.param)
    scene.seen = [flies(scene), flies(scene)]
    return scene


def logs(scene, folder):
    found = []
    for path, file in scene.vehicle.card.logs(scene.vehicle.autopilot.LOG_ENDINGS):
        found.append(folder / path.rsplit("/", 1)[1])
        found[-1].write_bytes(file.content)
    return found


def test_a_flight_is_found_in_its_log(twice, tmp_path):
    files = logs(twice, tmp_path)
    assert len(files) == (2 if twice.family == "px4" else 1)  # one for each arming, or one as long as it is switched on
    for when, lat, lon, alt_m in twice.seen[-len(files) :]:
        log = open_log(files[0 if len(files) == 1 else twice.seen.index((when, lat, lon, alt_m))])
        assert log.summary.skipped_bytes == 0
        assert log.summary.vehicle(1).kind == "multirotor"
        texts = [event.text for event in log.summary.events]
        assert texts.count("armed") == texts.count("disarmed") == 3 - len(files), texts
        track = TelemetryTrack.joined(log.tracks())
        at = int(np.argmin(np.abs(track.time_s - when)))
        assert abs(track.time_s[at] - when) < 0.5
        assert math.hypot(*offset_m(lat, lon, track["lat_deg"][at], track["lon_deg"][at])) < 8.0
        assert track["alt_msl_m"][at] == pytest.approx(alt_m, abs=3.0)
        assert np.nanmin(track["soc"]) >= twice.vehicle.battery.soc - 0.02


def test_a_restart_begins_another_log(tmp_path):
    scene = aboard("ardupilot")
    for _ in range(2):
        scene.craft.set_mode("guided")
        scene.craft.arm(patience_s=60.0)
        scene.craft.disarm()
        scene.connection.run_for(2.0)
        scene.vehicle.reboot_soon()
        scene.connection.run_for(8.0)
    first, second = logs(scene, tmp_path)
    assert (first.name, second.name) == ("00000001.BIN", "00000002.BIN")
    assert second.read_bytes().startswith(scene.vehicle.autopilot.LOG_HEAD)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_full_card_ends_the_log_with_a_whole_message(family, tmp_path):
    scene = aboard(family, room_bytes=8_000)
    scene.craft.start(patience_s=60.0)
    scene.connection.run_for(15.0)
    (file,) = logs(scene, tmp_path)
    assert 7_000 < file.stat().st_size <= 8_000
    assert open_log(file).summary.skipped_bytes == 0


def test_no_room_writes_no_log():
    scene = Scene("px4")
    assert scene.vehicle.flight_log is None


def test_others_read_them(twice, tmp_path):
    {"ardupilot": pymavlink_reads, "px4": pyulog_reads}[twice.family](twice, logs(twice, tmp_path)[0])


def pymavlink_reads(scene, file):
    from pymavlink.DFReader import DFReader_binary

    theirs, found = DFReader_binary(str(file)), {}
    try:
        while (message := theirs.recv_msg()) is not None:
            found.setdefault(message.get_type(), []).append(message)
        assert theirs.remaining == 0
    finally:
        theirs.filehandle.close()
    when, lat, lon, alt_m = scene.seen[0]
    nearest = min(found["POS"], key=lambda one: abs(one._timestamp - when))
    assert abs(nearest._timestamp - when) < 0.5
    assert math.hypot(*offset_m(lat, lon, nearest.Lat, nearest.Lng)) < 8.0
    assert nearest.Alt == pytest.approx(alt_m, abs=3.0)
    assert len(found["PARM"]) == len(scene.vehicle.autopilot.parameters)


def pyulog_reads(scene, file):
    pyulog = pytest.importorskip("pyulog")
    theirs = pyulog.ULog(str(file))
    assert not theirs.file_corruption
    topics = {one.name: one.data for one in theirs.data_list}
    when, lat, lon, alt_m = scene.seen[0]
    fixes = topics["sensor_gps"]
    at = int(np.argmin(np.abs(fixes["time_utc_usec"] * 1e-6 - when)))
    assert math.hypot(*offset_m(lat, lon, fixes["latitude_deg"][at], fixes["longitude_deg"][at])) < 12.0
    assert fixes["altitude_msl_m"][at] == pytest.approx(alt_m, abs=5.0)
    store = scene.vehicle.autopilot.parameters
    assert {name: theirs.initial_parameters[name] for name in ("MPC_XY_CRUISE", "NAV_DLL_ACT")} == {
        name: store[name] for name in ("MPC_XY_CRUISE", "NAV_DLL_ACT")
    }
