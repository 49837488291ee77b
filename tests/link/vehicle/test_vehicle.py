"""What one does with a vehicle, on both autopilots, in virtual time."""

import math
import struct
from itertools import pairwise

import pytest
from wires import FAMILIES, LAT, LON, Scene, a_fence, a_mission, bad_radio, changed_frame, rates_hz

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.verified import UploadState
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.signing import Signing
from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.mission import Mission
from skyway.missions.items.parameters import FlightNeeds
from skyway.models.base.errors import (
    CommandRefusedError,
    InputError,
    LinkError,
    ListUnsupportedError,
    ParameterAbsentError,
    StationConflictError,
    UploadMismatchError,
    VehicleTimeoutError,
)
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.physics import offset_m


def aboard(family, **how):
    scene = Scene(family, **how)
    scene.craft = Vehicle(scene.connection)
    if scene.craft.request_telemetry():
        raise AssertionError("telemetry refused")
    return scene


@pytest.fixture(params=FAMILIES)
def scene(request):
    return aboard(request.param)


def test_a_vehicle_tells_who_it_is(scene):
    identity = scene.craft.identify()
    assert identity.autopilot == scene.family
    assert identity.version == ("1.16.0" if scene.family == "px4" else "4.6.0")
    assert identity.uid == 0x5A17_0000_0000_0001
    assert "fences" in identity.words
    assert str(identity).startswith(f"vehicle 1: {scene.family}")


def test_a_mission_is_flown_paused_resumed_and_landed(scene):
    craft = scene.craft
    assert craft.upload(a_mission(4, height=30.0)).verified
    craft.start(patience_s=60.0)
    assert scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)
    craft.pause()
    scene.connection.run_for(8.0)
    here = (scene.vehicle.body.lat, scene.vehicle.body.lon)
    scene.connection.run_for(5.0)
    assert math.hypot(*offset_m(*here, scene.vehicle.body.lat, scene.vehicle.body.lon)) < 2.0
    craft.resume()
    assert scene.connection.wait(lambda: not craft.armed, 300.0)
    assert scene.vehicle.body.grounded
    assert craft.live.reached


def test_it_goes_where_it_is_told_and_returns(scene):
    craft = scene.craft
    craft.upload(a_mission(4, height=30.0))
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)
    craft.go_to(LAT + 0.001, LON, 35.0)
    scene.connection.run_for(40.0)
    body = scene.vehicle.body
    assert math.hypot(*offset_m(LAT + 0.001, LON, body.lat, body.lon)) < 5.0
    assert body.alt_m - 5.0 == pytest.approx(35.0, abs=2.0)
    craft.return_home()
    scene.connection.run_for(3.0)
    assert craft.mode == "return"
    craft.land()
    assert scene.connection.wait(lambda: not craft.armed, 200.0)


def test_a_mission_is_changed_in_flight_on_hold_and_flown_from_the_item_meant(scene):
    craft = scene.craft
    craft.upload(a_mission(6, height=30.0))
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)
    new = a_mission(8, height=45.0)
    outcome = craft.change_in_flight(new, 3)
    assert outcome.verified
    assert craft.mode == "mission"
    assert scene.vehicle.autopilot.run.current == 3 + (scene.family == "ardupilot")
    assert scene.connection.wait(lambda: not craft.armed, 400.0)


def test_an_upload_in_flight_that_is_not_verified_stays_in_hold(scene):
    craft = scene.craft
    craft.upload(a_mission(6, height=30.0))
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)

    def spoil(number, message, frame, up):
        return b"" if message and message.name == "MISSION_ITEM_INT" and message["seq"] == 4 else frame

    scene.link.spoil = spoil
    outcome = craft.change_in_flight(a_mission(8, height=45.0), 3)
    assert outcome.state is UploadState.UNKNOWN
    assert craft.mode == "hold"
    with pytest.raises(UploadMismatchError, match="not resumed"):
        craft.resume()
    with pytest.raises(UploadMismatchError, match="start blocked"):
        craft.start()


def test_arming_is_refused_with_the_vehicles_reason():
    scene = aboard("px4", faults=(Fault("prearm"),))
    with pytest.raises(CommandRefusedError, match="Compass not healthy"):
        scene.craft.arm()


