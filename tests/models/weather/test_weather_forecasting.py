"""Winds over a region made of weather files: in space, time and height, with the members and errors that they should have."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import weather_files as wf
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.weather.forecasting import forecast_ensemble
from skyway.models.weather.lead_error import PUBLISHED, LeadError
from skyway.models.weather.profile import wind_at_height
from skyway.models.weather.readers.reading import read_weather
from skyway.models.weather.region import Region
from skyway.models.wind.forecast import constant_wind
from skyway.models.wind.interpolation import site_weights
from skyway.planner.problem.error_model import NO_ERRORS, USUAL_ERRORS

NONE = LeadError(source="none", height_m=10.0, lead_h=(0.0,), sigma_mps=(0.0,))
LAT, LON = np.array([40.55, 40.9, 40.7]), np.array([-74.2, -73.7, -73.95])


def region(*, depart_h=1.0, hours=6, height_m=80.0, **more):
    return Region(LAT, LON, wf.ISSUED_S + 3600.0 * depart_h, hours, height_m, 0.2, **more)


def linear(member, hour, height, lat, lon):
    """A wind that is linear in place and time, with the member's own offset."""
    m = member or 0
    return 5.0 + m + 2.0 * (lat - 40.7) + 0.5 * hour, 3.0 - m - 1.5 * (lon + 74.0) - 0.25 * hour


@pytest.mark.parametrize("grid", ["regular_ll", "lambert"])
def test_between_grid_points_and_hours_components_are_interpolated(tmp_path, grid):
    if grid == "lambert":
        pytest.importorskip("eccodes")
    along = grid == "lambert"  # then the axes turn: compare speeds of a wind that is the same along the grid everywhere
    wind = (lambda m, hour, h, lat, lon: (6.0 + 0.5 * hour + 0 * lat, 0 * lat)) if along else linear
    path = wf.write_grib(tmp_path / "a.grib2", wind, hours=(0, 3, 6, 9), heights=(80,), grid=grid)
    found = forecast_ensemble(read_weather([path]), region(), NONE)
    assert (found.slot_s, found.start_s, len(found)) == (3600.0, wf.ISSUED_S + 3600.0, 1)
    north, east = found.at_times(LAT, LON, np.full(3, wf.ISSUED_S + 4.2 * 3600.0))  # in the slot from 4 to 5 h
    if along:
        np.testing.assert_allclose(np.hypot(north, east)[0], 6.0 + 0.5 * 4.5, atol=0.01)
        return
    u, v = linear(0, 4.5, 80, LAT, LON)
    np.testing.assert_allclose(east[0], u, atol=2e-3)
    np.testing.assert_allclose(north[0], v, atol=2e-3)


@settings(max_examples=30)
@given(
    rows=st.integers(1, 5), columns=st.integers(1, 5), a=st.floats(-5, 5), b=st.floats(-5, 5),
    lat=st.floats(40.0, 41.0), lon=st.floats(-74.5, -73.5),
)  # fmt: skip
def test_weights_of_a_lattice_give_linear_fields_back(rows, columns, a, b, lat, lon):
    lats, lons = (
        grid.ravel()
        for grid in np.meshgrid(np.linspace(40, 41, rows), np.linspace(-74.5, -73.5, columns), indexing="ij")
    )
    weight = site_weights(lat, lon, lats, lons, (rows, columns))
    np.testing.assert_allclose(weight.sum(), 1.0)
    if rows > 1 and columns > 1:
        np.testing.assert_allclose(weight @ (a * lats + b * lons), a * lat + b * lon, atol=1e-9)


