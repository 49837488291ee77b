"""What wind is expected: days like this one, whole and for all sites together, and nothing of the future."""

from datetime import UTC, date, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.forecast import (
    WindEnsemble,
    analogue_ensemble,
    constant_wind,
    read_forecast,
    truth_series,
)
from skyway.models.wind.history import WindHistory, WindSite, read_history
from skyway.models.wind.interpolation import idw_weights
from skyway.models.wind.triangle import speed_from

NEW_YORK = (
    WindSite("EWR", 40.6925, -74.1687),
    WindSite("JFK", 40.6398, -73.7789),
    WindSite("LGA", 40.7772, -73.8726),
)
PAIR = (WindSite("a", 40.0, -74.0), WindSite("b", 40.1, -74.0))
EASTERN_SUMMER = timezone(timedelta(hours=-4))
DEPART = datetime(2013, 7, 10, 14, 20, tzinfo=EASTERN_SUMMER)


@pytest.fixture(scope="module")
def nyc(shared_data: Path) -> WindHistory:
    columns = WindColumns(
        time="time_hour",
        site="origin",
        speed="wind_speed",
        from_="wind_dir",
        speed_unit="mph",
        calm="direction-0",
    )
    return read_history(shared_data / "wind" / "nyc_2013_hourly_wind.csv.gz", columns, NEW_YORK, 10.0)


def years(first: date, last: date) -> WindHistory:
    """Hourly record of two sites whose north component counts the hours, and whose east tells the site."""
    begin = datetime(first.year, first.month, first.day, tzinfo=UTC).timestamp()
    hours = ((last - first).days + 1) * 24
    north = np.repeat(np.arange(hours, dtype=float)[:, None], 2, axis=1)
    return WindHistory(PAIR, begin, north, north * 0.0 + [1.0, 2.0], 10.0, "made.csv")


def dates(ensemble: WindEnsemble) -> list[date]:
    return [date.fromisoformat(label) for label in ensemble.labels]


def small(members: int = 5) -> WindEnsemble:
    north = np.arange(members * 4 * 2, dtype=float).reshape(members, 4, 2)
    chance = np.arange(1.0, members + 1.0)
    return WindEnsemble(
        np.array([40.0, 40.1]),
        np.array([-74.0, -74.0]),
        0.0,
        3600.0,
        north,
        -north,
        chance / chance.sum(),
        tuple("abcdefghij"[:members]),
        10.0,
    )


def test_a_july_departure_is_given_the_days_of_that_summer_but_its_own(nyc):
    ensemble = analogue_ensemble(nyc, DEPART, 12)
    chosen = dates(ensemble)
    assert date(2013, 7, 10) not in chosen
    assert min(chosen) == date(2013, 6, 10)
    assert max(chosen) == date(2013, 8, 9)
    assert 55 <= len(ensemble) <= 60
    assert ensemble.north.shape == (len(ensemble), 12, 3)
    assert np.allclose(ensemble.probability, 1.0 / len(ensemble))


def test_slot_0_holds_the_departure(nyc):
    ensemble = analogue_ensemble(nyc, DEPART, 12)
    assert ensemble.start_s == datetime(2013, 7, 10, 18, tzinfo=UTC).timestamp()
    assert ensemble.slot_at(DEPART.timestamp()) == 0


