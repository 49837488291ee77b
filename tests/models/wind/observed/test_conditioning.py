"""A forecast conditioned on observed winds: against a posterior worked out by brute force, and which observations count."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.history import WindSite
from skyway.models.wind.observed.conditioning import FAR_M, OLDEST_S, conditioned, counted
from skyway.models.wind.observed.reading import ObservedWind

SITES = (WindSite("A", 40.0, -74.0), WindSite("B", 40.1, -74.0))
DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)
DEPART_S = DEPART.timestamp()
RESIDUAL = ResidualModel(sigma_mps=2.5, tau_s=12 * 3600.0, length_m=40_000.0)


def wind(place="A", *, before_s=540.0, north=0.0, east=8.0, sigma=1.2, drone=False, corrected=False):
    site = next((site for site in SITES if site.id == place), WindSite(place, 42.0, -74.0))
    seen = WindObservation(DEPART_S - before_s, site.lat, site.lon, north, east, sigma**2, 10.0)
    return ObservedWind(place, "test", math.hypot(north, east), 270.0, seen, corrected=corrected, drone=drone)


def ensemble(members, hours, *, seed=1, sites=SITES):
    """Members whose winds change from hour to hour, beginning an hour before the departure."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 1.0, (2, members, hours, len(sites)))
    north, east = np.cumsum(steps, axis=2) + rng.normal(0.0, 2.0, (2, members, 1, len(sites)))
    place = np.array([site.lat for site in sites]), np.array([site.lon for site in sites])
    even = np.full(members, 1.0 / members)
    labels = tuple(f"m{number}" for number in range(members))
    return WindEnsemble(*place, DEPART_S - 3600.0, 3600.0, north, east, even, labels, 10.0)


def given_now(base, winds, *, depart=DEPART, hours=6, members=10_000, exponent=0.2, residual=RESIDUAL, analogue=True):
    found, notes = conditioned(
        lambda _begin, _hours: base, winds, depart, hours, exponent=exponent, residual=residual, members=members,
        analogue=analogue,
    )  # fmt: skip
    return found, notes


def test_the_mean_is_that_of_a_posterior_by_brute_force():
    # One site, one component: member m and residual r are unknown, r on a grid; y = m(t0) + r + noise is observed.
    base = ensemble(200, 7, sites=SITES[:1])
    seen = wind(east=2.0, north=-1.0, sigma=2.5)
    found, _ = given_now(base, [seen])
    grid = np.linspace(-12.0, 12.0, 2401)
    density = {}
    for name, values, y in (("north", base.north, -1.0), ("east", base.east, 2.0)):
        miss = y - values[:, 0, 0][:, None] - grid
        density[name] = np.exp(-0.5 * (grid / 2.5) ** 2 - 0.5 * (miss / 2.5) ** 2)  # (members, grid)
    evidence = density["north"].sum(axis=1) * density["east"].sum(axis=1)
    evidence /= evidence.sum()
    assert evidence @ evidence < 1.0 / 30.0  # so many members fit that no weight is flattened
    for name in ("north", "east"):
        expected_r = (density[name] * grid).sum(axis=1) / density[name].sum(axis=1)
        for slot in range(6):
            lead_s = 3600.0 * slot + 1800.0 + 540.0
            truth = evidence @ (getattr(base, name)[:, slot + 1, 0] + math.exp(-lead_s / RESIDUAL.tau_s) * expected_r)
            assert found.probability @ getattr(found, name)[:, slot, 0] == pytest.approx(truth, abs=2e-3)


def test_it_begins_with_the_hour_of_the_departure_and_keeps_the_most_probable():
    base = ensemble(80, 8)
    all_of_them, _ = given_now(base, [wind(), wind("B")])
    few, _ = given_now(base, [wind(), wind("B")], members=25)
    assert (all_of_them.start_s, all_of_them.slots, len(all_of_them), len(few)) == (DEPART_S, 6, 80, 25)
    kept = {label for _, label in sorted(zip(-all_of_them.probability, all_of_them.labels, strict=True))[:25]}
    assert set(few.labels) == kept
    assert few.probability.sum() == pytest.approx(1.0)


def test_without_winds_it_is_the_forecast_itself():
    base = ensemble(5, 4)
    assert given_now(base, [])[0] is base


@settings(max_examples=25)
@given(
    st.floats(-15, 15), st.floats(-15, 15), st.floats(0.0, OLDEST_S), st.floats(0.0, OLDEST_S), st.integers(0, 5),
)  # fmt: skip
def test_a_sharper_look_is_followed_more_and_an_older_one_less_and_order_does_not_count(
    north, east, age, other_age, seed
):
    base = ensemble(40, 8, seed=seed)
    one, other = wind(north=north, east=east, before_s=age), wind("B", north=east, east=north, before_s=other_age)
    forth, back = given_now(base, [one, other])[0], given_now(base, [other, one])[0]
    np.testing.assert_allclose(forth.north, back.north, atol=1e-9)
    np.testing.assert_allclose(forth.probability, back.probability, atol=1e-9)
    blunt = replace(one, observation=replace(one.observation, variance=25.0))

    def moved(seen):  # without the members' own change: how far each was moved
        after = given_now(base, [seen])[0]
        return np.abs(after.north - base.north[:, 1:7])[:, 0, 0]

    assert (moved(blunt) <= moved(one) + 1e-9).all()
    later = np.abs(given_now(base, [one])[0].north - base.north[:, 1:7])[:, :, 0]
    assert (np.diff(later, axis=1) <= 1e-9).all()


