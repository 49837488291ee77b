"""Every verb, with both drivers, on both autopilots: the same conduct, whoever speaks.

The pymavlink driver flies in virtual time. MAVSDK knows the wall's time only: it flies a simulated vehicle that is served
on a socket and runs twenty times as fast.
"""

import contextlib
import math
import socket
import struct
from itertools import pairwise

import pytest
from sim_serving import free_port, served
from wires import FAMILIES, LAT, LON, Scene, a_fence, a_mission, bad_radio, some_rally_points

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.opening import open_connection
from skyway.link.protocol.verified import UploadState
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.base.clock import WallClock
from skyway.models.base.errors import CommandRefusedError, InputError, ParameterAbsentError
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.transports.lockstep import VirtualClock

DRIVERS = ("pymavlink", "mavsdk")
SPEEDUP = 20.0
NO_LINK_FAILSAFE = {"px4": (("NAV_DLL_ACT", 0.0),), "ardupilot": (("FS_GCS_ENABLE", 0.0),)}
"""At twenty times the speed our heartbeat is rare."""


class Site:
    """A vehicle of ours, the simulated one at the other end, and how to let time pass."""

    def __init__(self, craft, simulated, speed):
        self.craft, self.simulated, self.speed = craft, simulated, speed
        self.family = craft.family.name

    def wait(self, condition, longest_s):
        """Wait in the vehicle's time; at wall time with room for a busy computer."""
        slack = 0.0 if self.speed == 1.0 else 5.0
        return self.craft.connection.wait(condition, longest_s / self.speed + slack)

    def run_for(self, duration_s):
        self.craft.connection.run_for(duration_s / self.speed)


@contextlib.contextmanager
def by_pymavlink(family, *, speedup=1.0, **how):
    scene = Scene(family, **how)
    yield Site(Vehicle(scene.connection), scene.vehicle, 1.0)


@contextlib.contextmanager
def by_mavsdk(family, *, speedup=SPEEDUP, **how):
    pytest.importorskip("mavsdk")
    from skyway.link.vehicle.mavsdk_vehicle import MavsdkVehicle

    how["parameters"] = how.get("parameters", ()) + NO_LINK_FAILSAFE[family]
    with served(tcp_port=0, autopilot=family, speedup=speedup, **how) as there:
        host, port = there.where()
        connection = open_connection(f"tcp:{host}:{port}", record=None)
        craft = MavsdkVehicle(connection, 1)
        try:
            yield Site(craft, there.world.vehicles[1], speedup)
        finally:
            craft.close()
            connection.close()


SITES = {"pymavlink": by_pymavlink, "mavsdk": by_mavsdk}
both = pytest.mark.parametrize(("driver", "family"), [(d, f) for d in DRIVERS for f in FAMILIES])
at_length = pytest.mark.parametrize(
    ("driver", "family"),
    [pytest.param(d, f, marks=[pytest.mark.slow] if d == "mavsdk" else []) for d in DRIVERS for f in FAMILIES],
)
"""Seconds of wall time with MAVSDK."""


@pytest.fixture
def site(driver, family):
    with SITES[driver](family) as found:
        yield found


def airborne(site):
    assert site.craft.upload(a_mission(6, height=12.0)).verified
    assert not site.craft.request_telemetry()
    site.craft.start(patience_s=60.0)
    assert site.wait(lambda: site.craft.live.latest("height_m") > 10.0, 120.0)


def distance_m(site, lat, lon):
    body = site.simulated.body
    return math.hypot(*offset_m(lat, lon, body.lat, body.lon))


@both
def test_it_tells_who_it_is_and_where_its_home_is(site):
    identity = site.craft.identify()
    assert (identity.system, identity.autopilot, identity.kind) == (1, site.family, 2)
    assert identity.version == ("1.16.0" if site.family == "px4" else "4.6.0")
    assert identity.uid == 0x5A17_0000_0000_0001
    assert {"missions", "fences", "rally points", "MAVLink 2"} <= set(identity.words)
    home = site.craft.home()
    assert (home.lat_deg, home.lon_deg, home.alt_msl_m) == pytest.approx((LAT, LON, 5.0), abs=0.5)
    site.craft.check_ground_station()


