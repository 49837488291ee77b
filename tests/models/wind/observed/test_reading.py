"""Observed winds as they are handed over: typed, tables, METARs, and what drones measured; and hostile input."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.wind.history import WindSite
from skyway.models.wind.observed.conditioning import counted
from skyway.models.wind.observed.reading import STATION_ERROR_MPS, read_observed, site_named

SITES = (WindSite("EWR", 40.68, -74.17), WindSite("JFK", 40.64, -73.76), WindSite("roof", 40.7, -74.0, "KNYC"))
DEPART = 1_373_479_200.0  # 2013-07-10T18:00Z


def read(given_, depart_s=DEPART):
    return read_observed(str(given_), SITES, 10.0, depart_s)


def refused(given_):
    with pytest.raises(InputError) as error:
        read(given_)
    return str(error.value)


def test_a_typed_wind_is_of_the_departure_at_the_anemometer():
    (one,) = read("EWR=8@270").winds
    seen = one.observation
    assert (seen.time_s, seen.lat_deg, seen.lon_deg, seen.height_m) == (DEPART, 40.68, -74.17, 10.0)
    assert (seen.north_mps, seen.east_mps) == (
        pytest.approx(0.0, abs=1e-12),
        pytest.approx(8.0),
    )  # from the west: towards east
    assert seen.variance == pytest.approx(STATION_ERROR_MPS**2)


def test_a_typed_wind_may_say_its_time():
    (one,) = read("JFK=3.5@090@2013-07-10T13:51-04:00").winds
    assert one.observation.time_s == DEPART - 540.0


def test_a_variable_wind_is_as_unsure_as_it_is_strong():
    (one,) = read("EWR=3@VRB").winds
    assert (one.observation.north_mps, one.observation.east_mps, one.from_deg) == (0.0, 0.0, None)
    assert one.observation.variance == pytest.approx(
        STATION_ERROR_MPS**2 + 4.5
    )  # of each component of 3 m/s from anywhere


@pytest.mark.parametrize(
    ("typed", "problem"),
    [
        ("LGA=8@270", "unknown station LGA (got 'LGA=8@270'); the scenario's wind sites are EWR, JFK, roof (KNYC)"),
        ("EWR=fast@270", "not a wind speed"),
        (
            "EWR=90@270",
            "90 m/s is more than stations measure (up to 35) (got 'EWR=90@270'); write m/s; 90 km/h are 25.0, 90 knots 46.3",
        ),
        ("EWR=60@270", "60 km/h are 16.7, 60 knots 30.9"),
        ("EWR=8@361", "not a direction"),
        ("EWR=8@west", "not a direction"),
        ("EWR=8@270@14:00", "not an ISO 8601 time"),
        ("EWR=nan@270", "not a wind speed"),
        ("8@270", "not an observed wind"),
        ("EWR=8", "not an observed wind"),
        ("EWR", "--observed: not an observed wind (got 'EWR'); write SITE=SPEED@FROM"),
        ("nowhere.txt", "nowhere.txt: no such file"),
        ("EWR=8@" + "2" * 5000, "not a direction"),
        ("E" * 5000, "cannot be read"),
        ("a\0b.txt", "cannot be read"),
    ],
)
def test_what_is_typed_wrong_is_a_clear_error(typed, problem):
    assert problem in refused(typed)


def test_stations_are_found_by_id_identifier_and_without_the_letter_of_the_country():
    assert [site.id for name in ("EWR", "ewr", "KEWR", "KNYC") if (site := site_named(name, SITES))] == [
        "EWR",
        "EWR",
        "EWR",
        "roof",
    ]
    assert site_named("EGLL", SITES) is None
    assert site_named("", SITES) is None


def test_metars_become_observations_and_missing_winds_notes(tmp_path):
    file = tmp_path / "metars.txt"
    file.write_text("KEWR 101751Z 27016KT 10SM\nKJFK 101751Z AUTO /////KT 10SM\nKNYC 101751Z 00000KT\n")
    found = read(file)
    assert [one.place for one in found.winds] == ["EWR", "roof"]
    assert found.winds[0].speed_mps == pytest.approx(16 * 1852 / 3600)
    assert (found.winds[1].speed_mps, found.winds[1].observation.variance) == (0.0, pytest.approx(STATION_ERROR_MPS**2))
    assert found.notes == (f"{file}:2: KJFK reports no wind at 2013-07-10T17:51:00Z",)


def test_a_station_that_the_scenario_does_not_know_is_named_with_those_that_it_does(tmp_path):
    file = tmp_path / "metars.txt"
    file.write_text("KEWR 101751Z 27016KT\nKTEB 101751Z 27016KT\n")
    assert f"{file}:2: unknown station KTEB; the scenario's wind sites are EWR, JFK, roof (KNYC)" in refused(file)


def test_a_table_names_sites_or_places_with_heights_and_errors(tmp_path):
    file = tmp_path / "winds.csv"
    file.write_text(
        "time,site,lat,lon,height_m,speed_mps,from_deg,sigma_mps\n"
        "2013-07-10T17:51Z,KEWR,,,,8,270,\n"
        "2013-07-10T17:55Z,,40.7,-74.05,60,9,280,0.5\n"
        "2013-07-10T17:55Z,JFK,,,,2,VRB,\n"
    )
    airport, drone, variable = read(file).winds
    assert (airport.place, airport.drone, airport.observation.height_m) == ("EWR", False, 10.0)
    assert (drone.drone, drone.observation.height_m, drone.observation.variance) == (True, 60.0, pytest.approx(0.25))
    assert variable.from_deg is None


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("2013-07-10T17:51,EWR,8,270", "the time has no UTC offset"),
        ("2013-07-10T17:51Z,LGA,8,270", "unknown station LGA"),
        ("2013-07-10T17:51Z,,8,270", "has no place"),
        ("2013-07-10T17:51Z,EWR,-8,270", "not a wind speed"),
        (
            "2013-07-10T17:51Z,EWR,40,270",
            "40 m/s is more than stations measure (up to 35) (got '40'); write m/s; 40 km/h are 11.1",
        ),
        ("2013-07-10T17:51Z,EWR,8,400", "direction out of range"),
        ("2013-07-10T17:51Z,EWR,inf,270", "not a finite number"),
    ],
)
def test_each_fault_of_a_table_names_its_line(tmp_path, row, problem):
    file = tmp_path / "winds.csv"
    file.write_text(f"time,site,speed_mps,from_deg\n{row}\n")
    said = refused(file)
    assert f"{file}:2" in said
    assert problem in said


def test_what_forecast_prints_of_drones_is_read(tmp_path):
    file = tmp_path / "measured.json"
    document = {
        "schema": "skyway.forecast-update/1", "depart": "2013-07-10T18:00:00Z", "height_m": 10.0, "field": [], "hours": [], "members": {},
        "observations": [{"t": "2013-07-10T17:45:00Z", "lat": 40.7, "lon": -74.0, "north_mps": 3.0, "east_mps": 4.0, "sigma_mps": 0.8}],
    }  # fmt: skip
    file.write_text(json.dumps(document))
    (one,) = read(file).winds
    assert (one.speed_mps, one.from_deg, one.drone) == (
        pytest.approx(5.0),
        pytest.approx(math.degrees(math.atan2(4, 3)) + 180.0),
        True,
    )
    for key, value in (("schema", "other/1"), ("height_m", "high"), ("observations", [{"t": 3}])):
        file.write_text(json.dumps(document | {key: value}))
        assert str(file) in refused(file)


@given(st.binary(max_size=300))
def test_any_file_is_read_or_refused(tmp_path_factory, content):
    file = tmp_path_factory.mktemp("any") / "any.txt"
    file.write_bytes(content)
    try:
        found = read(file)
    except InputError:
        return
    assert all(math.isfinite(one.observation.north_mps + one.observation.east_mps) for one in found.winds)


def test_faults_of_a_table_or_report_have_values_and_remedies_of_that_file(tmp_path):
    file = tmp_path / "winds.csv"
    file.write_text("time,site,speed_mps,from_deg\n2013-07-10T17:51Z,EWR,nan,270\n2013-07-10T17:51Z,EWR,8,400\n")
    assert "speed_mps: not a finite number (got 'nan'); a number, or omit the row" in refused(file)
    assert "from_deg: direction out of range (got '400'); degrees from 0 to 360, or variable" in refused(file)
    file = tmp_path / "metars.txt"
    file.write_text("KEWR 101751Z 270160KT 10SM\n")
    assert "metars.txt:1: not a wind speed (got '270160KT'); up to 75 m/s" in refused(file)
    file.write_text("KEWR 101751Z 27016KT 10SM\nKEWR 101751Z 09016KT 10SM\n")
    with pytest.raises(InputError, match=r"metars\.txt:1\) and 8\.2 m/s from 090° \(\S+metars\.txt:2\)"):
        counted(read(file).winds, SITES, DEPART)


def test_metars_in_json_are_those_of_the_text_of_the_month_that_the_file_tells(shared_data):
    """Of avwx, October 2023, though the departure is of 2013."""
    found = read(shared_data / "forecast" / "kjfk_metar.json")
    assert {one.place for one in found.winds} == {"JFK"}
    last = max(found.winds, key=lambda one: one.observation.time_s)
    assert last.observation.time_s == 1_697_521_860.0  # 2023-10-17T05:51Z
    assert (last.speed_mps, last.from_deg, last.line) == (pytest.approx(7 * 1852 / 3600), 360.0, None)


def test_a_list_of_reports_in_json_is_read_and_a_taf_is_refused_as_one(tmp_path, shared_data):
    file = tmp_path / "metars.json"
    reports = [f"{station} 101751Z 27016KT 10SM" for station in ("KEWR", "KJFK")]
    file.write_text(json.dumps([{"icaoId": one[:4], "rawOb": one} for one in reports]))
    assert [(one.place, one.observation.time_s) for one in read(file).winds] == [
        ("EWR", DEPART - 540.0),
        ("JFK", DEPART - 540.0),
    ]
    assert "kjfk_taf.json: is a TAF, a forecast" in refused(shared_data / "forecast" / "kjfk_taf.json")
    for text, said in (('{"a": 1}', "is JSON, but no observed winds"), ("[{", "is damaged JSON")):
        file.write_text(text)
        assert said in refused(file)
        assert "METARs (text, or JSON of avwx" in refused(file)