def test_height_is_carried_by_the_profile():
    base = ensemble(40, 8)
    high = replace(
        wind(east=8.0 * 6.0**0.2),
        observation=replace(wind().observation, east_mps=8.0 * 6.0**0.2, height_m=60.0, variance=1.44 * 6.0**0.4),
    )
    low, carried = given_now(base, [wind()])[0], given_now(base, [high])[0]
    np.testing.assert_allclose(carried.east, low.east, atol=1e-9)


@pytest.mark.parametrize(("minute", "of_next_hour"), [(0, False), (5, False), (49, False), (50, True), (59, True)])
def test_a_wind_observed_early_in_an_hour_does_not_tell_the_rest_of_it(minute, of_next_hour):
    base = ensemble(400, 9)  # from 17:00
    depart = DEPART + timedelta(minutes=minute)
    seen = wind(before_s=-60.0 * minute, north=1.0, east=3.0)
    found, _ = given_now(base, [seen], depart=depart)

    def spread(slot):
        values = found.east[:, slot, 0]
        return math.sqrt(found.probability @ (values - found.probability @ values) ** 2)

    # members change by 1 m/s a component from hour to hour
    assert spread(0) == pytest.approx(0.5 if of_next_hour else 1.1, abs=0.15)
    assert spread(1) == pytest.approx(1.1 if of_next_hour else 1.5, abs=0.15)
    # a forecast of these hours is compared with the hour itself
    of_day, _ = given_now(base, [seen], depart=depart, analogue=False)
    if of_next_hour:
        np.testing.assert_array_equal(of_day.east, found.east)
    else:
        assert of_day.probability @ of_day.east[:, 0, 0] == pytest.approx(3.0, abs=0.5)
        assert of_day.probability @ (of_day.east[:, 0, 0] - 3.0) ** 2 < 0.5


# Which count


def told(*winds):
    found = counted(winds, SITES, DEPART_S)
    return [one.observation.time_s - DEPART_S for one in found.winds], found.notes


def test_of_each_station_the_newest_counts():
    assert told(wind(before_s=4140.0), wind(), wind("B", before_s=4140.0)) == ([-540.0, -4140.0], ())


def test_every_slot_of_a_drone_counts():
    times, _ = told(wind(drone=True), wind(drone=True, before_s=1140.0))
    assert times == [-540.0, -1140.0]


def test_there_is_no_look_ahead():
    times, (note,) = told(wind(before_s=-540.0), wind(before_s=3060.0))
    assert times == [-3060.0]
    assert note == "the wind observed at A at 2013-07-10T18:09:00Z is after the departure and ignored"


def test_old_winds_are_left_out_where_there_is_no_newer_one():
    assert told(wind(before_s=OLDEST_S + 60.0), wind()) == ([-540.0], ())
    times, (note,) = told(wind(before_s=9 * 3600.0), wind("B"))
    assert times == [-540.0]
    assert note == "the wind observed at A is ignored: 9 h before the departure, the limit is 6 h"


def test_winds_far_from_every_site_are_left_out():
    times, (note,) = told(wind("far"))
    assert (times, FAR_M) == ([], 80_000.0)
    assert note == "the wind observed at far is ignored: 211.0 km from every wind site"
    right = wind()
    here = right.observation
    swapped = replace(right, observation=replace(here, lat_deg=here.lon_deg, lon_deg=here.lat_deg))
    assert told(swapped)[1][0].endswith(" from every wind site; lat and lon look swapped")


def test_contradicting_winds_of_a_station_are_refused_and_a_correction_is_followed():
    with pytest.raises(
        InputError, match=r"A: two winds at 2013-07-10T17:51:00Z contradict each other: 8.0 m/s .* and 3.0 m/s"
    ):
        told(wind(), wind(east=3.0))
    assert told(wind(), wind(east=8.2))[0] == [-540.0]  # rounded in two ways
    assert counted([wind(east=3.0, corrected=True), wind()], SITES, DEPART_S).winds[0].speed_mps == 3.0


def test_a_wind_that_does_not_fit_the_others_is_doubted_and_counts():
    base = ensemble(60, 8)
    assert given_now(base, [wind(), wind("B", east=8.5)])[1] == ()
    _, notes = given_now(base, [wind(), wind("B", east=-30.0)])
    assert [note.split(",")[0] for note in notes if "B" in note] == ["the wind observed at B"]