@both
def test_parameters_real_and_whole_are_read_set_and_listed(site):
    real, whole = ("MPC_XY_CRUISE", "COM_DLL_EXCEPT") if site.family == "px4" else ("WPNAV_SPEED", "FS_OPTIONS")
    store = site.simulated.autopilot.parameters
    for name, value in ((real, 7.5), (whole, 11.0)):
        before = site.craft.parameter(name)
        assert before.value == store[name]
        assert site.craft.set_parameter(name, value).value == value
        assert store[name] == value
        assert site.craft.parameter(name).kind == before.kind == store.find(name).kind
    every = site.craft.parameters()
    assert len(every) == len(store)
    assert all(value.value == pytest.approx(store[name], rel=1e-6) for name, value in every.items())
    with pytest.raises(InputError, match="not a finite number"):
        site.craft.set_parameter(real, math.nan)


@at_length
def test_a_parameter_that_is_not_there_is_said_to_be_unknown(site):
    with pytest.raises(ParameterAbsentError, match="has no parameter NO_SUCH"):
        site.craft.parameter("NO_SUCH")


@both
@pytest.mark.parametrize(
    ("kind", "part"),
    [
        (MissionKind.MISSION, a_mission(12)),
        (MissionKind.FENCE, a_fence()),
        (MissionKind.RALLY, some_rally_points()),
    ],
    ids=("mission", "fence", "rally"),
)
def test_what_is_uploaded_is_verified_downloaded_and_cleared(site, kind, part):
    craft, told = site.craft, []
    outcome = craft.upload(part, progress=lambda *step: told.append(step))
    assert outcome.verified
    assert any(what == "sending" and done == total for what, done, total in told)
    assert craft.verify(part) == ()
    down = craft.download(kind)
    assert type(down) is type(part)
    assert craft.verify(down) == ()
    craft.clear(kind)
    assert craft.verify(part)
    assert craft.verify(type(part)()) == ()


@both
def test_any_item_can_be_made_the_current_one(site):
    site.craft.upload(a_mission(12))
    for item in (3, 7, 0):
        site.craft.set_current(item)
        shift = int(site.family == "ardupilot")
        assert site.simulated.autopilot.run.current == item + shift


@both
def test_a_mission_that_the_vehicle_refuses_leaves_what_it_had_and_names_the_item(site):
    craft, good = site.craft, a_mission(6)
    assert craft.upload(good).verified
    items = list(good.items)
    items[3] = MissionItem(Command(31010), Frame.MISSION) if 31010 in set(Command) else unknown_item(items[3])
    outcome = craft.upload(Mission(tuple(items)))
    assert outcome.state in (UploadState.REFUSED, UploadState.ROLLED_BACK)
    assert 3 in outcome.items
    assert "command is not supported" in outcome.reason or "invalid" in outcome.reason
    assert craft.verify(good) == ()
    assert craft.blocked is None


def unknown_item(item):
    """An item on a place that is none."""
    return MissionItem(item.command, item.frame, x=2_000_000_000, y=item.y, z=item.z, param4=item.param4)


@both
def test_it_arms_disarms_and_switches_modes(site):
    craft = site.craft
    for mode in ("position", "hold", "guided"):
        craft.set_mode(mode)
        assert site.simulated.autopilot.custom_mode() == craft.family.modes.numbers[mode]
    craft.arm(patience_s=60.0)
    assert site.simulated.autopilot.armed
    assert site.wait(lambda: craft.armed, 5.0)
    craft.disarm()
    assert not site.simulated.autopilot.armed
    with pytest.raises(InputError, match="no such mode"):
        craft.set_mode("loop the loop")


