"""The world about the vehicles: wind, ground, time, power, connection strings, faults."""

import json
import math
import random
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_station import LAT, LON, Stage, dialect, item

from skyway.models.base.address import Address
from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import inverse
from skyway.models.network.station import Station as Place
from skyway.models.wind.ensemble import WindEnsemble
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.faults import KINDS, parse_fault
from skyway.sim_stub.fleet import FleetOptions, build_world, serve
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.battery import Battery
from skyway.sim_stub.plant.physics import Body, Demand, offset_m
from skyway.sim_stub.plant.power import PowerModel
from skyway.sim_stub.plant.wind_truth import ConstantWind, Gusts, RecordedWind, parse_constant
from skyway.sim_stub.transports.channel import Channel, Impairment
from skyway.sim_stub.transports.loop import SocketLoop
from skyway.sim_stub.transports.urls import parse_address
from skyway.sim_stub.world import World


@given(st.floats(-70, 70), st.floats(-179.9, 179.9), st.floats(0, 360), st.floats(10, 20_000))
def test_flat_offsets_agree_with_geodesics(lat, lon, bearing, length):
    from skyway.models.base.geodesy import direct

    to_lat, to_lon = direct(lat, lon, bearing, length)
    north, east = offset_m(lat, lon, to_lat, to_lon)
    assert math.hypot(north, east) == pytest.approx(length, rel=2e-4)


def test_a_body_flies_the_distance_that_its_speed_and_time_say():
    body = Body(Airframe(), 40.0, -74.0, 100.0)
    body.grounded = False
    for _ in range(2000):
        body.step(Demand(north_mps=8.0, east_mps=-6.0), 3.0, 1.0, 0.0)
    length, bearing = inverse(40.0, -74.0, body.lat, body.lon)
    assert float(length) == pytest.approx(10.0 * 100.0, rel=0.03)
    assert float(bearing) == pytest.approx(360.0 - math.degrees(math.atan2(6.0, 8.0)), abs=0.5)


def test_a_wind_too_strong_carries_it_away_rather_than_tilting_it_over():
    body = Body(Airframe(), 40.0, -74.0, 100.0)
    body.grounded = False
    for _ in range(1200):
        body.step(Demand(), -35.0, 0.0, 0.0)
    assert body.north_mps < -5.0
    assert math.degrees(math.hypot(body.roll, body.pitch)) < 25.5


def test_power_dips_at_medium_speed_and_rises_beyond():
    frame = Airframe()
    power = PowerModel.of(frame)

    def at(speed):
        drag = frame.drag_n_per_speed(speed, 0.0) * speed
        return power.electrical_w(math.hypot(frame.weight_n, drag), speed, 0.0, drag * speed)

    hover = frame.drone.battery_j / frame.drone.endurance_empty_s
    assert at(0.0) == pytest.approx(hover, rel=1e-6)
    assert at(10.0) < 0.9 * hover
    assert at(22.0) > 1.2 * hover


def test_each_vehicle_has_its_own_power_error_within_5_percent():
    world = World()
    errors = [world.add(VehicleConfig(lat=LAT, lon=LON, system=n)).power.error for n in range(1, 101)]
    assert min(errors) >= 0.95
    assert max(errors) <= 1.05
    assert np.std(errors) > 0.02
    again = World().add(VehicleConfig(lat=LAT, lon=LON, system=7)).power.error
    assert again == errors[6]


def test_the_battery_voltage_follows_charge_and_load():
    battery = Battery.of(Airframe().drone)
    full = battery.voltage_v
    battery.discharge(800.0, 600.0)
    assert battery.soc == pytest.approx(1.0 - 480_000.0 / battery.capacity_j)
    assert battery.voltage_v < full - 0.5
    battery.discharge(1e9, 10.0)
    assert battery.empty
    assert battery.time_to_soc_s(1.0, None) == pytest.approx(Airframe().drone.recharge_full_s)


