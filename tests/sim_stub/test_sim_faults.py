"""What goes wrong on demand, planned at the start or injected by a test while it flies."""

import math

import pytest
from sim_station import LAT, LON, Stage, item, leg

from skyway import sim_stub
from skyway.models.base.errors import InputError
from skyway.models.network.station import Station as Place
from skyway.sim_stub import Pads, World, parse_fault
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.plant.physics import offset_m

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
HERE = Place("here", "Here", LAT, LON, 5.0, 2, 2)
THERE = Place("there", "There", LAT + 0.1, LON, 5.0, 1, 0)


def test_every_public_name_is_there():
    assert all(getattr(sim_stub, name).__name__ == name for name in sim_stub.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = sim_stub.nonsense


@BOTH
@pytest.mark.parametrize(
    ("word", "mode"),
    [("position", Mode.POSITION), ("land", Mode.LAND), ("return", Mode.RTL), ("hold", Mode.HOLD)],
)
def test_a_pilot_takes_over_in_flight_when_a_test_says_so(autopilot, word, mode):
    stage = Stage(autopilot)
    stage.station.upload(stage.mission(*leg()))
    stage.start()
    stage.station.run(30.0)
    assert stage.pilot.mode == Mode.MISSION
    stage.world.inject(f"pilot={word}")
    stage.station.run(0.2)
    held = Mode.BRAKE if autopilot == "ardupilot" and mode == Mode.HOLD else mode
    assert stage.pilot.mode == held
    assert stage.happened("(the pilot)")


def test_an_injected_fault_counts_its_times_from_now_and_ends():
    stage = Stage("px4")
    stage.station.run(10.0)
    stage.world.inject("link-loss@5s+60s")
    assert [m for m in stage.station.run(4.5) if m.get_type() == "HEARTBEAT"]
    stage.station.run(1.0)
    assert not stage.station.run(59.0)
    assert [m for m in stage.station.run(3.0) if m.get_type() == "HEARTBEAT"]
    with pytest.raises(InputError, match="no such vehicle"):
        stage.world.inject("gust#9")
    with pytest.raises(InputError, match="there are no pads"):
        stage.world.inject("pads-taken")


@BOTH
def test_a_fault_counted_from_the_take_off_waits_for_it_however_long_the_checklist_takes(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("link-loss@T+20s+10s")])
    stage.station.run(100.0)
    stage.station.upload(stage.mission(*leg()))
    assert not stage.happened("fault link-loss")
    stage.start()
    stage.station.run(60.0)
    told = {text: event.sim_s for event in stage.world.events for text in [event.text]}
    assert told["fault link-loss begins"] == pytest.approx(told["in the air"] + 20.0, abs=0.2)
    assert told["fault link-loss ends"] == pytest.approx(told["in the air"] + 30.0, abs=0.2)


def test_a_fault_injected_in_flight_may_count_from_its_take_off_and_stations_take_off_never():
    stage = Stage("px4")
    stage.station.upload(stage.mission(*leg()))
    stage.world.inject("gust@T+10s")
    stage.start()
    stage.station.run(30.0)
    assert stage.happened("fault gust begins")
    stage.world.inject("rc-loss@T+1s")  # long past: now
    stage.station.run(1.0)
    assert stage.happened("fault rc-loss begins")
    with pytest.raises(InputError, match="do not take off"):
        parse_fault("pads-taken@T+60s")


@BOTH
def test_a_weak_battery_flies_shorter_and_ardupilots_count_does_not_see_it(autopilot):
    hovered, told = {}, {}
    for factor in (1.0, 0.9):
        stage = Stage(autopilot, faults=(parse_fault(f"battery-weak={factor}"),), soc=0.5)
        stage.take_off(20.0)
        begun = stage.lockstep.now_s
        stage.station.run(150.0)
        hovered[factor] = (0.5 - stage.vehicle.battery.soc) / (stage.lockstep.now_s - begun)
        told[factor] = stage.pilot.reported_percent()
    assert hovered[0.9] / hovered[1.0] == pytest.approx(1.0 / 0.9, rel=0.01)
    if autopilot == "px4":
        assert told[0.9] < told[1.0], "PX4 goes by the voltage"
    else:
        assert told[0.9] == pytest.approx(told[1.0], abs=1), "ArduPilot counts, and knows nothing of it"