def test_arming_waits_until_a_cold_vehicle_is_ready():
    scene = aboard("ardupilot", warm=False)
    scene.craft.set_mode("guided")
    scene.craft.arm(patience_s=90.0)
    assert scene.vehicle.autopilot.armed


def test_an_answer_to_arming_that_comes_late_is_not_taken_for_one_to_disarming(scene):
    scene.craft.set_mode("guided")
    scene.craft.arm(patience_s=60.0)
    lost, late = [], FrameWriter(1, 1).frame("COMMAND_ACK", {"command": 400, "result": 0})

    def spoil(number, message, frame, up):
        if up and not lost and message.name == "COMMAND_LONG" and message["command"] == 400:
            lost.append(frame)
            scene.link.inner.inbox.append(late)
            return b""
        return frame

    scene.link.spoil = spoil
    scene.craft.disarm()
    assert lost
    assert not scene.vehicle.autopilot.armed


def test_ardupilot_must_count_our_heartbeat():
    scene = aboard("ardupilot", parameters=(("SYSID_MYGCS", 250.0),))
    with pytest.raises(CommandRefusedError, match=r"SYSID_MYGCS.*--gcs-system 250"):
        scene.craft.arm()


def test_another_station_with_our_id_is_noticed_and_refused(scene):
    """The simulated vehicle routes nothing, so the other's heartbeat comes down the wire as a router would send it."""
    other = FrameWriter(255, 77).frame("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
    scene.link.inner.inbox.append(other)
    with pytest.raises(StationConflictError, match=r"system id 255 .*--gcs-system"):
        scene.craft.arm()


def test_our_own_words_that_a_router_sends_back_are_no_other_station(scene):
    sent = []
    scene.link.spoil = lambda _n, m, frame, up: (sent.append(frame) if up and m.name == "HEARTBEAT" else None) or frame
    scene.connection.run_for(3.0)
    scene.link.inner.inbox.extend(sent)
    scene.connection.run_for(1.0)
    assert scene.connection.conflict is None


def test_parameters_are_read_set_and_read_back(scene):
    craft = scene.craft
    name, value = ("COM_DLL_EXCEPT", 3.0) if scene.family == "px4" else ("FS_OPTIONS", 11.0)
    assert craft.set_parameter(name, value).value == value
    assert scene.vehicle.autopilot.parameters[name] == value
    with pytest.raises(ParameterAbsentError, match="has no parameter NO_SUCH"):
        craft.parameter("NO_SUCH")
    with pytest.raises(InputError, match="is not a parameter name"):
        craft.parameter("X" * 17)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_all_parameters_come_though_the_radio_is_bad(family, loss):
    scene = aboard(family, impairment=bad_radio(loss))
    found = scene.craft.parameters()
    store = scene.vehicle.autopilot.parameters
    assert len(found) == len(store)
    assert all(store[name] == pytest.approx(value.value) for name, value in found.items())


@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_without_fences_says_so_and_keeps_its_mission(family):
    asked, its = [], FrameWriter(1, 1)
    refused = {"target_system": 255, "target_component": 190, "type": 3, "mission_type": 1}

    def spoil(number, message, frame, up):
        name = "" if message is None else message.name
        if up and name.startswith("MISSION_") and message.fields.get("mission_type") == 1:
            if name != "MISSION_ACK":
                asked.append(name)
            return b""
        answers = b"" if up else b"".join(its.frame("MISSION_ACK", refused) for _ in asked)
        asked[:] = asked if up else []
        return frame + answers

    scene = aboard(family, spoil=spoil)
    assert scene.craft.upload(a_mission(5)).verified
    begun_s = scene.connection.clock.now_s()
    with pytest.raises(ListUnsupportedError, match="does not support lists of this kind"):
        scene.craft.download(MissionKind.FENCE)
    assert scene.connection.clock.now_s() < begun_s + 4.0
    outcome = scene.craft.upload(a_fence())
    assert (outcome.state, outcome.blocks_start) == (UploadState.REFUSED, False)
    assert str(outcome).startswith("fence: refused; the vehicle holds what it held before: nothing was sent")
    scene.craft.clear(MissionKind.FENCE)
    assert len(scene.craft.download(MissionKind.MISSION)) == 5


def as_number(value):
    return float(struct.unpack("<i", struct.pack("<f", value))[0])


def as_bytes(value):
    return struct.unpack("<f", struct.pack("<i", round(value)))[0]


@pytest.mark.parametrize("name", ["COM_DLL_EXCEPT", "RTL_TYPE"])
def test_an_adapter_that_resembles_px4_says_itself_how_its_whole_parameters_travel(name):
    def spoil(number, message, frame, up):
        if message is None:
            return frame
        if not up and message.name == "HEARTBEAT":
            return changed_frame(message, autopilot=0)
        if not up and message.name == "AUTOPILOT_VERSION":
            return changed_frame(message, capabilities=message["capabilities"] & ~16 | 131072)
        if message.name in ("PARAM_VALUE", "PARAM_SET") and message["param_type"] == 6:
            turned = as_bytes if up else as_number
            return changed_frame(message, param_value=turned(message["param_value"]))
        return frame

    scene = Scene("px4", spoil=spoil)
    craft = Vehicle(scene.connection, autopilot="px4")
    before = scene.vehicle.autopilot.parameters[name]
    assert craft.parameter(name).value == before
    assert craft.set_parameter(name, before + 1.0).value == before + 1.0
    assert scene.vehicle.autopilot.parameters[name] == before + 1.0
    assert craft.parameters()[name].value == before + 1.0


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_vehicle_that_ignores_the_kind_of_a_list_keeps_its_mission(family, loss):
    """As stacks from before the field `mission_type`: they answer each request with the mission, and clear it."""

    def spoil(number, message, frame, up):
        kindless = message is None or not up or not message.fields.get("mission_type")
        return frame if kindless else changed_frame(message, mission_type=0)

    scene = aboard(family, spoil=spoil, impairment=bad_radio(loss))
    assert scene.craft.upload(a_mission(5)).verified
    with pytest.raises(ListUnsupportedError, match=r"it answers with its mission, and does not know .* \(fence\)"):
        scene.craft.download(MissionKind.FENCE)
    assert scene.craft.upload(a_fence()).state is UploadState.REFUSED
    scene.craft.clear(MissionKind.RALLY)
    assert len(scene.craft.download(MissionKind.MISSION)) == 5


def test_a_list_that_the_vehicle_aborts_is_not_said_to_be_unanswered():
    def spoil(number, message, frame, up):
        aborts = not up and message is not None and message.name == "MISSION_COUNT"
        refusal = {"target_system": 255, "target_component": 190, "type": 4, "mission_type": 0}
        return FrameWriter(1, 1).frame("MISSION_ACK", refusal) if aborts else frame

    scene = aboard("px4", spoil=spoil)
    with pytest.raises(LinkError, match=r"mission could not be read: it aborted the transfer: not enough memory"):
        scene.craft.download(MissionKind.MISSION)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_value_that_is_told_again_and_again_does_not_hold_up_the_list(family):
    """It is no member of the list: told whenever it changes, or asked for by another station."""
    lost, alone = [], FrameWriter(1, 1)

    def spoil(number, message, frame, up):
        if message is None or up or message.name not in ("PARAM_VALUE", "HEARTBEAT", "ATTITUDE"):
            return frame
        if message.name == "PARAM_VALUE":
            if message["param_index"] % 3 == 1 and message["param_index"] not in lost:
                lost.append(message["param_index"])
                return b""
            return frame
        told = {
            "param_id": "STAT_RUNTIME",
            "param_value": 1.0,
            "param_type": 9,
            "param_count": 90,
            "param_index": 65535,
        }
        return frame + alone.frame("PARAM_VALUE", told)

    scene = aboard(family, spoil=spoil)
    begun_s = scene.connection.clock.now_s()
    assert len(scene.craft.parameters()) == len(scene.vehicle.autopilot.parameters)
    assert lost
    assert scene.connection.clock.now_s() < begun_s + 60.0


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("appears", [True, False])
def test_a_list_that_is_renumbered_while_it_is_read_is_read_again(family, appears):
    """A parameter that switches others on was set: the sixth of the list appears, or vanishes, after the twentieth came."""
    came, its, place = [], FrameWriter(1, 1), 5

    def spoil(number, message, frame, up):
        if message is None or up or message.name != "PARAM_VALUE":
            return frame
        came.append(message["param_index"])
        if appears == (len(came) > 20):
            return frame
        index = message["param_index"]
        if index == place:
            return b""
        fewer = {"param_count": message["param_count"] - 1, "param_index": index - (index > place)}
        return its.frame("PARAM_VALUE", message.fields | fewer)

    scene = aboard(family, spoil=spoil)
    names = [one.name for one in scene.vehicle.autopilot.parameters]
    wanted = set(names) if appears else set(names) - {names[place]}
    assert set(scene.craft.parameters()) == wanted


def test_a_list_that_never_comes_whole_is_given_up():
    def spoil(number, message, frame, up):
        return b"" if message is not None and message.name == "PARAM_VALUE" and message["param_index"] == 3 else frame

    scene = aboard("px4", spoil=spoil)
    begun_s = scene.connection.clock.now_s()
    with pytest.raises(VehicleTimeoutError, match=r"all parameters: \d+ of \d+ came"):
        scene.craft.parameters()
    assert scene.connection.clock.now_s() < begun_s + 30.0


@pytest.mark.parametrize("family", FAMILIES)
def test_a_parameter_is_set_though_late_answers_still_tell_its_old_value(family):
    name = "MPC_XY_CRUISE" if family == "px4" else "WPNAV_SPEED"
    for seed in range(12):
        scene = aboard(family, impairment=bad_radio(0.2), seed=seed)
        for value in (4.0, 9.0, 5.0, 8.0):
            assert scene.craft.set_parameter(name, value).value == value


@pytest.mark.parametrize("family", FAMILIES)
def test_no_parameter_is_taken_for_absent_because_its_answers_were_lost(family):
    wanted = family_named(family).parameters(FlightNeeds(12.0, 3.0, 2.0, 60.0, fenced=True))
    for seed in range(25):
        scene = aboard(family, impairment=bad_radio(0.3), seed=seed)
        assert not [
            check for check in scene.craft.check_required(wanted) if check.absent and check.wanted.value is not None
        ]


def test_required_parameters_are_checked_and_what_to_set_is_said(scene):
    needs = FlightNeeds(12.0, 3.0, 2.0, 60.0, fenced=True)
    checks = scene.craft.check_required(family_named(scene.family).parameters(needs))
    assert any(not check.ok for check in checks)
    for check in checks:
        if check.to_set is not None:
            scene.craft.set_parameter(check.wanted.name, check.to_set)
    again = scene.craft.check_required(family_named(scene.family).parameters(needs))
    assert all(check.ok for check in again if check.actual is not None)


def test_what_is_uploaded_is_downloaded_verified_and_cleared(scene):
    craft, mission = scene.craft, a_mission(12)
    craft.upload(mission)
    assert craft.verify(mission) == ()
    assert craft.verify(a_mission(12, height=77.0))
    down = craft.download(MissionKind.MISSION)
    assert isinstance(down, Mission)
    assert len(down) == 12
    craft.clear(MissionKind.MISSION)
    assert len(craft.download(MissionKind.MISSION)) == 0
    assert scene.stored() == []


def test_a_mission_that_is_flown_is_not_cleared_by_ardupilot():
    scene = aboard("ardupilot")
    scene.craft.upload(a_mission(4))
    scene.craft.start(patience_s=60.0)
    scene.connection.run_for(5.0)
    with pytest.raises(CommandRefusedError, match="clear its mission"):
        scene.craft.clear(MissionKind.MISSION)


def test_the_battery_counter_is_reset_where_there_is_one():
    scene = aboard("ardupilot", soc=0.5)
    scene.connection.run_for(3.0)
    assert scene.craft.live.latest("soc") == pytest.approx(0.5, abs=0.02)
    assert scene.craft.reset_battery(1.0) == pytest.approx(1.0, abs=0.011)
    assert scene.vehicle.counted_mah < 1.0
    with pytest.raises(CommandRefusedError, match="does not support this command"):
        aboard("px4").craft.reset_battery(1.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_package_is_released(family):
    enabled = {"px4": "PD_GRIPPER_EN", "ardupilot": "GRIP_ENABLE"}[family]
    scene = aboard(family, payload_kg=1.0, parameters=((enabled, 1.0),))
    scene.craft.release()
    assert scene.vehicle.body.payload_kg == 0.0


def test_telemetry_comes_at_the_rates_asked_for_with_times_in_utc(scene):
    assert scene.craft.request_telemetry() == ()
    rates = rates_hz(scene.craft, 10.0)
    assert rates["ATTITUDE"] == pytest.approx(10.0, rel=0.1)
    assert rates["GLOBAL_POSITION_INT"] == pytest.approx(5.0, rel=0.1)
    list(scene.craft.samples(0.05))
    found = list(scene.craft.samples(5.0))
    assert len(found) >= 45
    assert all(b.time_s > a.time_s for a, b in pairwise(found))
    last = found[-1]
    assert last.time_s == pytest.approx(scene.lockstep.clock.posix_s(), abs=0.2)
    assert last.lat_deg == pytest.approx(LAT, abs=1e-6)
    assert last.armed == 0.0
    assert last.landed == 1.0
    assert last.soc == pytest.approx(1.0, abs=0.02)
    assert last.power_w == pytest.approx(last.voltage_v * last.current_a)
    assert last.power_w > 0.0
    assert math.isnan(last.airspeed_mps)
    assert math.isnan(last.wind_north_mps)
    assert scene.craft.live.clock.base.absolute


@pytest.mark.parametrize(
    ("kind", "said"), [("soc-unknown", "unknown to the drone"), ("soc-jump", "jumped"), ("battery-drop", "jumped")]
)
def test_a_doubtful_state_of_charge_is_flagged(kind, said):
    scene = aboard("px4", faults=(Fault(kind, 20.0, value=0.5),))
    scene.connection.run_for(25.0)
    assert said in scene.craft.live.doubts["soc"]
    if kind == "soc-unknown":
        assert math.isnan(scene.craft.live.sample.soc)


def test_a_reboot_begins_a_new_time_base(scene):
    scene.craft.request_telemetry()
    scene.connection.run_for(5.0)
    scene.vehicle.reboot_soon()
    scene.connection.run_for(8.0)
    scene.craft.request_telemetry()
    list(scene.craft.samples(0.05))
    found = list(scene.craft.samples(3.0))
    assert scene.craft.live.clock.reboots == 1
    assert found[-1].time_s == pytest.approx(scene.lockstep.clock.posix_s(), abs=0.3)


def test_nobody_there_is_a_time_out():
    scene = Scene("px4", spoil=lambda _n, _m, _frame, _up: b"")
    with pytest.raises(VehicleTimeoutError, match="no heartbeat"):
        Vehicle(Connection(scene.link, scene.lockstep.clock))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"type": 6, "autopilot": 8}, "no heartbeat of an autopilot, only of ground station 1$"),
        ({"autopilot": 8}, r"no heartbeat of an autopilot, only of system 1 component 1 \(type 2, autopilot 8\)$"),
    ],
)
def test_who_beats_instead_of_a_vehicle_is_told(changed, told):
    def spoil(number, message, frame, up):
        beats = not up and message is not None and message.name == "HEARTBEAT"
        return changed_frame(message, **changed) if beats else frame

    with pytest.raises(VehicleTimeoutError, match=told):
        Vehicle(Scene("px4", spoil=spoil).connection)