def test_gusts_have_the_spread_and_memory_they_are_given():
    gusts = Gusts(random.Random(1), intensity=0.2, time_s=8.0)
    north = np.array([gusts.step(10.0, 0.5)[0] for _ in range(40_000)])
    assert north.std() == pytest.approx(2.0, rel=0.05)
    lag = np.corrcoef(north[:-16], north[16:])[0, 1]
    assert lag == pytest.approx(math.exp(-1.0), abs=0.05)


def two_hours():
    return WindEnsemble(
        site_lat=np.array([LAT]),
        site_lon=np.array([LON]),
        start_s=0.0,
        slot_s=3600.0,
        north=np.array([[[2.0], [6.0]]]),
        east=np.array([[[0.0], [-4.0]]]),
        probability=np.ones(1),
        labels=("day",),
        height_m=10.0,
    )


def test_a_recorded_wind_blows_at_its_hour_and_stronger_up_high():
    truth = RecordedWind(two_hours())
    assert truth.at(1800.0, LAT, LON, 10.0) == pytest.approx((2.0, 0.0))
    assert truth.at(3600.0, LAT, LON, 10.0) == pytest.approx((4.0, -2.0)), "half-way between two hours"
    assert truth.at(99_999.0, LAT, LON, 10.0) == pytest.approx((6.0, -4.0)), "the last one holds on"
    assert truth.at(1800.0, LAT, LON, 60.0)[0] == pytest.approx(2.0 * 6.0**0.2)


def test_a_vehicle_in_a_recorded_wind_feels_it():
    stage = Stage("px4", wind=RecordedWind(two_hours()))
    stage.world.epoch_s = 5400.0
    stage.vehicle.gusts.intensity = 0.0
    stage.take_off(58.0)
    assert stage.vehicle.true_wind[0] == pytest.approx(6.0 * 5.8**0.2, rel=0.02)


@pytest.mark.parametrize("text", ["8@270", " 0@0 ", "12.5@359"])
def test_a_constant_wind_is_read_as_people_say_it(text):
    assert isinstance(parse_constant(text), ConstantWind)
    assert parse_constant("2013-07-10") is None
    wind = parse_constant("8@270")
    assert (wind.north_mps, wind.east_mps) == pytest.approx((0.0, 8.0)), "from the west is towards the east"
    with pytest.raises(InputError, match="not a wind"):
        parse_constant("400@10")


def test_the_ground_is_that_of_the_nearest_station_so_a_landing_is_at_its_height():
    places = (Place("low", "low", LAT, LON, 5.0), Place("hill", "hill", LAT + 200 / 111_045.0, LON, 31.0))
    stage = Stage("px4", stations=places)
    stage.station.upload((item(22, z=60.0), item(16, 200, z=60.0), item(21, 200, z=0.0)))
    stage.start()
    stage.rest()
    assert stage.vehicle.body.alt_m == 31.0
    assert stage.vehicle.station() == "hill"


def test_protocol_timers_run_at_wall_time_and_heartbeats_at_simulated_time():
    world = World()
    vehicle = world.add(VehicleConfig(lat=LAT, lon=LON, warm=True))
    frames = []
    port = vehicle.radio.connect(frames.append)
    mav = dialect.MAVLink(None, 255, 190)
    vehicle.receive(port, dialect.MAVLink_mission_count_message(1, 1, 3, 0).pack(mav))
    for step in range(1, 101):  # one second of wall time, twenty of simulated time
        world.advance(step * 0.2, step * 0.01)
    kinds = [frame[7] | frame[8] << 8 for frame in frames]
    assert kinds.count(0) == pytest.approx(20, abs=1), "heartbeats"
    assert kinds.count(51) + kinds.count(40) in (4, 5), "a request every 250 ms of wall time"


