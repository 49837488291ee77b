"""What a vehicle tells: in UTC whatever clock it has, with what is doubtful said to be so."""

import math
import socket
import time
from types import SimpleNamespace

import pytest
from sim_serving import free_port, served
from wires import FAMILIES, Scene, bad_radio, changed_frame, rates_hz

from skyway.link.protocol.opening import open_connection
from skyway.link.telemetry.data_quality import DataQuality
from skyway.link.telemetry.live import LiveTelemetry
from skyway.link.telemetry.rates import RateKeeper
from skyway.link.telemetry.timebase import VehicleClock
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.messages import Message

BEGAN_S = 1_373_464_800.0


def without_satellites(_number, message, frame, up):
    """The vehicle's clock was never set: it stands in 1970."""
    if message is None or message.name != "SYSTEM_TIME" or up:
        return frame
    writer = FrameWriter(message.system, message.component)
    return writer.frame("SYSTEM_TIME", message.fields | {"time_unix_usec": 1_000_000})


def heard(name, **fields):
    return Message(name, 1, 1, fields)


def answer(clock, asked_s, boot_s, took_s=0.04):
    """Ask the vehicle for its time, and hear its answer."""
    asked = clock.question(asked_s)
    assert asked is not None
    clock.hear(heard("TIMESYNC", tc1=int(boot_s * 1e9), ts1=asked), asked_s + took_s)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_does_not_know_the_time_is_tied_to_ours_by_questions(family):
    scene = Scene(family, spoil=without_satellites, impairment=bad_radio(0.2, delay_s=0.3))
    craft = Vehicle(scene.connection)
    craft.request_telemetry()
    scene.connection.run_for(15.0)
    truth = scene.lockstep.clock.posix_s() - scene.vehicle.boot_ms * 1e-3
    base = craft.live.clock.base
    assert "TIMESYNC" in base.source
    assert "within 3" in base.doubts[0]  # of 600 ms there and back, half
    boot_s = craft.live.clock.boot_s
    assert craft.live.clock.hear(heard("HEARTBEAT"), 0.0) - boot_s == pytest.approx(truth, abs=0.02)
    assert truth + boot_s - 1.0 < craft.live.sample.time_s < scene.lockstep.clock.posix_s()


def test_the_vehicles_own_clock_goes_before_ours_and_a_difference_is_told():
    clock = VehicleClock()
    answer(clock, BEGAN_S, 100.0)
    clock.hear(heard("SYSTEM_TIME", time_unix_usec=int((BEGAN_S + 3600.0) * 1e6), time_boot_ms=100_000), BEGAN_S)
    assert clock.hear(heard("ATTITUDE", time_boot_ms=101_000), BEGAN_S) == BEGAN_S + 3601.0
    assert clock.base.doubts == ("the vehicle's clock is +3600 s from this computer's",)


def fast_clock(boot_s, began_wall_s, seconds=4):
    """A vehicle at twenty times our speed whose clock of day is the computer's, as in PX4's simulation."""
    clock = VehicleClock()
    for k in range(20 * seconds):
        wall_s = began_wall_s + k / 20.0
        clock.hear(heard("SYSTEM_TIME", time_unix_usec=int(wall_s * 1e6), time_boot_ms=int(1e3 * (boot_s + k))), wall_s)
    return clock


def test_a_resumed_flight_continues_the_clock_of_its_journal():
    """Resumed after a kill, its times went back by five minutes: landed before the take-off."""
    before = fast_clock(10.0, BEGAN_S)
    last_s = before.hear(heard("ATTITUDE", time_boot_ms=89_000), BEGAN_S)
    again = fast_clock(289.0, BEGAN_S + 14.0)
    assert again.hear(heard("ATTITUDE", time_boot_ms=369_000), BEGAN_S) < last_s + 280.0 - 100.0
    assert again.go_on(before.booted_s, last_s)
    again.hear(heard("SYSTEM_TIME", time_unix_usec=int((BEGAN_S + 18.05) * 1e6), time_boot_ms=370_000), BEGAN_S)
    assert again.hear(heard("ATTITUDE", time_boot_ms=371_000), BEGAN_S) == pytest.approx(last_s + 282.0)