def test_a_vehicle_that_does_not_sign_and_one_with_our_id_are_named():
    with pytest.raises(InputError, match=r"does not sign its packets: \d+ were rejected; connect without a key"):
        Vehicle(Scene("px4", signing=Signing(bytes(32))).connection)
    with pytest.raises(InputError, match=r"has this system id itself .*another one, such as 254"):
        Vehicle(Scene("px4", system=255).connection)


def test_commands_get_through_a_bad_radio():
    for seed in range(1, 6):
        scene = aboard("px4", impairment=bad_radio(0.3), seed=seed)
        scene.craft.set_mode("hold")
        scene.craft.arm(patience_s=20.0)
        assert scene.vehicle.autopilot.armed


def told(craft):
    return {(change.what, change.after, change.ours) for change in craft.changes()}


def test_changes_tell_our_orders_from_those_of_others(scene):
    craft = scene.craft
    craft.upload(a_mission(4, height=30.0))
    scene.connection.run_for(3.0)
    assert {(change.what, change.ours) for change in craft.changes()} == {("mission", True)}
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 25.0, 120.0)
    assert {("armed", "armed", True), ("mode", "mission", True)} <= told(craft)
    assert craft.mission_state == "active"
    scene.vehicle.autopilot.request_mode(Mode.RTL, "the pilot")
    scene.connection.run_for(3.0)
    assert told(craft) == {("mode", "return", False)}
    craft.land()
    scene.connection.wait(lambda: not craft.armed, 120.0)
    assert {("mode", "land", True), ("armed", "disarmed", False)} <= told(craft)


