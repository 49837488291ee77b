"""Weather besides the wind that closes flights: by limits of drone and region, in plans and their audits."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.base.fields import Table
from skyway.models.composition.composition import State
from skyway.models.drones.weather_limits import WeatherLimits, read_limits
from skyway.models.flight.weather_closures import closed_slots, unchecked_limits, weather_closures
from skyway.models.wind.ensemble import HourlyWeather
from skyway.models.wind.forecast import constant_wind
from skyway.planner.drone_choice import skyline
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from skyway.scenarios import load_scenario

DEPART = datetime(2013, 7, 10, 14, tzinfo=UTC)


@pytest.fixture(scope="module")
def world():
    return load_scenario(None)


def wind(hours=48, **values):
    lat, lon = 40.72, -73.95
    calm = constant_wind(3.0, 270.0, DEPART, hours, lat, lon, 60.0)
    hourly = {
        name: np.array([*given, *[given[-1]] * (hours - len(given))], dtype=float) for name, given in values.items()
    }
    return replace(calm, weather=HourlyWeather(DEPART.timestamp(), 3600.0, hourly))


def with_limits(world, **limits):
    return replace(world, rules=replace(world.rules, limits=WeatherLimits(**limits)))


CASES = [
    ({"gust_mps": 12.0}, {"gust": [10, 13, 16, 11]}, [(1, 3)], "gusts of up to 16 m/s (12 m/s at most)"),
    ({"rain_mm_h": 1.0}, {"rain": [2.5, 0]}, [(0, 1)], "rain of up to 2.5 mm/h (1 mm/h at most)"),
    (
        {"visibility_m": 1500.0},
        {"visibility": [9000, 800, 9000]},
        [(1, 2)],
        "a visibility down to 800 m (1500 m at least)",
    ),
    ({"temperature_min_c": -10.0}, {"coldest": [260.15, 268.15]}, [(0, 1)], "down to -13 °C (-10 °C at least)"),
    ({"temperature_max_c": 40.0}, {"warmest": [300, 315.15, 300]}, [(1, 2)], "up to 42 °C (40 °C at most)"),
    ({"no_icing": True}, {"icing": [0.05, 0.5, 0.05]}, [(1, 2)], "icing (none allowed)"),
]


@pytest.mark.parametrize(("limits", "values", "hours", "why"), CASES)
def test_hours_beyond_a_limit_are_closed_and_say_why(world, limits, values, hours, why):
    region = with_limits(world, **limits)
    drone, forecast = region.drones[0], wind(**values)
    found = weather_closures(forecast, drone, region.rules)
    begin = DEPART.timestamp()
    assert [((one.begin_s - begin) / 3600.0, (one.end_s - begin) / 3600.0) for one in found] == hours
    assert found[0].why == why
    own = replace(drone, limits=WeatherLimits(**limits))
    assert weather_closures(forecast, own, world.rules) == found
    assert np.flatnonzero(closed_slots(forecast, own, world.rules)).tolist() == [
        hour for first, last in hours for hour in range(first, last)
    ]
    assert weather_closures(forecast, drone, world.rules) == ()


def test_a_plan_waits_until_the_weather_opens_and_says_so(world):
    region = with_limits(world, gust_mps=12.0, rain_mm_h=1.0)
    forecast = wind(gust=[15, 15, 9])
    request = Request(state=State(DEPART, "bellevue", None, 1.0), destination="jacobi", payload_kg=0.8)
    open_, shut = (
        plan(world, request, forecast=forecast).composition,
        plan(region, request, forecast=forecast).composition,
    )
    assert open_.services[0].depart == DEPART
    assert shut.services[0].depart >= DEPART + timedelta(hours=2)
    told = " ".join(shut.notes)
    assert "closed from Wed 10:00 to Wed 12:00, because of gusts of up to 15 m/s (12 m/s at most)" in told
    assert "limits that could not be checked, since the forecast lacks the data: rain" in told
    assert unchecked_limits(forecast, region.drones[0], region.rules) == ("rain",)


def test_night_is_from_sunset_to_sunrise(world):
    region = with_limits(world, daylight_only=True)
    found = weather_closures(wind(24), region.drones[0], region.rules)
    begin, end = (datetime.fromtimestamp(found[0][part], UTC) for part in (0, 1))
    for instant, rising in ((begin, False), (end, True)):
        assert abs(instant - sun_event(40.72, -73.95, instant, rising=rising)) < timedelta(minutes=3)


def sun_event(lat, lon, near, *, rising):
    """Sunrise or sunset of the day by J. W. Spencer's series (Search 2 (1971), 172): declination and equation of time."""
    g = 2.0 * np.pi * (near.timetuple().tm_yday - 1 + (near.hour - 12) / 24.0) / 365.0
    declination = (
        0.006918
        - 0.399912 * np.cos(g)
        + 0.070257 * np.sin(g)
        - 0.006758 * np.cos(2 * g)
        + 0.000907 * np.sin(2 * g)
        - 0.002697 * np.cos(3 * g)
        + 0.00148 * np.sin(3 * g)
    )
    late_min = 229.18 * (
        0.000075 + 0.001868 * np.cos(g) - 0.032077 * np.sin(g) - 0.014615 * np.cos(2 * g) - 0.040849 * np.sin(2 * g)
    )
    phi = np.radians(lat)
    angle = np.degrees(
        np.arccos(
            (np.sin(np.radians(-0.833)) - np.sin(phi) * np.sin(declination)) / (np.cos(phi) * np.cos(declination))
        )
    )
    minute = 720.0 - 4.0 * (lon + (angle if rising else -angle)) - late_min
    midnight = near.replace(hour=0, minute=0, second=0, microsecond=0)
    return min(
        (midnight + timedelta(minutes=minute + 1440.0 * day) for day in (-1, 0, 1)), key=lambda one: abs(one - near)
    )


def test_a_drone_that_flies_in_more_weather_is_not_left_out_for_a_faster_one(world):
    best = skyline(world.drones, 0.8)[0]
    weak = replace(best, id="weak", max_payload_kg=best.max_payload_kg - 0.01)
    assert [one.id for one in skyline([best, weak], 0.8)] == [best.id]
    strict = replace(best, limits=WeatherLimits(rain_mm_h=0.0))
    assert [one.id for one in skyline([strict, weak], 0.8)] == [best.id, "weak"]


def test_limits_are_read_from_their_table_and_wrong_ones_are_named():
    faults = []
    found = read_limits(Table({"gust_mps": 14, "daylight_only": True}, "a.toml", "limits", faults))
    assert (found, faults) == (WeatherLimits(gust_mps=14.0, daylight_only=True), [])
    read_limits(Table({"gust_mps": -1, "no_icing": "yes", "rain": 3}, "a.toml", "limits", faults))
    told = str(InputError(faults))
    assert "limits.gust_mps: out of range" in told
    assert "limits.no_icing: is neither true nor false" in told
    assert "limits.rain" in told