@BOTH
def test_a_short_glitch_is_seen_by_the_receiver_alone_and_a_long_one_is_flown(autopilot):
    stage = Stage(autopilot)
    stage.take_off(20.0)
    lat, lon = stage.vehicle.body.lat, stage.vehicle.body.lon

    def apart():
        return math.hypot(*offset_m(lat, lon, stage.vehicle.body.lat, stage.vehicle.body.lon))

    def fix_off():
        stage.station.send(sim_stub_message(stage, 24))
        raw = stage.station.wait("GPS_RAW_INT")
        return math.hypot(*offset_m(stage.vehicle.body.lat, stage.vehicle.body.lon, raw.lat * 1e-7, raw.lon * 1e-7))

    stage.world.inject("gps-glitch=40+5s")
    stage.station.run(3.0)
    assert fix_off() == pytest.approx(40.0, abs=0.5)
    stage.station.run(20.0)
    assert apart() < 2.0
    assert fix_off() < 0.5
    stage.world.inject("gps-glitch=40+60s")
    stage.station.run(45.0)
    assert apart() == pytest.approx(40.0, abs=2.0), "it has flown where it believed to be pushed from"
    stage.station.run(60.0)
    assert apart() < 2.0, "and comes back after the receiver has"
    if autopilot == "ardupilot":
        assert "GPS Glitch or Compass error" in stage.station.texts
        assert "Glitch cleared" in stage.station.texts


def sim_stub_message(stage, number):
    """REQUEST_MESSAGE."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    return dialect.MAVLink_command_long_message(stage.station.target, 1, 512, 0, number, 0, 0, 0, 0, 0, 0)


@BOTH
def test_a_battery_swap_on_the_pad_is_a_restart_with_a_full_battery(autopilot):
    stage = Stage(autopilot, soc=0.3)
    stage.station.upload(stage.mission(*leg()))
    stage.world.inject("battery-swap")
    stage.station.until(lambda: stage.happened("autopilot restarts"))
    stage.station.run(10.0)
    assert stage.vehicle.battery.soc > 0.99
    assert stage.pilot.reported_percent() >= 99
    assert stage.vehicle.boot_ms < 15_000, "the time base is new"
    assert len(stage.station.download()) == len(stage.mission(*leg())), "the mission is kept"


def test_no_battery_is_swapped_with_the_motors_on():
    stage = Stage("px4")
    stage.take_off(10.0)
    with pytest.raises(InputError, match="on the ground"):
        stage.vehicle.swap_battery()
    stage.world.inject("battery-swap")
    stage.station.run(1.0)
    assert stage.happened("no battery is swapped")
    assert stage.pilot.armed


def test_pads_are_taken_by_others_for_as_long_as_it_says_and_ours_waits():
    stage = Stage("px4", stations=(HERE, THERE), soc=0.5)
    pads = Pads(stage.world)
    stage.world.inject("pads-taken=here@10s+30m")
    stage.lockstep.run_for(5.0)
    assert pads.status("here").busy == 0
    stage.lockstep.run_for(10.0)
    status = pads.status("here")
    assert (status.busy, pads.status("there").busy) == (2, 0)
    assert status.remaining_s == pytest.approx((1795.0, 1795.0))
    assert pads.charge("here", "1", 0.6).state == "waiting"
    stage.lockstep.run_for(1790.0)
    assert pads.charge("here", "1", 0.6).state == "waiting"
    stage.lockstep.run_for(10.0)
    assert pads.charge("here", "1", 0.6).state == "charging"


def test_pads_taken_at_every_station_from_the_start_and_unknown_stations_are_named():
    world = World(stations=(HERE, THERE), faults=(parse_fault("pads-taken@60s"),))
    pads = Pads(world)
    world.advance(61.0, 61.0)
    assert (pads.status("here").busy, pads.status("there").busy) == (2, 1)
    with pytest.raises(InputError, match="no station with pads"):
        world.inject("pads-taken=nowhere")


@BOTH
def test_a_link_lost_for_a_minute_in_a_mission_is_survived_and_found_again(autopilot):
    keep = {"px4": (("NAV_DLL_ACT", 2.0), ("COM_DLL_EXCEPT", 1.0)), "ardupilot": (("FS_OPTIONS", 2.0),)}
    stage = Stage(autopilot, parameters=keep[autopilot])
    stage.station.upload(stage.mission(item(22, z=40.0), item(16, 900.0), item(21, 900.0, z=0.0)))
    stage.start()
    stage.station.run(20.0)
    stage.world.inject("link-loss+60s")
    stage.station.run(62.0)
    assert stage.pilot.mode == Mode.MISSION
    assert stage.station.wait("HEARTBEAT", 3.0) is not None
    stage.rest()
    assert math.hypot(*offset_m(LAT, LON, stage.vehicle.body.lat, stage.vehicle.body.lon)) == pytest.approx(900, abs=5)
