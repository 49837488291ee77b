"""Other aircraft: told where they come near, once, and never by what is old, absurd or far."""

import math

import pytest
from wires import FAMILIES, LAT, LON, Scene

from skyway.link.telemetry.traffic import Traffic
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.messages import Message
from skyway.models.drones.telemetry import TelemetrySample
from skyway.sim_stub.faults import parse_fault

HERE = TelemetrySample(time_s=0.0, lat_deg=LAT, lon_deg=LON, alt_msl_m=60.0)


def told(north_m=1000.0, above_m=50.0, **more):
    fields = {
        "ICAO_address": 0xABC123, "lat": round((LAT + north_m / 111_000.0) * 1e7), "lon": round(LON * 1e7),
        "altitude": round((60.0 + above_m) * 1e3), "callsign": "DLH4A   ", "tslc": 1, "flags": 19,
    }  # fmt: skip
    return Message("ADSB_VEHICLE", 1, 1, fields | more)


@pytest.mark.parametrize(
    ("message", "near"),
    [
        (told(), True),
        (told(north_m=3500.0), False),
        (told(above_m=400.0), False),
        (told(above_m=9000.0, flags=17), True),
        (told(tslc=60), False),
        (told(flags=18), False),
        (told(lat=2_000_000_000), False),
    ],
)
def test_what_is_near_is_told_and_nothing_else(message, near):
    traffic = Traffic()
    traffic.hear(message, HERE, 0.0)
    assert [one.name for one in traffic.alerts()] == (["DLH4A"] if near else [])
    assert bool(traffic.near(1.0)) == near


def test_an_aircraft_is_told_once_until_it_has_been_away():
    traffic, said = Traffic(), 0
    for second in range(300):
        if not 100 <= second < 200:
            traffic.hear(told(), HERE, float(second))
        said += len(traffic.alerts())
    assert said == 2
    for number in range(2000):
        traffic.hear(told(ICAO_address=number), None, 400.0)
    assert len(traffic.known) <= 500
    assert not traffic.alerts()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_simulated_aircraft_is_seen_where_it_is(family):
    scene = Scene(family, faults=(parse_fault("aircraft=800@2s+20s"),))
    craft = Vehicle(scene.connection, 1)
    craft.nudge_telemetry()
    scene.connection.run_for(8.0)
    (seen,) = craft.traffic.alerts()
    assert seen.name == "N12345"
    assert math.isclose(seen.away_m, 800.0, rel_tol=0.02)
    assert abs(seen.above_m - 100.0) < 2.0