def test_an_upload_by_another_station_is_noticed(scene):
    scene.connection.run_for(3.0)
    other = Vehicle(Connection(scene.lockstep.connect(scene.vehicle), scene.lockstep.clock, system=254))
    assert other.upload(a_mission(5)).verified
    scene.connection.run_for(3.0)
    found = scene.craft.changes()
    assert {(change.what, change.ours) for change in found} == {("mission", False)}
    assert "5 items" in found[-1].after
    assert str(found[-1]).endswith("(not commanded by this program)")


def test_an_upload_by_another_is_noticed_by_ardupilots_words_where_it_tells_no_ids():
    def without_ids(_number, message, frame, up):
        if message is None or message.name != "MISSION_CURRENT" or up:
            return frame
        return FrameWriter(message.system, message.component).frame("MISSION_CURRENT", message.fields)

    scene = aboard("ardupilot", spoil=without_ids)
    assert scene.craft.upload(a_mission(5)).verified
    scene.connection.run_for(3.0)
    assert all(change.ours for change in scene.craft.changes())
    scene.connection.run_for(5.0)
    other = Vehicle(Connection(scene.lockstep.connect(scene.vehicle), scene.lockstep.clock, system=254))
    assert other.upload(a_mission(5, height=70.0)).verified
    scene.connection.run_for(3.0)
    assert ("mission", "accepted, as it reports", False) in told(scene.craft)


