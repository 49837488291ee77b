"""How high legs are flown, and the wind that they meet there."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.drones.drone import M200_V2
from skyway.models.flight.heights import cleared_grounds_m, wind_factors
from skyway.models.flight.rules import FlightRules, air_over
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.wind.forecast import constant_wind

GROUND_M = st.floats(-10.0, 2000.0)
RULES = st.builds(
    FlightRules, cruise_height_m=st.floats(20.0, 200.0), wind_profile_exponent=st.floats(0.05, 0.4, allow_nan=False)
)
WIND = constant_wind(6.0, 200.0, datetime(2026, 6, 1, tzinfo=UTC), 3, 40.7, -74.0, 10.0)


def air(rules, *grounds_m):
    stations = tuple(
        Station(f"s{number}", "", 40.70 + 0.05 * number, -74.0, ground) for number, ground in enumerate(grounds_m)
    )
    network = build_network(stations, ConnectionRule(max_length_m=6_000.0))
    return network, air_over(network, WIND, M200_V2, rules)


@given(RULES, GROUND_M, GROUND_M)
def test_the_more_the_ground_falls_the_more_wind_a_leg_meets_by_the_profile(rules, one_m, other_m):
    network, seen = air(rules, one_m, other_m)
    middle_m = max(one_m, other_m) + rules.cruise_height_m - 0.5 * (one_m + other_m)  # above the ground half-way
    share = (middle_m / rules.cruise_height_m) ** rules.wind_profile_exponent
    np.testing.assert_allclose(seen.weight.sum(axis=1), share, rtol=1e-12)
    assert len(network.tail) == 2  # there and back alike


@given(RULES, GROUND_M)
def test_over_level_ground_the_wind_is_that_of_the_cruise_height_to_the_bit(rules, ground_m):
    network, seen = air(rules, ground_m, ground_m, ground_m)
    ensemble = WIND.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    np.testing.assert_array_equal(seen.weight, network.site_weights(ensemble.site_lat, ensemble.site_lon))
    assert set(network.ground_at_m(np.linspace(40.6, 40.9, 7), np.full(7, -73.9)).tolist()) == {ground_m}


def test_where_the_ground_of_an_end_is_not_known_the_way_is_taken_to_be_level():
    _, seen = air(FlightRules(), 300.0, None)
    assert seen.weight.sum(axis=1).tolist() == [1.0, 1.0]
    known, _ = air(FlightRules(), 300.0, None, 100.0)
    assert known.ground_at_m(40.70, -74.0).tolist() == [300.0]
    nothing, _ = air(FlightRules(), None, None)
    assert np.isnan(nothing.ground_at_m(40.70, -74.0)).all()


@given(RULES, st.lists(GROUND_M, min_size=3, max_size=6))
def test_between_higher_neighbours_a_leg_is_as_high_as_they_want(rules, grounds_m):
    ground = np.array(grounds_m)
    cleared = np.array(cleared_grounds_m(grounds_m))
    alone = wind_factors(rules, (ground[:-1], ground[1:]))
    whole = wind_factors(rules, (ground[:-1], ground[1:]), (cleared[:-1], cleared[1:]))
    assert (whole >= alone).all()
    assert (alone >= 1.0).all()
    assert cleared.max() == ground.max()


def test_the_wind_at_a_greater_cruise_height_is_counted_once():
    rules = FlightRules(cruise_height_m=60.0)
    _, low = air(rules, 0.0, 100.0)
    _, high = air(replace(rules, cruise_height_m=110.0), 0.0, 0.0)
    np.testing.assert_allclose(
        low.weight.sum(axis=1) * np.hypot(low.north, low.east).max(), np.hypot(high.north, high.east).max()
    )