def test_the_clock_of_a_journal_is_not_continued_after_a_restart_nor_beside_a_real_one():
    before = fast_clock(10.0, BEGAN_S)
    last_s = before.hear(heard("ATTITUDE", time_boot_ms=89_000), BEGAN_S)
    assert not fast_clock(2.0, BEGAN_S + 14.0, seconds=1).go_on(before.booted_s, last_s)
    real = VehicleClock()
    for k in range(6):
        real.hear(
            heard("SYSTEM_TIME", time_unix_usec=int((last_s + 100.0 + k) * 1e6), time_boot_ms=1000 * (400 + k)), BEGAN_S
        )
    assert not real.go_on(before.booted_s, last_s)


def test_before_any_answer_times_are_those_of_arrival_and_said_to_be_so():
    clock = VehicleClock()
    assert clock.hear(heard("ATTITUDE", time_boot_ms=5_000), BEGAN_S) == BEGAN_S
    assert clock.base.source == "this computer's clock"
    assert "late by the delay" in clock.base.doubts[0]


def test_the_answer_that_came_back_soonest_is_believed_most():
    clock = VehicleClock()
    for second, took_s in enumerate((0.5, 0.04, 0.9)):
        answer(clock, BEGAN_S + second, 10.0 + second + 0.02, took_s)
    assert clock.hear(heard("ATTITUDE", time_boot_ms=20_000), BEGAN_S + 12.0) == pytest.approx(
        BEGAN_S + 10.0, abs=0.001
    )


@pytest.mark.parametrize("speed", [0.5, 10.0])
def test_a_simulation_that_runs_fast_keeps_its_own_seconds(speed):
    clock = VehicleClock()
    for second in range(8):
        answer(clock, BEGAN_S + second, 10.0 + speed * (second + 0.02))
    first = clock.hear(heard("ATTITUDE", time_boot_ms=90_000), BEGAN_S + 1.0)
    assert clock.hear(heard("ATTITUDE", time_boot_ms=120_000), BEGAN_S + 4.0) - first == 30.0
    assert clock.speed == pytest.approx(speed, rel=0.01)
    assert f"{speed:.1f} times as fast" in clock.base.doubts[1]


@pytest.mark.parametrize(
    ("theirs_s", "ours_ns"),
    [(12.0, 77), (0.0, None), (5_000.0, None)],
    ids=["to another's question", "a question itself", "another zero"],
)
def test_what_is_no_answer_to_us_is_not_believed(theirs_s, ours_ns):
    clock = VehicleClock()
    clock.hear(heard("ATTITUDE", time_boot_ms=10_000), BEGAN_S)
    asked = clock.question(BEGAN_S)
    clock.hear(heard("TIMESYNC", tc1=int(theirs_s * 1e9), ts1=asked if ours_ns is None else ours_ns), BEGAN_S + 0.1)
    assert clock.base.source == "this computer's clock"


def test_after_a_restart_the_time_is_learnt_anew():
    clock = VehicleClock()
    answer(clock, BEGAN_S, 1000.0)
    assert clock.question(BEGAN_S + 0.1) is None
    clock.hear(heard("ATTITUDE", time_boot_ms=500), BEGAN_S + 5.0)
    assert clock.reboots == 1
    answer(clock, BEGAN_S + 5.0, 0.52)
    assert clock.hear(heard("ATTITUDE", time_boot_ms=1_000), BEGAN_S + 9.0) == pytest.approx(BEGAN_S + 5.5, abs=0.01)