def test_a_restart_is_a_change_too(scene):
    scene.connection.run_for(5.0)
    scene.vehicle.reboot_soon()
    scene.connection.run_for(8.0)
    scene.craft.request_telemetry()
    scene.connection.run_for(2.0)
    assert ("boot", "restarted", False) in told(scene.craft)
    assert scene.craft.reboots == 1


def test_home_is_asked_for_and_moves_when_it_arms(scene):
    home = scene.craft.home()
    assert (home.lat_deg, home.lon_deg) == pytest.approx((LAT, LON), abs=1e-6)
    assert home.alt_msl_m == pytest.approx(5.0, abs=0.5)


def test_reasons_are_told_however_much_was_said_before():
    scene = aboard("px4", faults=(Fault("prearm"),))
    scene.craft.peer.texts.extend([(6, "blah")] * 200)
    scene.craft.peer.said += 200
    with pytest.raises(CommandRefusedError, match="Compass not healthy"):
        scene.craft.arm()


def test_a_long_text_in_chunks_is_one_text(scene):
    words = "a text of more than fifty letters, which MAVLink 2 sends in several chunks, one by one, numbered"
    said = scene.craft.peer.said
    scene.vehicle.radio.say(6, words)
    scene.connection.run_for(1.0)
    assert scene.craft.peer.texts_since(said) == [words]


