"""Time, energy and charge of any mission in the wind, checked against figures worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtr

from skyway.missions import FlightConditions, ForecastWind, SteadyWind, check
from skyway.missions.checks.energy import p_within
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.base import geodesy
from skyway.models.base.json_text import plain
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.drones.time_belief import TimeBelief
from skyway.models.network.station import Station
from skyway.models.wind.forecast import WindEnsemble

HOME = Home(Point.of_degrees(47.0, 8.0), 400.0)
NORTH_5_KM = geodesy.direct(47.0, 8.0, 0.0, 5000.0)
DRONE = M200_V2
MEASURED = EnergyBelief(1.0, 0.02, 0.0)


def at(command, place=(47.0, 8.0), z=60.0, **fields):
    point = Point.of_degrees(*place)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=z, **fields)


def speed(mps):
    return MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, mps, -1.0)


def out(mps=10.0):
    return (
        at(Command.NAV_TAKEOFF),
        speed(mps),
        at(Command.NAV_WAYPOINT, NORTH_5_KM),
        at(Command.NAV_LAND, NORTH_5_KM, z=0.0),
    )


def delay(seconds):
    return MissionItem(Command.NAV_DELAY, Frame.MISSION, seconds)


def back(mps=10.0):
    return (
        at(Command.NAV_WAYPOINT, NORTH_5_KM),
        speed(mps),
        at(Command.NAV_WAYPOINT),
        at(Command.NAV_LAND, z=0.0),
    )


def run(*items, belief=MEASURED, **conditions):
    drone = replace(DRONE, energy_belief=belief)
    return check(Mission(items, HOME), conditions=FlightConditions(drone, **conditions))


def codes(report):
    return {finding.code: finding.severity for finding in report.findings}


def test_a_flight_takes_its_climb_its_way_and_its_descent():
    leg = run(*out()).legs[0]
    seconds = 60 / 5 + 5000 / 10 + 60 / 3
    assert leg.distance_m == pytest.approx(5000.0, abs=0.1)
    assert leg.time_s == pytest.approx(seconds, abs=0.1)
    assert leg.energy_j == pytest.approx(552 * seconds, rel=0.01)
    assert leg.soc_end == pytest.approx(1 - leg.energy_j / DRONE.battery_j)


def test_a_package_costs_energy_until_it_is_released():
    light, heavy = run(*out()).legs[0], run(*out(), payload_kg=1.45).legs[0]
    assert heavy.energy_j / light.energy_j == pytest.approx(38 / 24, rel=0.001)
    release = MissionItem(Command.DO_GRIPPER, Frame.MISSION, 1.0, 0.0)
    trip = run(*out(), release, *back(), payload_kg=1.45)
    assert trip.legs[0].energy_j > 1.5 * trip.legs[1].energy_j


def test_ground_speed_is_held_in_any_wind_that_the_airspeed_allows():
    calm, against = run(*out()).legs[0], run(*out(), weather=SteadyWind(8.0, 0.0)).legs[0]
    assert against.time_s == pytest.approx(calm.time_s)
    assert against.least_airspeed_margin_mps == pytest.approx(22.5 - 18.0)


def test_a_ground_speed_that_the_wind_does_not_allow_is_flown_slower():
    report = run(*out(15.0), weather=SteadyWind(10.0, 0.0))
    assert report.legs[0].time_s == pytest.approx(60 / 5 + 5000 / 12.5 + 60 / 3, abs=0.1)
    assert codes(report) == {"speed-not-held": "warning"}
    assert "needs 2.5 m/s more airspeed" in report.findings[0].message
    across = run(*out(20.0), weather=SteadyWind(11.9, 90.0))
    assert across.legs[0].time_s == pytest.approx(60 / 5 + 5000 / math.sqrt(22.5**2 - 11.9**2) + 20, abs=0.1)


def test_a_speed_beyond_the_vehicle_is_blamed_on_the_wind_only_where_it_blows():
    def told(**conditions):
        return next(f.message for f in run(*out(23.0), **conditions).findings if f.code == "speed-not-held")

    assert told().startswith("the commanded ground speed needs 0.5 m/s more")
    assert told(weather=SteadyWind(3.0, 0.0)).startswith("in a wind of 3 m/s the commanded")


def test_wind_above_the_limit_lets_nobody_fly():
    report = run(*out(), weather=SteadyWind(13.0, 90.0))
    assert codes(report) == {"wind-too-strong": "error"}
    leg = plain(report)["legs"][0]
    assert (leg["time_s"], leg["energy_wh"], leg["soc_end"], leg["p_reserve"]) == (None,) * 4


def test_landing_below_the_reserve_is_an_error_and_close_to_it_a_warning():
    # one way: 532 s at 552 W of 1.257 MJ: 23.4 %
    assert codes(run(*out(), soc_start=0.40)) == {"below-reserve": "error"}
    assert codes(run(*out(), soc_start=0.20)) == {"battery-empty": "error"}
    unsure = run(*out(), soc_start=0.437)
    assert codes(unsure) == {"reserve-unsure": "warning"}
    assert 0.4 < unsure.legs[0].p_reserve < 0.9
    assert codes(run(*out(), soc_start=0.46)) == {}


def test_how_surely_the_reserve_is_kept_is_told_by_what_is_believed_of_the_drone():
    start, spent = 0.46, 0.4 - run(*out(), soc_start=0.4).legs[0].soc_end
    for belief in (MEASURED, EnergyBelief(), EnergyBelief(1.1, 0.05, 0.03)):
        kept = run(*out(), soc_start=start, belief=belief).legs[0].p_reserve
        expected = stdtr(15.0, ((start - 0.2) / spent - belief.mean_ratio) / belief.leg_sd)
        assert kept == pytest.approx(expected, abs=2e-4)
    assert codes(run(*out(), soc_start=start, belief=EnergyBelief())) == {"reserve-unsure": "warning"}


def test_a_vehicle_that_nobody_named_is_not_called_an_error():
    mission = Mission(out(0.5), HOME)
    assumed = check(mission)
    assert codes(assumed) == {"battery-empty": "warning"}
    assert "vehicle assumed: DJI Matrice 200 V2" in assumed.findings[0].message


@pytest.mark.parametrize(
    ("stated", "code"),
    [
        ({"payload_kg": 5.0}, "payload"),
        ({"weather": SteadyWind(25.0, 200.0)}, "wind-too-strong"),
        ({"soc_start": 0.4}, "below-reserve"),
    ],
)
def test_what_follows_from_a_stated_package_wind_or_charge_is_an_error_of_an_assumed_vehicle_too(stated, code):
    report = check(Mission(out(), HOME), conditions=FlightConditions(DRONE, drone_is_assumed=True, **stated))
    assert not report.ok
    [finding] = [one for one in report.findings if one.code == code]
    assert finding.severity == "error"
    assert finding.message.endswith("(vehicle assumed: DJI Matrice 200 V2)")
    too_fast = check(Mission(out(25.0), HOME), conditions=FlightConditions(DRONE, drone_is_assumed=True, **stated))
    assert codes(too_fast)["speed-limit"] == "warning", "it follows from the vehicle alone"


def test_a_flight_after_one_that_does_not_arrive_is_not_judged():
    for first in (out(0.5), out()):
        weather = SteadyWind() if first == out(0.5) else SteadyWind(13.0, 90.0)
        report = run(*first, delay(600.0), *back(0.5), weather=weather)
        assert report.legs[1].soc_end is None
        assert [one.code for one in report.findings if one.code == "battery-empty"] == (
            ["battery-empty"] if first == out(0.5) else []
        )
    until_charged = MissionItem(Command.COMPONENT_ARM_DISARM, Frame.MISSION, 0.0)
    assert run(*out(0.5), until_charged, *back()).legs[1].soc_end > 0.7


def test_a_package_too_heavy_is_an_error():
    assert codes(run(*out(), payload_kg=3.0))["payload"] == "error"


def test_a_hold_on_the_ground_charges_along_the_curve():
    report = run(*out(), delay(1800.0), *back(), soc_start=0.5)
    first, second = report.legs
    curve = DRONE.charging_curve()
    assert second.soc_start == pytest.approx(float(curve.soc(curve.time_from_empty_s(first.soc_end) + 1800.0)))
    assert report.ok


def test_a_hold_too_short_for_the_next_flight_says_how_long_would_do():
    report = run(*out(), delay(60.0), *back(), soc_start=0.46)
    assert codes(report)["hold-too-short"] == "error"
    finding = next(finding for finding in report.findings if finding.code == "hold-too-short")
    seconds = float(finding.remedy.split()[1])
    assert codes(run(*out(), delay(seconds + 300), *back(), soc_start=0.46)) == {}


def test_a_hold_longer_than_charging_takes_is_told():
    assert codes(run(*out(), delay(20_000.0), *back())) == {"hold-longer-than-charge": "info"}


def test_a_disarmed_hold_is_open_and_taken_to_end_charged():
    disarm = MissionItem(Command.COMPONENT_ARM_DISARM, Frame.MISSION, 0.0)
    report = run(*out(), disarm, *back(), soc_start=0.5)
    assert codes(report) == {"hold-open": "info"}
    assert report.legs[1].soc_start == 1.0


def test_a_delivery_stop_without_a_hold_charges_nothing():
    report = run(*out(), *back(), soc_start=0.9)
    assert report.legs[1].soc_start == 0.9  # known last at the start: the error adds up over both flights
    assert report.legs[1].soc_end == pytest.approx(0.9 - 2 * (0.9 - report.legs[0].soc_end), abs=0.002)


def test_charging_needs_a_pad_where_pads_are_known():
    here = Station("a", "Alp", *NORTH_5_KM, pads=2, recharge_power_w=50.0)
    elsewhere = Station("b", "Brig", 46.3, 8.0)
    at_pad = run(*out(), delay(600.0), *back(), stations=(here, elsewhere))
    assert codes(at_pad) == {}
    assert at_pad.legs[1].soc_start - at_pad.legs[0].soc_end == pytest.approx(50 * 600 / DRONE.battery_j)
    assert at_pad.legs[0].pad == "Alp"
    nowhere = run(*out(), delay(600.0), *back(), stations=(elsewhere,))
    assert codes(nowhere) == {"hold-without-pad": "warning"}


def test_hovering_costs_as_much_as_flying():
    waiting = replace(out()[2], param1=100.0)
    longer = run(out()[0], out()[1], waiting, out()[3]).legs[0]
    assert longer.time_s - run(*out()).legs[0].time_s == pytest.approx(100.0)
    aloft = run(*out()[:3], delay(100.0), out()[3]).legs[0]
    assert aloft.energy_j == pytest.approx(longer.energy_j)


def test_a_return_to_launch_goes_home_and_lands():
    leg = run(*out()[:3], MissionItem(Command.NAV_RETURN_TO_LAUNCH)).legs[0]
    assert leg.distance_m == pytest.approx(10_000.0, abs=1)
    assert leg.time_s == pytest.approx(12 + 1000 + 20, abs=0.5)


def test_a_loiter_without_end_has_no_end():
    forever = plain(run(*out()[:3], at(Command.NAV_LOITER_UNLIM, NORTH_5_KM)))["legs"][0]
    assert forever["time_s"] is None
    assert forever["soc_end"] is None


def ensemble(*speeds, slots=2, from_north=True):
    north = np.array([[[-s if from_north else s]] * slots for s in speeds], dtype=float)
    return WindEnsemble(
        np.array([47.0]),
        np.array([8.0]),
        0.0,
        3600.0,
        north,
        np.zeros_like(north),
        np.full(len(speeds), 1 / len(speeds)),
        tuple(f"day {i}" for i in range(len(speeds))),
        60.0,
    )


def test_a_forecast_gives_a_probability():
    weather = ForecastWind(ensemble(0.0, 0.0, 0.0, 11.5), 100.0)
    report = run(*out(20.0), soc_start=0.357, weather=weather)
    assert report.legs[0].p_reserve == pytest.approx(0.75, abs=0.001)  # the day against the wind is too slow
    assert codes(report)["reserve-unsure"] == "warning"


def test_what_flies_higher_meets_more_wind():
    wind = ensemble(6.0)
    low, high = (run(*out(20.0), weather=ForecastWind(wind, 100.0, exponent)).legs[0] for exponent in (0.0, 0.2))
    assert low == high  # 60 m above the ground, as high as the forecast is
    half = replace(wind, height_m=30.0)
    higher = run(*out(20.0), weather=ForecastWind(half, 100.0, 0.2)).legs[0]
    assert low.least_airspeed_margin_mps - higher.least_airspeed_margin_mps == pytest.approx(
        6.0 * (2.0**0.2 - 1.0), abs=0.01
    )


def test_days_on_which_the_wind_forbids_flying_are_told_apart():
    report = run(*out(), weather=ForecastWind(ensemble(5.0, 14.0), 100.0))
    assert codes(report) == {"wind-may-forbid": "warning"}
    assert report.legs[0].p_reserve == pytest.approx(1.0)


def test_the_wind_of_the_hour_is_flown_in():
    changing = ensemble(0.0, 0.0)
    north = changing.north.copy()
    north[:, 1, :] = -11.0
    changing = replace(changing, north=north)
    early = run(*out(20.0), weather=ForecastWind(changing, 0.0)).legs[0]
    late = run(*out(20.0), weather=ForecastWind(changing, 3700.0)).legs[0]
    assert early.time_s == pytest.approx(12 + 250 + 20, abs=0.1)
    assert late.time_s == pytest.approx(12 + 5000 / 11.5 + 20, abs=0.1)


@pytest.mark.parametrize("turns_j", [5.0, 40.0])
def test_what_is_not_known_of_manoeuvres_is_in_the_probability_of_the_reserve(turns_j):
    rng = np.random.default_rng(1)
    belief = EnergyBelief(0.99, 0.08, 0.0)
    drawn = TimeBelief().sampled(rng, 400_000, 1).manoeuvres
    spent = 100.0 * belief.sampled(rng, 400_000, 1)[:, 0] + turns_j * (drawn - 1.0)
    for budget_j in (95.0, 115.0, 130.0):
        told = float(p_within(np.array([100.0]), turns_j, budget_j, belief)[0])
        assert told == pytest.approx(float((spent <= budget_j).mean()), abs=0.003)