@pytest.mark.parametrize("always", [False, True], ids=["once", "always"])
@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_rates_are_measured_and_asked_for_anew_where_the_vehicle_took_them_otherwise(family, loss, always):
    """It sends attitudes at half the rate that it was asked for: the first time, or always."""
    asked = []

    def spoil(_number, message, frame, up):
        if up and message and message.name == "COMMAND_LONG" and message["param1"] == 30.0:
            if always or not checking:
                frame = changed_frame(message, param2=2.0 * message["param2"])
            elif message["param2"] not in asked:
                asked.append(message["param2"])
        return frame

    checking = False
    scene = Scene(family, spoil=spoil, impairment=bad_radio(loss))
    craft = Vehicle(scene.connection)
    craft.request_telemetry({30: 10.0, 33: 5.0})
    checking = True
    scene.connection.run_for(43.0)
    checks = {check.message: check for check in craft.rates.checks}
    assert checks["ATTITUDE"].measured_hz == pytest.approx(5.0, rel=0.3)
    assert checks["ATTITUDE"].corrected_hz == pytest.approx(10.0, rel=0.3)
    assert "requested again" in str(checks["ATTITUDE"])
    assert checks["GLOBAL_POSITION_INT"].corrected_hz is None
    assert all(check.ok for check in checks.values())
    assert rates_hz(craft, 10.0)["ATTITUDE"] == pytest.approx(10.0 * (1.0 - loss), rel=0.3)


@pytest.mark.parametrize("on_s", [0.1, 300.0, 1e6])
def test_a_drone_that_has_been_on_for_long_sends_no_less_for_it(on_s):
    """Its clock is known only after counting has begun: what it ran before is not time in which nothing came."""
    live = SimpleNamespace(clock=SimpleNamespace(boot_s=0.0, reboots=0), loss=0.0)
    keeper = RateKeeper(live)
    keeper.want({30: 10.0}, BEGAN_S)
    asked = {}
    for k in range(110):
        live.clock.boot_s = on_s + 0.1 * k if k > 3 else 0.0
        asked.update(keeper.heard("ATTITUDE", BEGAN_S + 0.1 * k))
    (check,) = keeper.checks
    assert check.measured_hz == pytest.approx(10.0, rel=0.05)
    assert check.ok
    assert not asked


def test_a_rate_that_the_vehicle_does_not_keep_to_is_told_and_asked_for_a_few_times():
    asked = []
    scene = Scene(
        "px4", spoil=lambda _n, m, frame, up: (asked.append(m) if up and m.name == "COMMAND_LONG" else 0) or frame
    )
    craft = Vehicle(scene.connection)
    craft.request_telemetry({30: 400.0})
    scene.connection.run_for(65.0)
    (check,) = craft.rates.checks
    assert not check.ok
    assert "sends less than requested" in str(check)
    assert sum(message["command"] == 511 for message in asked) == 1 + 3 * 2


def test_after_a_restart_telemetry_is_asked_for_again():
    scene = Scene("ardupilot")
    craft = Vehicle(scene.connection)
    craft.request_telemetry({30: 10.0})
    scene.connection.run_for(12.0)
    scene.vehicle.reboot_soon()
    scene.connection.run_for(30.0)
    assert rates_hz(craft, 5.0)["ATTITUDE"] == pytest.approx(10.0, rel=0.1)


def test_items_reached_and_lost_packets_are_in_the_samples():
    scene = Scene("px4", impairment=bad_radio(0.2))
    craft = Vehicle(scene.connection)
    craft.request_telemetry()
    scene.connection.run_for(30.0)
    assert craft.live.sample.link_loss == pytest.approx(0.2, abs=0.12)
    assert math.isnan(craft.live.sample.mission_reached)
    for _ in range(2):
        scene.vehicle.radio.item_reached(3)
        scene.connection.run_for(1.0)
    assert craft.live.sample.mission_reached == 3.0
    assert craft.live.reached == [3]


FLYING = {"armed": 1.0, "landed": 0.0, "vel_north_mps": 8.0, "vel_east_mps": 0.0}
HERE = {"lat_deg": 40.0, "lon_deg": -74.0, "alt_msl_m": 80.0}


def doubts_after(*steps):
    doubts = DataQuality()
    doubts.hear(FLYING, 0.0)
    for time_s, reports in steps:
        doubts.hear(reports, time_s)
    return doubts


@pytest.mark.parametrize(
    ("name", "change"),
    [("position", {"lat_deg": 40.01}), ("position", {"lon_deg": -74.01}), ("height", {"alt_msl_m": 400.0})],
)
def test_a_jump_is_flagged_for_a_minute(name, change):
    doubts = doubts_after((1.0, HERE), (2.0, HERE | change))
    assert set(doubts.words) == {name}
    assert "jumped" in doubts.words[name]
    doubts.hear(HERE | change | {"lat_deg": 40.0101 if "lat_deg" in change else 40.0001}, 70.0)
    assert doubts.words == {}