@settings(max_examples=60)
@given(
    low=st.floats(1.0, 15.0), exponent=st.floats(0.0, 0.5), turn=st.floats(-60.0, 60.0), height=st.floats(12.0, 99.0)
)
def test_the_profile_follows_a_power_law_and_turns_with_the_logarithm_of_height(low, exponent, turn, height):
    angle = np.radians([0.0, turn])
    speed = low * np.array([1.0, 10.0**exponent])
    north, east = wind_at_height((10.0, 100.0), speed * np.cos(angle), speed * np.sin(angle), height, 0.2)
    assert np.hypot(north, east) == pytest.approx(low * (height / 10.0) ** exponent, rel=1e-9)
    direction = np.degrees(np.arctan2(east, north))
    assert min(0.0, turn) - 1e-9 <= direction <= max(0.0, turn) + 1e-9


def test_heights_left_out_of_a_real_forecast_are_found_from_the_others(shared_data):
    (real,) = read_weather([shared_data / "forecast" / "gfs_wind_heights_baltic_20230720.nc"])
    fields = {key: values[0] for key, values in real.fields.items()}
    north, east = (np.stack([fields[part, height] for height in (10.0, 100.0)]) for part in ("north", "east"))
    found = wind_at_height((10.0, 100.0), north, east, 50.0, 0.2)
    miss = np.hypot(found[0] - fields["north", 50.0], found[1] - fields["east", 50.0])
    assert (
        np.sqrt((miss**2).mean()) < 0.15
    )  # the logarithmic law: 0.16, the scenario's exponent from 10 m alone: 1.9 m/s


@pytest.mark.parametrize("gaps", [(None,) * 6, (None, *(8.0,) * 5)])
def test_a_height_with_gaps_is_left_out_and_told(tmp_path, gaps):
    columns = {"wind_speed_10m": [5.0] * 6, "wind_direction_10m": [270.0] * 6}
    more = {"wind_speed_80m": list(gaps), "wind_direction_80m": [None if one is None else 270.0 for one in gaps]}
    units = {name: "°" if "direction" in name else "m/s" for name in (*columns, *more)}
    found = []
    for name, given_ in (("with.json", columns | more), ("without.json", columns)):
        path = wf.write_json(tmp_path / name, wf.open_meteo(given_, units, hours=6))
        found.append(forecast_ensemble(read_weather([path]), region(hours=3, height_m=60.0), NONE))
    assert any("wind at 80 m has gaps and is not used" in note for note in found[0].notes)
    assert not any("is not used" in note for note in found[1].notes)
    np.testing.assert_allclose(found[0].east, found[1].east)


@pytest.mark.parametrize(("again", "said"), [(5.0, None), (6.0, "for the same place and time")])
def test_two_answers_that_differ_and_do_not_say_which_is_newer_are_refused(tmp_path, again, said):
    units = {"wind_speed_10m": "m/s", "wind_direction_10m": "°"}
    files = []
    for name, start, speed in (("a.json", "2013-07-10T12:00", 5.0), ("b.json", "2013-07-10T15:00", again)):
        columns = {"wind_speed_10m": [speed] * 6, "wind_direction_10m": [270.0] * 6}
        files.append(wf.write_json(tmp_path / name, wf.open_meteo(columns, units, hours=6, start=start)))
    if said is None:
        assert len(read_weather(files)[0].times_s) == 9
        return
    with pytest.raises(InputError, match=said):
        read_weather(files)


def test_members_keep_their_courses(tmp_path):
    path = wf.write_grib(tmp_path / "e.grib2", linear, members=[0, 1, 2, 3], hours=(0, 3, 6, 9), heights=(80,))
    found = forecast_ensemble(read_weather([path]), region(), NONE)
    assert (found.labels, found.probability.tolist()) == (("0", "1", "2", "3"), [0.25] * 4)
    offsets = found.east - found.east[:1]
    np.testing.assert_allclose(offsets, np.broadcast_to(np.arange(4.0)[:, None, None], offsets.shape), atol=5e-3)