@pytest.mark.parametrize(("low", "high", "fine"), [(250, 0, False), (250, 255, True), (255, 0, True), (255, 250, True)])
def test_newer_ardupilots_count_the_heartbeats_of_a_range_of_systems(low, high, fine):
    """The simulated one is 4.6: its parameters are renamed on the wire."""
    scene = aboard("ardupilot")
    newer, writer = {"MAV_GCS_SYSID": low, "MAV_GCS_SYSID_HI": high}, FrameWriter(1, 1)

    def spoil(number, message, frame, up):
        if not (up and message.name == "PARAM_REQUEST_READ"):
            return frame
        if message["param_id"] in newer:
            value = {"param_id": message["param_id"], "param_value": newer[message["param_id"]], "param_type": 2}
            scene.link.inner.inbox.append(writer.frame("PARAM_VALUE", value))
        return b""

    scene.link.spoil = spoil
    if fine:
        scene.craft.check_ground_station()
    else:
        with pytest.raises(CommandRefusedError, match=r"MAV_GCS_SYSID.*--gcs-system 250"):
            scene.craft.check_ground_station()


def test_a_vehicle_with_our_own_id_is_named():
    scene = Scene("px4", system=255)
    with pytest.raises(InputError, match=r"--gcs-system.*system id itself"):
        Vehicle(scene.connection)