@both
def test_a_flight_is_paused_resumed_led_elsewhere_and_brought_home(site):
    craft = site.craft
    airborne(site)
    assert craft.armed
    assert craft.mode == "mission"
    assert site.wait(lambda: craft.mission_state == "active", 5.0)
    craft.pause()
    site.run_for(6.0)
    body = site.simulated.body
    here = (body.lat, body.lon)
    site.run_for(5.0)
    assert distance_m(site, *here) < 2.0
    craft.resume()
    craft.change_speed(4.0)
    assert site.wait(lambda: math.hypot(*map(craft.live.latest, ("vel_north_mps", "vel_east_mps"))) > 3.0, 30.0)
    craft.go_to(LAT + 0.0003, LON, 16.0)
    assert site.wait(lambda: distance_m(site, LAT + 0.0003, LON) < 3.0 and abs(body.alt_m - 21.0) < 2.0, 90.0)
    craft.return_home()
    assert site.wait(lambda: craft.mode == "return", 5.0)
    craft.land()
    assert site.wait(lambda: craft.mode == "land", 5.0)
    assert site.wait(lambda: not craft.armed, 200.0)
    assert body.grounded


@at_length
def test_a_mission_is_changed_in_flight(site):
    craft = site.craft
    airborne(site)
    assert craft.change_in_flight(a_mission(8, height=20.0), 3).verified
    assert craft.mode == "mission"
    assert site.simulated.autopilot.run.current >= 3 + (site.family == "ardupilot")
    assert site.wait(lambda: not craft.armed, 400.0)
    assert craft.live.reached
    changes = {(change.what, change.after, change.ours) for change in craft.changes()}
    assert {("armed", "armed", True), ("mode", "mission", True), ("armed", "disarmed", False)} <= changes


@both
def test_telemetry_comes_as_typed_samples_at_the_rates_asked_for(site):
    assert site.craft.request_telemetry() == ()
    site.run_for(3.0)
    list(site.craft.samples(0.01))
    found = list(site.craft.samples(10.0 / site.speed))
    assert len(found) >= 80
    last = found[-1]
    assert all(b.time_s > a.time_s for a, b in pairwise(found))
    assert found[-1].time_s - found[0].time_s == pytest.approx(10.0, abs=1.5)
    assert (last.lat_deg, last.lon_deg) == pytest.approx((LAT, LON), abs=1e-5)
    assert (last.armed, last.landed) == (0.0, 1.0)
    assert last.soc == pytest.approx(1.0, abs=0.02)
    assert math.isnan(last.wind_north_mps)
    assert math.isnan(last.airspeed_mps)


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("family", FAMILIES)
def test_the_package_is_released_and_the_battery_counter_reset(driver, family):
    gripper = "PD_GRIPPER_EN" if family == "px4" else "GRIP_ENABLE"
    with SITES[driver](family, payload_kg=1.0, soc=0.5, parameters=((gripper, 1.0),)) as site:
        site.craft.request_telemetry()
        site.craft.release()
        assert site.simulated.body.payload_kg == 0.0
        if family == "ardupilot":
            assert site.craft.reset_battery(0.9) == pytest.approx(0.9, abs=0.011)
        else:
            with pytest.raises(CommandRefusedError, match="does not support this command"):
                site.craft.reset_battery(0.9)


@both
def test_arming_is_refused_in_the_vehicles_words(driver, family):
    with (
        SITES[driver](family, faults=(Fault("prearm"),)) as site,
        pytest.raises(CommandRefusedError, match=r"refused to arm.*[Cc]ompass"),
    ):
        site.craft.arm()
    assert any("ompass" in text for text in site.craft.texts())


@both
def test_after_a_restart_it_is_spoken_with_again(site):
    craft = site.craft
    assert craft.upload(a_mission(5)).verified
    craft.request_telemetry()
    site.run_for(3.0)
    site.simulated.reboot_soon()
    assert site.wait(lambda: craft.silent_s > 2.0 / site.speed, 10.0)
    assert site.wait(lambda: craft.silent_s < 0.5 / site.speed, 30.0)
    assert craft.identify().version
    assert craft.request_telemetry() == ()
    assert craft.upload(a_mission(7)).verified
    assert site.wait(lambda: craft.reboots == 1, 10.0)
    assert ("boot", "restarted") in {(change.what, change.after) for change in craft.changes()}