def test_one_course_is_given_the_published_errors_that_last_and_reach_far(tmp_path):
    path = wf.write_grib(tmp_path / "a.grib2", linear, hours=range(0, 49, 3), heights=(80,))
    runs = [
        forecast_ensemble(read_weather([path]), region(hours=40, height_m=10.0, seed=seed), PUBLISHED)
        for seed in range(12)
    ]
    bare = forecast_ensemble(read_weather([path]), region(hours=40, height_m=10.0), NONE)
    np.testing.assert_allclose(runs[0].east.mean(axis=0), bare.east[0], atol=1e-9)  # courses come in pairs
    errors = np.concatenate([run.east - bare.east for run in runs])
    rng = np.random.default_rng(1)
    within = runs[0].weights(rng.uniform(LAT.min(), LAT.max(), 300), rng.uniform(LON.min(), LON.max(), 300))
    for slot, lead_h in ((0, 1.5), (22, 23.5)):  # on average over the region, not at the nodes of the lattice
        assert (errors[:, slot] @ within.T).std() == pytest.approx(1.6 + 0.3 * lead_h / 24.0, rel=0.08)
    later = np.corrcoef(errors[:, 0, 0], errors[:, 6, 0])[0, 1]
    assert later == pytest.approx(np.exp(-1.0), abs=0.12)
    assert 0.15 < np.corrcoef(errors[:, 0, 0], errors[:, 0, -1])[0, 1] < 0.75
    assert any("its one course is given errors: published figures" in note for note in runs[0].notes)


def test_a_gap_that_interpolation_would_invent_the_wind_of_is_refused(tmp_path):
    path = wf.write_grib(tmp_path / "a.grib2", linear, hours=(0, 12), heights=(10,))
    with pytest.raises(
        InputError,
        match="has no wind between 2013-07-10T12:00:00Z and 2013-07-11T00:00:00Z; add the hours between",
    ):
        forecast_ensemble(read_weather([path]), region(height_m=10.0), NONE)


def test_the_spread_of_an_ensemble_becomes_that_of_its_errors(tmp_path):
    for width, wanted in ((0.05, 1.62), (2.0, 2.0 * np.std(np.arange(10.0), ddof=1))):
        path = wf.write_grib(
            tmp_path / f"{width}.grib2",
            lambda m, _h, _z, lat, _lon, w=width: (w * (m - 4.5) + 0 * lat, w * ((m * 3) % 10 - 4.5) + 0 * lat),
            members=list(range(10)), hours=(0, 6, 12), heights=(10,),
        )  # fmt: skip
        weathers = read_weather([path])
        runs = [forecast_ensemble(weathers, region(height_m=10.0, seed=seed), PUBLISHED) for seed in range(20)]
        found = np.mean([run.east[:, 0].var(axis=0, ddof=1) for run in runs]) ** 0.5
        assert found == pytest.approx(wanted, rel=0.12 if width < 1.0 else 1e-3)


def test_what_was_learnt_is_taken_off_and_stretched(tmp_path):
    path = wf.write_grib(tmp_path / "e.grib2", linear, members=[0, 1, 2, 3], hours=(0, 3, 6, 9), heights=(10,))
    learnt = LeadError(
        source="learnt",
        height_m=10.0,
        lead_h=(0.0, 10.0),
        sigma_mps=(0.0, 0.0),
        bias_mps=((1.0, -2.0), (1.0, -2.0)),
        spread_factor=(2.0, 2.0),
    )
    bare, found = (forecast_ensemble(read_weather([path]), region(height_m=10.0), error) for error in (NONE, learnt))
    np.testing.assert_allclose(found.north.mean(axis=0), bare.north.mean(axis=0) - 1.0)
    np.testing.assert_allclose(found.east.mean(axis=0), bare.east.mean(axis=0) + 2.0)
    np.testing.assert_allclose(found.east.std(axis=0), 2.0 * bare.east.std(axis=0))