def test_a_member_is_one_day_for_all_sites_together(nyc):
    ensemble = analogue_ensemble(nyc, DEPART, 12)
    for number, day in enumerate(dates(ensemble)):
        begin = datetime(day.year, day.month, day.day, 18, tzinfo=UTC).timestamp()
        first = int((begin - nyc.start_s) // 3600)
        assert np.array_equal(ensemble.north[number], nyc.north[first : first + 12])
        assert np.array_equal(ensemble.east[number], nyc.east[first : first + 12])


def test_a_departure_years_ahead_of_the_record_has_the_same_season(nyc):
    ahead = analogue_ensemble(nyc, DEPART.replace(year=2031), 12)
    assert ahead.start_s == datetime(2031, 7, 10, 18, tzinfo=UTC).timestamp()
    assert set(analogue_ensemble(nyc, DEPART, 12).labels) == set(ahead.labels) - {"2013-07-10"}


def test_dates_are_those_of_the_clock_the_departure_is_given_on():
    history = years(date(2012, 1, 1), date(2013, 12, 31))
    evening = datetime(2013, 7, 10, 22, tzinfo=EASTERN_SUMMER)
    truth = truth_series(history, date(2013, 7, 10), evening, 6)
    assert truth.north[0, 0, 0] * 3600.0 + history.start_s == evening.timestamp()


def test_the_season_runs_over_new_year():
    history = years(date(2011, 1, 1), date(2013, 12, 31))
    chosen = dates(analogue_ensemble(history, datetime(2020, 1, 5, 12, tzinfo=UTC), 6, season_days=10))
    assert date(2011, 12, 26) in chosen
    assert date(2013, 1, 15) in chosen
    assert date(2011, 12, 25) not in chosen
    assert date(2013, 1, 16) not in chosen
    assert len(chosen) == 3 * 21


def test_a_leap_day_is_a_day_of_late_february():
    history = years(date(2011, 1, 1), date(2013, 12, 31))
    leap = dates(analogue_ensemble(history, datetime(2024, 2, 29, 12, tzinfo=UTC), 6, season_days=1))
    assert set(leap) == {
        *(date(year, month, day) for year in (2011, 2012, 2013) for month, day in ((2, 27), (2, 28), (3, 1))),
        date(2012, 2, 29),
    }


@given(
    depart=st.integers(-630_720_000, 3_786_912_000).map(lambda t: datetime.fromtimestamp(t, UTC)),
    season=st.integers(0, 200),
    hours=st.integers(1, 72),
)
def test_analogue_days_lie_in_season_and_never_overlap_the_departure(depart, season, hours):
    history = years(date(2011, 1, 1), date(2012, 12, 31))
    try:
        chosen = analogue_ensemble(history, depart, hours, season_days=season)
    except InputError:
        assert season * 24 < hours
        return
    assert chosen.start_s <= depart.timestamp() < chosen.start_s + 3600.0
    for day, first in zip(dates(chosen), chosen.north[:, 0, 0], strict=True):
        begin = history.start_s + first * 3600.0
        assert datetime.fromtimestamp(begin, UTC).date() == day
        assert datetime.fromtimestamp(begin, UTC).hour == depart.hour
        assert abs(begin - chosen.start_s) >= hours * 3600.0
        near = min(abs((day - _same_day(depart, day.year + k)).days) for k in (-1, 0, 1))
        assert near <= season + 1  # a leap day may lie between


def _same_day(depart: datetime, year: int) -> date:
    return date(year, depart.month, min(depart.day, 28) if depart.month == 2 else depart.day)


def test_the_truth_and_the_days_whose_series_overlap_it_are_left_out(nyc):
    ensemble = analogue_ensemble(nyc, DEPART.replace(year=2030), 36, exclude=[date(2013, 7, 4)])
    left_out = {date(2013, 7, 3), date(2013, 7, 4), date(2013, 7, 5)}
    assert not left_out & set(dates(ensemble))
    assert {date(2013, 7, 2), date(2013, 7, 6)} <= set(dates(ensemble))


def test_days_with_a_gap_or_cut_off_by_the_end_of_the_record_are_left_out():
    history = years(date(2013, 6, 1), date(2013, 6, 30))
    history.north[24 * 9 + 15, 1] = np.nan
    chosen = dates(analogue_ensemble(history, datetime(2020, 6, 15, 12, tzinfo=UTC), 24))
    assert date(2013, 6, 10) not in chosen
    assert date(2013, 6, 9) in chosen
    assert max(chosen) == date(2013, 6, 29)


def test_a_season_without_a_day_says_which_and_what_the_record_covers():
    history = years(date(2013, 6, 1), date(2013, 6, 30))
    winter = datetime(2030, 1, 10, 12, tzinfo=UTC)
    message = r"made\.csv: no analogue day for the season 11 December to 09 February; the record covers 2013-06-01"
    with pytest.raises(InputError, match=message):
        analogue_ensemble(history, winter, 12)
    with pytest.raises(InputError, match=r"1 day in that season, 1 without a gap, all of them excluded"):
        analogue_ensemble(history, datetime(2013, 6, 10, 12, tzinfo=UTC), 12, season_days=0)


def test_a_naive_departure_or_an_endless_one_is_refused(nyc):
    with pytest.raises(InputError, match="no UTC offset"):
        analogue_ensemble(nyc, DEPART.replace(tzinfo=None), 12)
    for hours in (0, -3, 10_000):
        with pytest.raises(InputError, match="not a length of forecast"):
            analogue_ensemble(nyc, DEPART, hours)


def test_the_truth_is_what_was_measured_laid_onto_the_departure(nyc):
    truth = truth_series(nyc, date(2013, 7, 4), DEPART, 8)
    first = int((datetime(2013, 7, 4, 18, tzinfo=UTC).timestamp() - nyc.start_s) // 3600)
    assert truth.start_s == datetime(2013, 7, 10, 18, tzinfo=UTC).timestamp()
    assert np.array_equal(truth.north[0], nyc.north[first : first + 8])
    assert truth.labels == ("2013-07-04",)


def test_a_truth_that_was_not_measured_names_the_range_and_the_nearest_whole_day(nyc):
    with pytest.raises(InputError, match=r"covers 2013-01-01 06:00 to .* without a gap is 2013-12-29"):
        truth_series(nyc, date(2014, 7, 4), DEPART, 12)


def test_a_constant_wind_blows_the_same_always_and_everywhere():
    wind = constant_wind(8.0, 270.0, DEPART, 6, 40.7, -74.0, 60.0)
    north, east = wind.wind_at(41.0, -73.0, 3)
    assert east == pytest.approx(8.0)
    assert north == pytest.approx(0.0, abs=1e-12)
    assert wind.north.shape == (1, 6, 1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((-1.0, 90.0, 40.0, -74.0, 10.0), "not a wind speed"),
        ((float("nan"), 90.0, 40.0, -74.0, 10.0), "not a wind speed"),
        ((8.0, 400.0, 40.0, -74.0, 10.0), "not a direction"),
        ((8.0, 90.0, 140.0, -37.8, 10.0), "may be swapped"),
        ((8.0, 90.0, -95.0, -74.0, 10.0), "latitude out of range"),
        ((8.0, 90.0, 40.0, -74.0, 0.0), "not a height"),
    ],
)
def test_a_constant_wind_that_cannot_be_is_refused(values, message):
    speed, direction, lat, lon, height = values
    with pytest.raises(InputError, match=message):
        constant_wind(speed, direction, DEPART, 6, lat, lon, height)


@given(
    lat=st.floats(39.0, 42.0),
    lon=st.floats(-75.0, -73.0),
)
def test_the_weights_of_the_sites_sum_to_1_and_the_nearest_weighs_most(lat, lon):
    places = np.array([40.69, 40.64, 40.78]), np.array([-74.17, -73.78, -73.87])
    (weights,) = idw_weights(lat, lon, *places)
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(weights >= 0.0)


def test_at_a_site_its_wind_alone_counts_exactly():
    ensemble = small()
    north, east = ensemble.wind_at(40.1, -74.0, 2)
    assert np.array_equal(north, ensemble.north[:, 2, 1])
    assert np.array_equal(east, ensemble.east[:, 2, 1])


def test_twice_as_near_counts_four_times():
    (weights,) = idw_weights(0.0, 1.0, [0.0, 0.0], [0.0, 3.0])
    assert weights == pytest.approx([0.8, 0.2], rel=1e-9)


def test_higher_up_every_member_blows_stronger_by_the_same_power_law():
    ensemble = small()
    higher = ensemble.at_height(60.0, 0.2)
    assert np.allclose(higher.north, ensemble.north * 6.0**0.2)
    assert higher.height_m == 60.0
    assert np.allclose(higher.at_height(10.0, 0.2).east, ensemble.east)


def test_one_member_is_certain():
    alone = small().member(3)
    assert alone.labels == ("d",)
    assert alone.probability.tolist() == [1.0]
    assert np.array_equal(alone.north[0], small().north[3])
    with pytest.raises(IndexError):
        small().member(5)


def test_the_mean_wind_is_weighted_by_probability():
    ensemble = small()
    mean = ensemble.mean()
    expected = np.tensordot(ensemble.probability, ensemble.north, axes=1)
    assert np.allclose(mean.north[0], expected)
    assert len(mean) == 1


@given(members=st.integers(1, 10), most=st.integers(1, 12))
def test_a_thinned_ensemble_keeps_its_order_and_sums_to_1(members, most):
    thinned = small(members).thinned(most)
    assert len(thinned) == min(members, most)
    assert list(thinned.labels) == sorted(set(thinned.labels))
    assert thinned.probability.sum() == pytest.approx(1.0)


def test_likely_members_gain_weight_and_impossible_ones_lose_it():
    weighted = small(3).weighted([0.0, 1.0, 1.0])
    assert weighted.probability == pytest.approx([0.0, 0.4, 0.6])
    for weights in ([0.0, 0.0, 0.0], [-1.0, 1.0, 1.0], [np.nan, 1.0, 1.0]):
        with pytest.raises(InputError, match="leave a member"):
            small(3).weighted(weights)


def test_before_and_after_the_forecast_its_first_and_last_slot_hold():
    ensemble = small()
    assert [ensemble.slot_at(t) for t in (-5.0, 0.0, 3599.9, 3600.0, 1e9)] == [0, 0, 0, 1, 3]


def test_an_ensemble_is_never_incomplete_nor_improbable():
    good = small(2)
    for change in (
        {"north": good.north * np.nan},
        {"probability": np.array([0.5, 0.6])},
        {"labels": ("a",)},
    ):
        values = {name: getattr(good, name) for name in WindEnsemble.__dataclass_fields__} | change
        with pytest.raises(InputError, match="wind ensemble"):
            WindEnsemble(**values)


HEADER = "time,site,member,speed_mps,from_deg"


def forecast_rows(hours=range(15, 21), members=("m1", "m2")) -> list[str]:
    return [
        f"2030-07-10T{h:02d}:00Z,{site.id},{member},{h / 4 + place + 2 * number},270"
        for h in hours
        for place, site in enumerate(PAIR)
        for number, member in enumerate(members)
    ]


def forecast(folder, rows, header=HEADER, depart=datetime(2030, 7, 10, 17, 30, tzinfo=UTC), hours=2):
    path = folder / "forecast.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return read_forecast(path, PAIR, depart, hours, 10.0)


def test_a_forecast_file_begins_at_the_departure_and_its_last_wind_holds_on(tmp_path):
    ensemble = forecast(tmp_path, forecast_rows(), hours=6)
    assert ensemble.start_s == datetime(2030, 7, 10, 17, tzinfo=UTC).timestamp()
    assert ensemble.labels == ("m1", "m2")
    assert ensemble.probability.tolist() == [0.5, 0.5]
    speeds = speed_from(ensemble.north, ensemble.east)[0]
    assert np.allclose(speeds[0, :, 0], [17 / 4, 18 / 4, 19 / 4, 20 / 4, 20 / 4, 20 / 4, 20 / 4])
    assert np.allclose(speeds[1, :, 1] - speeds[0, :, 0], 3.0)
    assert np.all(ensemble.east > 0.0)


def test_a_forecast_may_be_unsorted_with_steps_of_three_hours_and_probabilities(tmp_path):
    rows = [f"{row},{0.25 if 'm1' in row else 0.75}" for row in forecast_rows(range(0, 24, 3))]
    ensemble = forecast(tmp_path, rows[::-1], HEADER + ",probability", hours=4)
    assert ensemble.slot_s == 10800.0
    assert ensemble.start_s == datetime(2030, 7, 10, 15, tzinfo=UTC).timestamp()
    assert dict(zip(ensemble.labels, ensemble.probability, strict=True)) == {"m1": 0.25, "m2": 0.75}


def test_a_forecast_of_one_hour_holds_and_calm_needs_no_direction(tmp_path):
    rows = ["2030-07-10T17:00Z,a,x,0,", "2030-07-10T17:00Z,b,x,5,90"]
    ensemble = forecast(tmp_path, rows, hours=3)
    assert np.allclose(ensemble.east[0], [[0.0, -5.0]] * 4)


def test_a_forecast_that_does_not_cover_the_departure_says_what_it_covers(tmp_path):
    with pytest.raises(InputError, match=r"only 2030-07-10T15:00:00Z to 2030-07-10T21:00:00Z"):
        forecast(tmp_path, forecast_rows(), depart=datetime(2030, 7, 10, 21, tzinfo=UTC))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[:-1], "member m2, site b, 2030-07-10T20:00:00Z is missing"),
        (lambda rows: [*rows, rows[-1]], r"csv:26: member m2, site b, .* is given twice"),
        (
            lambda rows: [r for r in rows if "T17" not in r],
            r"from .*16:00:00Z to .*18:00:00Z the step is 2 h",
        ),
        (lambda rows: [r.replace("Z", "") for r in rows], "no UTC offset"),
        (lambda rows: [r.replace("2030", "9999") for r in rows], "the time is out of range"),
        (lambda rows: [r.replace(",a,", ",c,") for r in rows], "unknown site .*the sites are a, b"),
        (lambda rows: [r.replace("m1", "") for r in rows], "member: no member"),
        (lambda rows: [r.replace("270", "NA") for r in rows], "from_deg: not a number"),
        (lambda rows: [r.replace("270", "-1") for r in rows], "direction out of range"),
        (lambda rows: [r.replace(",270", "e2,270") for r in rows], "not a wind speed"),
        (lambda rows: [r.replace(",270", "") for r in rows], "4 cells where the header has 5"),
    ],
)
def test_a_faulty_forecast_names_its_faults(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        forecast(tmp_path, change(forecast_rows()))


@pytest.mark.parametrize(
    ("chance", "message"),
    [
        (lambda row: 0.5 if "m1" in row else 0.6, "do not sum to 1"),
        (lambda row: 0.5 if "T16" in row else 0.4, "probability of a member changes"),
        (lambda row: 1.5, "not a probability"),
        (lambda row: "", "probability: not a number"),
    ],
)
def test_probabilities_of_a_forecast_must_be_probabilities(tmp_path, chance, message):
    rows = [f"{row},{chance(row)}" for row in forecast_rows()]
    with pytest.raises(InputError, match=message):
        forecast(tmp_path, rows, HEADER + ",probability")


def test_a_forecast_with_steps_of_half_a_day_or_scattered_times_is_refused(tmp_path):
    with pytest.raises(InputError, match="12 h apart; at most 6 h"):
        forecast(tmp_path, forecast_rows((0, 12)))
    scattered = [f"2030-07-10T12:00:{n // 100:02d}.{n % 100:02d}0000Z,a,m{n},3,90" for n in range(5999)]
    with pytest.raises(InputError, match="a row for each of them together"):
        forecast(tmp_path, scattered)