@pytest.mark.parametrize(
    ("text", "kind", "host", "port"),
    [
        ("udpout:127.0.0.1:14540", "udpout", "127.0.0.1", 14540),
        ("udpin:0.0.0.0:14550", "udpin", "0.0.0.0", 14550),
        ("tcp:localhost:5760", "tcp", "localhost", 5760),
        ("tcpin://:5760", "tcpin", "127.0.0.1", 5760),
        ("udpout:[::1]:14540", "udpout", "::1", 14540),
    ],
)
def test_connection_strings(text, kind, host, port):
    assert parse_address(text, option="--connect") == Address(kind, host, port)


@pytest.mark.parametrize("text", ["", "udp", "serial:/dev/tty:1", "udpout:x:99999", "udpout:x:", "tcp:1:2:3"])
def test_bad_connection_strings_say_what_would_be_right(text):
    with pytest.raises(InputError, match=r"KIND:HOST:PORT|0 to 65535"):
        parse_address(text, option="--connect")


@given(st.sampled_from(sorted(KINDS)), st.integers(0, 9999), st.integers(1, 9999))
def test_faults_are_read_as_they_are_written(kind, start, length):
    fault = parse_fault(f"{kind}@{start}s+{length}s#3")
    assert (fault.kind, fault.start_s, fault.end_s, fault.system) == (kind, start, start + length, 3)
    assert parse_fault(f"{kind}@2m").start_s == 120.0
    assert parse_fault(kind).start_s == 0.0, "bare: from the beginning"


@pytest.mark.parametrize(
    ("text", "value", "word"),
    [
        ("gust@120s", 8.0, ""),
        ("gust=12.5@120s", 12.5, ""),
        ("battery-sag", 4.0, ""),
        ("battery-weak", 0.9, ""),
        ("gps-glitch=25@1m+15", 25.0, ""),
        ("pilot", 0.0, "position"),
        ("pilot=land@90", 0.0, "land"),
        ("pads-taken=bellevue@10m", 0.0, "bellevue"),
        ("link-loss@60s+20s", 0.0, ""),
        ("gps", 0.0, ""),
    ],
)
def test_a_fault_has_the_value_it_is_given_or_a_sensible_one(text, value, word):
    fault = parse_fault(text)
    assert (fault.value, fault.word) == (value, word)


@pytest.mark.parametrize(
    ("text", "would_be_right"),
    [
        ("", "KIND[=VALUE]"),
        ("storm", "one of gust"),
        ("gust@", "KIND[=VALUE]"),
        ("gust@5x", "KIND[=VALUE]"),
        ("link-loss+-5s", "KIND[=VALUE]"),
        ("gust=x", "a number from 0 to 60"),
        ("gust=nan", "a number from 0 to 60"),
        ("battery-weak=0", "a number from 0.01"),
        ("gps=3", "takes no value"),
        ("pilot=banana", "pilot=MODE with MODE one of position"),
    ],
)
def test_bad_faults_say_what_would_be_right(text, would_be_right):
    with pytest.raises(InputError, match=re.escape(would_be_right)):
        parse_fault(text)


def test_a_channel_loses_delays_doubles_and_reorders_as_it_is_told():
    channel = Channel(Impairment(loss=0.2, delay_s=0.05, jitter_s=0.02, duplicate=0.1, reorder=0.1), random.Random(2))
    for number in range(5000):
        channel.put(number * 0.001, number.to_bytes(2, "big"))
    assert channel.take(0.04) == []
    arrived = [int.from_bytes(p, "big") for p in channel.take(99.0)]
    assert len(set(arrived)) == pytest.approx(4000, rel=0.03)
    assert len(arrived) - len(set(arrived)) == pytest.approx(400, rel=0.2)
    assert arrived != sorted(arrived)
    with pytest.raises(InputError, match="a probability"):
        Impairment(loss=1.5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"vehicles": 0}, "--vehicles"),
        ({"vehicles": 250, "first_system": 10}, "--system"),
        ({"places": ()}, "--at"),
    ],
)
def test_an_impossible_fleet_is_an_input_error(options, words):
    here = Place("here", "here", LAT, LON, 5.0)
    with pytest.raises(InputError, match=words):
        FleetOptions(**{"stations": (here,), "places": (here,), **options})