def test_of_one_model_the_newest_issue_counts_and_the_change_is_told(tmp_path):
    old, new = (
        wf.write_grib(
            tmp_path / f"{h}.grib2",
            lambda m, hour, z, lat, lon, h=h: (h / 3.0 + 0 * lat, 0 * lat),
            hours=range(12 - h, 22 - h, 3),
            heights=(80,),
            issued_h=h,
        )
        for h in (9, 12)
    )
    found = forecast_ensemble(read_weather([new, old]), region(), NONE)
    np.testing.assert_allclose(found.east, 4.0, atol=1e-3)
    assert "IFS: from the issue of 2013-07-10T09:00:00Z to the next, the wind at 80 m changed by 1.0 m/s" in found.notes
    assert any("issued 2013-07-10T12:00:00Z" in note for note in found.notes)


def test_models_beside_each_other_share_the_probability(tmp_path):
    columns = {"wind_speed_10m": [6.0] * 12, "wind_direction_10m": [270] * 12}
    answer = wf.write_json(
        tmp_path / "a.json", wf.open_meteo(columns, {"wind_speed_10m": "m/s", "wind_direction_10m": "°"}, hours=12)
    )
    grib = wf.write_grib(tmp_path / "a.grib2", linear, members=[0, 1], hours=(0, 3, 6, 9), heights=(10,))
    found = forecast_ensemble(read_weather([answer, grib]), region(height_m=10.0), NONE)
    assert found.labels == ("Open-Meteo best match", "IFS 0", "IFS 1")
    np.testing.assert_allclose(found.probability, [0.5, 0.25, 0.25])
    np.testing.assert_allclose(found.east[0], 6.0)


def test_where_the_forecast_ends_the_record_goes_on_without_a_jump(tmp_path):
    path = wf.write_grib(tmp_path / "a.grib2", linear, hours=(0, 3), heights=(80,))
    weathers = read_weather([path])
    held = forecast_ensemble(weathers, region(hours=24), NONE)
    assert held.known_until_s == wf.ISSUED_S + 3 * 3600.0
    assert "continues" in held.then
    np.testing.assert_allclose(held.east[0, 2:], held.east[0, 2][None].repeat(22, axis=0))

    def record(begin_s, hours):
        return constant_wind(2.0, 90.0, datetime.fromtimestamp(begin_s, UTC), hours, 40.7, -74.0, 80.0)

    found = forecast_ensemble(weathers, region(hours=24, later=record), NONE)
    assert "record" in found.then
    assert np.abs(np.diff(found.east[0, 1:, 0])).max() < 2.0
    np.testing.assert_allclose(found.east[0, -1], -2.0, atol=0.4)