def test_what_moves_as_a_drone_does_is_not_flagged():
    steps = [
        (t, {"lat_deg": 40.0 + 1e-4 * t, "lon_deg": 179.9999 + 2e-4 * t - 360.0 * (t > 0.5), "alt_msl_m": 80.0 + t})
        for t in range(60)
    ]
    assert doubts_after(*steps).words == {}


@pytest.mark.parametrize(
    ("name", "values"), [("position", HERE), ("attitude", {"roll_rad": 0.01, "pitch_rad": -0.1, "yaw_rad": 1.0})]
)
def test_what_stands_still_in_flight_is_flagged_until_it_moves(name, values):
    doubts = doubts_after(*((t, values) for t in range(8)))
    assert "has not moved for 7 s" in doubts.words[name]
    doubts.hear({quantity: value + 1e-5 for quantity, value in values.items()}, 8.0)
    assert doubts.words == {}
    parked = DataQuality()
    for t in range(20):
        parked.hear({"armed": 0.0, "landed": 1.0, **values}, float(t))
    assert parked.words == {}


def test_a_percentage_that_stays_while_power_is_drawn_is_flagged_until_it_moves():
    drawn = {"voltage_v": 23.0, "current_a": 25.0, "soc": 0.7}
    doubts = doubts_after(*((10.0 * t, drawn) for t in range(25)))
    assert doubts.words["soc"] == "stuck at 70 % while 575 W are drawn"
    doubts.hear(drawn | {"soc": 0.69}, 260.0)
    assert doubts.words == {}


def test_samples_go_on_when_a_clock_far_behind_ours_takes_over():
    """Before the first SYSTEM_TIME samples carry our time; the vehicle's may be years behind (a simulation of 2013)."""
    live = LiveTelemetry(1)
    turn = {"roll": 0.1, "pitch": 0.0, "yaw": 0.0}
    first = live.hear(heard("ATTITUDE", time_boot_ms=1000, **turn), BEGAN_S + 4e8)
    assert first.time_s == BEGAN_S + 4e8
    live.hear(heard("SYSTEM_TIME", time_unix_usec=int(BEGAN_S * 1e6), time_boot_ms=1050), BEGAN_S + 4e8)
    later = [live.hear(heard("ATTITUDE", time_boot_ms=1100 + n, **turn), BEGAN_S + 4e8) for n in (0, 100)]
    assert [sample.time_s for sample in later] == pytest.approx([BEGAN_S + 0.05, BEGAN_S + 0.15])


@pytest.mark.slow
def test_a_simulator_that_runs_eight_times_as_fast_keeps_its_own_seconds_over_sockets():
    port = free_port(socket.SOCK_STREAM)
    with served(tcp_port=port, speedup=8.0) as there:
        connection = open_connection(f"tcp:127.0.0.1:{port}", record=None)
        craft = Vehicle(connection)
        craft.request_telemetry()
        list(craft.samples(0.1))
        before_s, begun_s = there.world.sim_s, time.monotonic()
        found = list(craft.samples(10.0))
        passed_s, truth_s = time.monotonic() - begun_s, there.world.sim_s - before_s
        assert truth_s > 3.0 * passed_s, "too busy a machine to simulate fast"
        assert found[-1].time_s - found[0].time_s == pytest.approx(truth_s, rel=0.1)
        assert found[-1].time_s == pytest.approx(there.world.epoch_s + there.world.sim_s, abs=2.0)
        assert craft.live.clock.speed == pytest.approx(truth_s / passed_s, rel=0.3)
        assert craft.live.clock.base.source == "the vehicle's time since boot, started at its clock (SYSTEM_TIME)"
        (doubt,) = craft.live.clock.base.doubts
        assert "differ in speed (a simulation)" in doubt
        connection.run_for(12.0)
        rates = {check.message: check for check in craft.rates.checks}
        assert rates["ATTITUDE"].ok
        connection.close()