@pytest.mark.parametrize("config", [{"system": 0}, {"autopilot": "dji"}, {"soc": 2.0}, {"signing_key": b"short"}])
def test_an_impossible_vehicle_is_an_input_error(config):
    with pytest.raises(InputError):
        VehicleConfig(lat=LAT, lon=LON, **config)


def test_speed_ups_have_their_limits_and_a_taken_port_is_named():
    world = World()
    with pytest.raises(InputError, match="in the air"):
        SocketLoop(world, speedup=21.0)
    here = Place("here", "here", LAT, LON, 5.0)
    first = build_world(FleetOptions(stations=(here,), places=(here,)))
    loop, told = serve(first, tcp_port=0)
    port = int(told[0].rsplit(":", 1)[1])
    with pytest.raises(InputError, match="cannot listen"):
        serve(
            build_world(FleetOptions(stations=(here,), places=(here,))), connect=(Address("tcpin", "127.0.0.1", port),)
        )
    with pytest.raises(InputError, match="unknown host"):
        serve(build_world(FleetOptions(stations=(here,), places=(here,))), connect=(Address("udpin", "256.1.1.1", 1),))
    loop.close()


def test_the_command_ends_after_its_time_and_prints_json_lines():
    script = (
        "import typer, sys; from skyway.cli.command_groups import add_command; app = typer.Typer();"
        "add_command(app, 'sim'); app.callback()(lambda: None); app(sys.argv[1:])"
    )
    arguments = [
        "sim",
        "--at",
        "bellevue",
        "--at",
        "city-hall",
        "--vehicles",
        "2",
        "--tcp",
        "0",
        "--json",
        "--duration",
        "8",
    ]
    arguments += ["--speedup", "20", "--wind", "2013-07-10", "--depart", "2013-07-10T14:00-04:00"]
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, timeout=60, check=True
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert {line.get("event") for line in lines} >= {"autopilot is up"}
    assert {line["system"] for line in lines if "system" in line} == {1, 2}


def test_a_vehicle_that_nobody_speaks_with_rests_and_is_what_it_would_be_awake():
    """Charge and faults are those of a vehicle that is looked after each second; what is done to it wakes it."""
    world = World(stations=[Place("here", "Here", LAT, LON, pads=1)], faults=[parse_fault("battery-drop=0.1@2000s#1")])
    alone, watched = (world.add(VehicleConfig(lat=LAT, lon=LON, system=one, warm=True, soc=0.8)) for one in (1, 2))
    watched.radio.connect(lambda _: None)
    looks = []
    alone.tend = lambda tend=alone.tend: (looks.append(world.sim_s), tend())[1]
    for second in range(1, 3601):
        world.advance(float(second), float(second))
    assert len(looks) < 70
    assert alone.sim_s == watched.sim_s == 3600.0
    alone.tend()
    assert alone.battery.soc == pytest.approx(watched.battery.soc - 0.1, abs=1e-9)
    assert math.isfinite(alone.rests_until_s)
    world.inject("battery-drop=0.2#1")
    assert world.next_due_s() <= 3600.0
    world.advance(3601.0, 3601.0)
    assert alone.battery.soc == pytest.approx(watched.battery.soc - 0.3, abs=1e-4)
    heard = []
    alone.radio.connect(heard.append)
    world.advance(3602.0, 3602.0)
    assert len(heard) > 5


def test_coarser_steps_fly_as_far():
    far_m = []
    for step_s in (0.05, 0.1):
        body = Body(Airframe(), LAT, LON, 100.0, grounded=False)
        for _ in range(round(120.0 / step_s)):
            body.step(Demand(north_mps=8.0, east_mps=-6.0), 3.0, 1.0, 0.0, step_s)
        far_m.append(float(inverse(LAT, LON, body.lat, body.lon)[0]))
    assert far_m[0] == pytest.approx(far_m[1], abs=1.0)
    assert far_m[0] == pytest.approx(120.0 * 10.0, rel=0.03)