@pytest.mark.slow
def test_mavsdk_goes_on_when_the_link_has_died_and_come_back():
    pytest.importorskip("mavsdk")
    from skyway.link.vehicle.mavsdk_vehicle import MavsdkVehicle

    port = free_port(socket.SOCK_STREAM)
    with served(tcp_port=port, autopilot="px4"):
        connection = open_connection(f"tcp:127.0.0.1:{port}", record=None)
        craft = MavsdkVehicle(connection, 1)
        assert craft.upload(a_mission(5)).verified
    assert connection.wait(lambda: not connection.transport.up, 5.0)
    with served(tcp_port=port, autopilot="px4") as there:
        heard = craft.peer.received
        assert connection.wait(lambda: craft.peer.received > heard, 8.0)
        assert craft.upload(a_mission(7)).verified
        assert len(there.world.vehicles[1].autopilot.stores[0]) == 7
    craft.close()
    connection.close()


@at_length
@pytest.mark.parametrize("loss", [0.05, 0.2])
def test_over_a_bad_radio_what_is_said_to_be_aboard_is_aboard(driver, family, loss):
    with SITES[driver](family, impairment=bad_radio(loss), speedup=1.0) as site:
        outcome = site.craft.upload(a_mission(12))
        assert outcome.verified
        assert len(site.simulated.autopilot.stores[0]) == 12 + (family == "ardupilot")
        site.craft.set_mode("guided")
        site.craft.arm(patience_s=20.0)
        assert site.simulated.autopilot.armed


def test_the_mavsdk_driver_says_in_one_line_what_it_cannot_do(lone_connection):
    pytest.importorskip("mavsdk")
    from skyway.link.vehicle.mavsdk_vehicle import MavsdkVehicle
    from skyway.link.wire.signing import Signing

    signed = Connection(lone_connection.transport, WallClock(), signing=Signing(bytes(32)))
    with pytest.raises(InputError, match=r"cannot sign.*--driver pymavlink") as told:
        MavsdkVehicle(signed)
    assert "\n" not in str(told.value)
    scene = Scene("px4")
    assert isinstance(scene.connection.clock, VirtualClock)
    with pytest.raises(InputError, match="cannot run in virtual time"):
        MavsdkVehicle(scene.connection)
    lone_connection.shared_client = object()
    with pytest.raises(InputError, match="two vehicles on one connection"):
        MavsdkVehicle(lone_connection)


@pytest.fixture
def lone_connection():
    connection = open_connection("udpin:127.0.0.1:0", record=None)
    yield connection
    connection.shared_client = None
    connection.close()


def test_what_mavsdk_says_and_hears_is_recorded_and_its_heart_beats_for_us(tmp_path):
    pytest.importorskip("mavsdk")
    from skyway.link.vehicle.mavsdk_vehicle import MavsdkVehicle
    from skyway.link.wire.frames import FrameReader

    with served(tcp_port=0, autopilot="px4", speedup=5.0) as there:
        host, port = there.where()
        connection = open_connection(f"tcp:{host}:{port}", record=tmp_path, system=250)
        craft = MavsdkVehicle(connection, 1)
        assert craft.upload(a_mission(5)).verified
        connection.run_for(1.2)
        craft.close()
        connection.close()
    (file,) = tmp_path.glob("*.tlog")
    data, names = file.read_bytes(), []
    while data:
        assert len(data) > 8
        size = data[9] + (8 if data[8] == 0xFE else 12)
        found = [message for _, message in FrameReader().feed(data[8 : 8 + size])]
        assert len(found) == 1
        assert struct.unpack(">Q", data[:8])[0] > 1.5e15
        names += [(message.system, message.name) for message in found if message is not None]
        data = data[8 + size :]
    assert names.count((250, "MISSION_ITEM_INT")) >= 5
    assert names.count((1, "MISSION_ITEM_INT")) >= 5
    assert 2 <= names.count((250, "HEARTBEAT")) <= 5
    assert {system for system, _ in names} == {1, 250}