def test_once_another_station_is_heard_nothing_more_is_said_to_the_vehicle(scene):
    other = FrameWriter(255, 77).frame("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
    scene.link.inner.inbox.append(other)
    scene.connection.run_for(0.5)
    said = []
    scene.link.spoil = lambda _n, m, frame, up: (said.append(m.name) if up else None) or frame
    for order in (scene.craft.disarm, scene.craft.land, lambda: scene.craft.parameter("X"), scene.craft.home):
        with pytest.raises(StationConflictError):
            order()
    assert set(said) <= {"HEARTBEAT"}


def test_with_no_vehicle_named_it_is_made_sure_that_there_is_only_one(monkeypatch):
    """The second one's first heartbeat comes a second after the first one's."""
    monkeypatch.setattr("skyway.link.telemetry.vehicle_monitor.ALONE_S", 1.5)
    scene = Scene("px4")
    other = FrameWriter(7, 1).frame("HEARTBEAT", {"type": 2, "autopilot": 12, "mavlink_version": 3})
    beats = []

    def spoil(number, message, frame, up):
        beats.extend([frame] if message.name == "HEARTBEAT" and not up else [])
        return frame + other if frame in beats[1:] else frame

    scene.link.spoil = spoil
    with pytest.raises(InputError, match="one of 1, 7"):
        Vehicle(scene.connection)
    assert Vehicle(scene.connection, 7).family.name == "px4"


@pytest.mark.parametrize("family", FAMILIES)
def test_a_peer_of_version_1_is_commanded_and_read_in_version_1(family):
    version_1 = (("SERIAL0_PROTOCOL", 1.0),) if family == "ardupilot" else (("MAV_PROTO_VER", 1.0),)
    sent = set()

    def spoil(number, message, frame, up):
        if up and message.name != "HEARTBEAT":
            sent.add(frame[0])
        return frame

    scene = aboard(family, parameters=version_1, spoil=spoil)
    craft = scene.craft
    assert craft.peer.version == 1
    sent.clear()
    assert craft.identify().version
    name = "MPC_XY_CRUISE" if family == "px4" else "WPNAV_SPEED"
    assert craft.set_parameter(name, 7.0).value == 7.0
    assert craft.upload(a_mission(5)).verified
    craft.start(patience_s=60.0)
    scene.connection.wait(lambda: craft.live.latest("height_m") > 10.0, 60.0)
    craft.go_to(LAT, LON, 20.0)
    craft.land()
    assert scene.connection.wait(lambda: not craft.armed, 200.0)
    assert sent == {0xFE}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_peer_of_version_1_never_takes_a_fence_for_a_mission(family):
    version_1 = (("SERIAL0_PROTOCOL", 1.0),) if family == "ardupilot" else (("MAV_PROTO_VER", 1.0),)
    scene = Scene(family, parameters=version_1)
    craft = Vehicle(scene.connection)
    craft.upload(a_mission(5))
    before = scene.stored()
    for order in (
        lambda: craft.upload(a_fence()),
        lambda: craft.clear(MissionKind.RALLY),
        lambda: craft.verify(a_fence()),
    ):
        with pytest.raises(CommandRefusedError, match="MAVLink 1, which knows missions only"):
            order()
    assert scene.stored() == before


def test_px4_that_waits_to_hear_version_2_gets_to_hear_it():
    """MAV_PROTO_VER 0, as boards have it: MAVLink 1 until the station speaks 2."""
    scene = Scene("px4", parameters=(("MAV_PROTO_VER", 0.0),))
    begun = []
    scene.link.spoil = lambda _n, m, frame, up: b"" if up and not begun else frame
    scene.connection.run_for(3.0)
    assert scene.connection.peers[1].version == 1
    begun.append(True)
    scene.connection.run_for(3.0)
    assert scene.connection.peers[1].version == 2
    assert Vehicle(scene.connection).upload(a_fence()).verified