CASES = {
    "other region": ({"lat": 54.0, "lon": 10.0}, {}, r"does not cover the region .*40.55° N to 40.90° N.*; it covers 54.00° N, 10.00° E, up to [\d.,]+ km away; ask for"),
    "swapped": ({"lat": -74.0, "lon": 40.7}, {}, "does not cover the region .*; its lat and lon look swapped"),
    "ended": ({}, {"depart_h": 80.0}, r"does not cover the departure at 2013-07-13T20:00:00Z, only 2013-07-10T12:00:00Z to 2013-07-10T23:00:00Z; fetch a newer forecast"),
    "not begun": ({}, {"depart_h": -5.0}, "does not cover the departure .*; fetch the forecast that covers it"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_forecast_that_does_not_fit_is_one_clear_line(tmp_path, case):
    place, when, said = CASES[case]
    answer = wf.open_meteo(
        {"wind_speed_10m": [5.0] * 12, "wind_direction_10m": [270] * 12},
        {"wind_speed_10m": "m/s", "wind_direction_10m": "°"},
        hours=12,
        **place,
    )
    path = wf.write_json(tmp_path / "a.json", answer)
    with pytest.raises(InputError, match=said) as caught:
        forecast_ensemble(read_weather([path]), region(**when), NONE)
    assert len(caught.value.faults) == 1
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("speed", "said"),
    [
        (None, "has no value at its points here, only gaps .*; ask for"),
        (500.0, "has a wind of 500 m/s at 10 m.*; check its unit"),
    ],
)
def test_empty_and_impossible_winds_are_one_clear_line(tmp_path, speed, said):
    units = {"wind_speed_10m": "m/s", "wind_direction_10m": "°"}
    answer = wf.open_meteo({"wind_speed_10m": [speed] * 6, "wind_direction_10m": [270] * 6}, units, hours=6)
    path = wf.write_json(tmp_path / "a.json", answer)
    with pytest.raises(InputError, match=said) as caught:
        forecast_ensemble(read_weather([path]), region(), NONE)
    assert str(path) in str(caught.value)


def test_an_old_forecast_and_one_that_is_left_out_are_said(tmp_path):
    grib = wf.write_grib(tmp_path / "a.grib2", linear, hours=(72, 75, 78), heights=(80,))
    metar = tmp_path / "metar.txt"
    metar.write_text("KJFK 131151Z 22010KT\n")
    found = forecast_ensemble(read_weather([grib, metar], near_s=wf.ISSUED_S + 3 * 86_400), region(depart_h=73.0), NONE)
    assert any("issued 3 days" in note or "issued 73 h" in note for note in found.notes), found.notes
    assert any("ignored" in note and "is an observation, not a forecast" in note for note in found.notes)


def test_a_forecast_error_file_is_read_back_or_refused(tmp_path):
    from skyway.models.weather.lead_error import lead_error_text, read_lead_error

    path = tmp_path / "e.json"
    path.write_text(lead_error_text(PUBLISHED))
    assert read_lead_error(path) == PUBLISHED
    for change in (
        {"sigma_mps": [1.0]},
        {"lead_h": [3.0, 1.0, 2.0]},
        {"height_m": -1},
        {"schema": "x"},
        {"sigma_mps": "a"},
    ):
        path.write_text(json.dumps({**json.loads(lead_error_text(PUBLISHED)), **change}))
        with pytest.raises(InputError, match="skyway weather verify"):
            read_lead_error(path)


def test_a_scenario_names_its_forecasts(tmp_path):
    from skyway.scenarios import load_scenario

    world = load_scenario(None)
    grib = wf.write_grib(tmp_path / "a.grib2", linear, members=[0, 1, 2], hours=range(0, 13, 3), heights=(10, 80))
    depart = datetime.fromtimestamp(wf.ISSUED_S, UTC) + timedelta(hours=1)
    found = world.forecast_from([tmp_path], depart, 48)
    assert (len(found), found.height_m, found.lattice) == (60, world.rules.cruise_height_m, (4, 4))
    assert found.slots == 48
    assert "record" in found.then
    with pytest.raises(InputError, match="no such file"):
        world.forecast_from([grib.with_name("b.grib2")], depart, 48)


@pytest.mark.parametrize(("gust_mps", "share"), [(11.0, 2.0 / 7.5), (5.5, 0.5 / 3.0 / 7.5), (40.0, 0.5), (2.0, 0.05)])
def test_the_spread_of_gusts_is_a_third_of_what_they_are_above_the_wind(tmp_path, gust_mps, share):
    names = ("wind_speed_10m", "wind_direction_10m", "wind_speed_80m", "wind_direction_80m", "wind_gusts_10m")
    columns = {name: [value] * 8 for name, value in zip(names, (5.0, 250.0, 7.5, 260.0, gust_mps), strict=True)}
    units = {name: "m/s" if "direction" not in name else "°" for name in names}
    path = wf.write_json(tmp_path / "om.json", wf.open_meteo(columns, units, hours=8))
    found = forecast_ensemble(read_weather([path]), region(), NONE)
    assert found.weather is not None
    np.testing.assert_allclose(
        found.weather.between("gust_sd", found.start_s, found.start_s + 1.0), np.clip(share, 0.05, 0.5), rtol=1e-6
    )
    assert USUAL_ERRORS.in_forecast(found, found.start_s).gust_sd == pytest.approx(np.clip(share, 0.05, 0.5))
    assert NO_ERRORS.in_forecast(found, found.start_s) is NO_ERRORS
