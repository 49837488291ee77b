"""Pads: charging by the curve, waiting in line, other drones, and what the service says."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from sim_station import LAT, LON, pads_stage

from skyway.models.network.station import Station as Place
from skyway.models.queues.load import WEEK_H, PadLoad
from skyway.models.queues.pad_service import (
    PadRequest,
    PadServiceError,
    StationStatus,
    decode_answer,
    decode_request,
    encode,
)
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.world import World


def test_a_pad_charges_by_the_curve_and_stops_where_it_was_asked_to():
    stage, pads = pads_stage()
    told = pads.charge("here", "1", 0.9)
    assert told.state == "charging"
    curve = stage.vehicle.airframe.drone.charging_curve()
    assert told.done_s - stage.world.epoch_s == pytest.approx(float(curve.duration_s(0.4, 0.9)))
    stage.lockstep.run_for(1000.0)
    stage.vehicle.tend()
    assert stage.vehicle.battery.soc == pytest.approx(float(curve.soc(curve.time_from_empty_s(0.4) + 1000.0)), abs=1e-3)
    assert stage.vehicle.battery.current_a < 0.0
    stage.lockstep.run_for(5_500.0)
    status = pads.status("here").drones[0]
    assert (status.state, status.soc) == ("done", pytest.approx(0.9, abs=1e-3))


def test_a_weak_pad_charges_slower():
    stage, pads = pads_stage(recharge_power_w=60.0)
    told = pads.charge("here", "1", 0.5)
    seconds = told.done_s - stage.world.epoch_s
    assert seconds == pytest.approx(0.1 * stage.vehicle.battery.capacity_j / 60.0, rel=1e-6)


def test_two_drones_share_one_pad_first_come_first_served():
    stage, pads = pads_stage()
    second = stage.world.add(VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, system=2, soc=0.5, warm=True))
    assert pads.charge("here", "1", 0.5).state == "charging"
    waiting = pads.charge("here", "2", 0.6)
    assert (waiting.state, waiting.place_in_line) == ("waiting", 0)
    assert waiting.pad_free_s == pytest.approx(pads.status("here").drones[0].done_s)
    stage.lockstep.run_for(3000.0)
    assert pads.status("here").drones[1].state == "waiting", "the first one is charged but still on the pad"
    pads.release("here", "1")
    assert pads.status("here").drones[0].state == "charging"
    stage.lockstep.run_for(3000.0)
    assert second.battery.soc == pytest.approx(0.6, abs=1e-3)


def test_arming_takes_a_drone_off_the_pad():
    stage, pads = pads_stage()
    pads.charge("here", "1", 0.9)
    assert stage.station.command(400, 1) == 0
    stage.lockstep.run_for(0.2)
    assert pads.status("here").busy == 0
    assert stage.vehicle.charging is None


def test_what_is_refused_says_what_to_do():
    stage, pads = pads_stage(spots=0)
    stage.world.add(VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, system=2, warm=True))
    stage.world.add(VehicleConfig(lat=LAT + 0.1, lon=LON, ground_m=5.0, system=3, warm=True))
    pads.charge("here", "1", 0.9)
    for drone, to_soc, words in (
        ("2", 0.9, "divert"),
        ("3", 0.9, "land there"),
        ("9", 0.9, "no drone"),
        ("1", 7, "above 0"),
    ):
        with pytest.raises(PadServiceError, match=words):
            pads.charge("here", drone, to_soc)
    with pytest.raises(PadServiceError, match="no station"):
        pads.status("there")


def test_other_drones_come_as_often_and_stay_as_long_as_the_load_says():
    load = PadLoad(rates := np.full((1, WEEK_H), 2.0 / 3600.0), rates * 0 + 1800.0, "UTC")
    busy = []
    for seed in range(20):
        world = World(stations=[Place("here", "here", LAT, LON, 5.0, 5, 1)])
        pads = Pads(world, load, seed=seed)
        for hour in range(100):
            world.advance(hour * 3600.0, 0.0)
            busy.append(pads.status("here").busy)
    assert sum(busy) / len(busy) == pytest.approx(1.0, rel=0.15), "offered load 2/h times half an hour"


def test_lines_at_the_pads_are_as_long_as_erlang_says():
    pads_n, load_erlang = 2, 1.4
    load = PadLoad(rates := np.full((1, WEEK_H), load_erlang / 1800.0), rates * 0 + 1800.0, "UTC")
    waiting, all_busy = [], []
    for seed in range(40):
        world = World(stations=[Place("here", "here", LAT, LON, 5.0, pads_n, 1)])
        pads = Pads(world, load, seed=seed)
        for half_hour in range(400):
            world.advance(half_hour * 1800.0, 0.0)
            status = pads.status("here")
            waiting.append(status.waiting)
            all_busy.append(status.busy == pads_n)
    full = load_erlang**pads_n / math.factorial(pads_n) / (1.0 - load_erlang / pads_n)
    wait_p = full / (sum(load_erlang**k / math.factorial(k) for k in range(pads_n)) + full)
    rho = load_erlang / pads_n
    assert sum(all_busy) / len(all_busy) == pytest.approx(wait_p, rel=0.05)
    assert sum(waiting) / len(waiting) == pytest.approx(wait_p * rho / (1.0 - rho), rel=0.2)


def test_a_drone_waits_behind_the_others_and_knows_for_how_long():
    load = PadLoad(rates := np.full((1, WEEK_H), 1.7 / 3600.0), rates * 0 + 1800.0, "UTC")
    stage, pads = pads_stage(pads=1, spots=500, load=load, seed=6)
    told = pads.charge("here", "1", 0.5)
    assert told.state == "waiting"
    assert told.place_in_line > 0
    at = told.pad_free_s - stage.world.epoch_s
    stage.lockstep.run_until(at - 1.0)
    assert pads.status("here").drones[0].state == "waiting"
    stage.lockstep.run_until(at + 1.0)
    assert pads.status("here").drones[0].state == "charging"


def test_the_wire_form_is_one_json_line_each_and_garbage_is_named():
    request = PadRequest(op="charge", station="here", drone="1", to_soc=0.8)
    line = encode(request)
    assert line.endswith(b"\n")
    assert decode_request(line) == request
    for bad in (b"", b"{}", b"[1]", b'{"op":"fly","station":"x"}', b"\xff\xfe", b'{"op":"status","station":5}'):
        with pytest.raises(PadServiceError, match="not a request"):
            decode_request(bad)
    with pytest.raises(PadServiceError, match="not an answer"):
        decode_answer(b"no")
    assert StationStatus.__struct_fields__[0] == "station"
    assert not math.isnan(request.to_soc)


def test_a_station_that_closes_charges_nobody_until_it_opens():
    """Charged until the closing, kept without power, and charged on when it opens; who comes while it is closed waits."""
    begin = datetime.fromtimestamp(pads_stage()[0].world.epoch_s, UTC)
    closes, opens = begin + timedelta(minutes=31), begin + timedelta(minutes=91)
    hours = f"00:00-{closes:%H:%M},{opens:%H:%M}-24:00"
    if closes.day != begin.day or opens.day != begin.day:
        hours = f"{opens:%H:%M}-{closes:%H:%M}"
    stage, pads = pads_stage(open_hours=hours)
    curve = stage.vehicle.airframe.drone.charging_curve()
    open_s = closes.replace(second=0, microsecond=0).timestamp() - stage.world.epoch_s
    pads.charge("here", "1", 0.95)
    stage.lockstep.run_for(open_s + 600.0)
    told = pads.status("here").drones[0]
    assert told.state == "waiting"
    assert told.pad_free_s == pytest.approx(opens.replace(second=0, microsecond=0).timestamp())
    at_closing = float(curve.soc(curve.time_from_empty_s(0.4) + open_s))
    stage.vehicle.tend()
    assert at_closing - 0.012 < stage.vehicle.battery.soc <= at_closing + 0.002, "it only stands by"
    stage.lockstep.run_for(3600.0 - 601.0)
    stage.vehicle.tend()
    at_opening = stage.vehicle.battery.soc
    stage.lockstep.run_for(901.0)
    stage.vehicle.tend()
    assert pads.status("here").drones[0].state == "charging"
    expected = float(curve.soc(curve.time_from_empty_s(at_opening) + 900.0))
    assert stage.vehicle.battery.soc == pytest.approx(expected, abs=3e-3)
