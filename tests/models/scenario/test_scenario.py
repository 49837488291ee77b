"""Scenarios: New York as it is built in, and everything that can be wrong with one of your own, said at once."""

import gzip
import os
from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pytest

from skyway.missions.examples import NEW_YORK
from skyway.models.airspace.ways import at_any_height
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.drones.drone import M200_V2
from skyway.models.scenario.file import read_scenario

TOML = """schema = "skyway.scenario/1"
name = "Test"
timezone = "America/New_York"
[network]
stations = "stations.csv"
max_length_m = 13000
zones = "zones.geojson"
[drones]
fleet = "drones.toml"
[flight]
cruise_height_m = 60
[wind]
history = "wind.csv"
speed = "speed"
from = "from"
speed_unit = "m/s"
time_zone = "UTC"
[[wind.sites]]
id = "JFK"
lat = 40.64
lon = -73.76
[load]
file = "load.csv"
"""
STATIONS = """id,name,lat,lon,elevation_m,pads
bx,Bronx,40.85,-73.90,10,5
hm,Harlem,40.81,-73.94,12,5
qn,Queens,40.77,-73.88,8,5
bk,Brooklyn,40.70,-73.92,20,5
"""
FLEET = 'schema = "skyway.fleet/1"\n[[drone]]\nbase = "m200-v2"\nid = "m200"\n'
ZONES = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"name": "JFK"}, "geometry": '
    '{"type": "Polygon", "coordinates": [[[-73.82,40.62],[-73.75,40.62],[-73.75,40.66],[-73.82,40.66],[-73.82,40.62]]]}}]}'
)
LOAD = "station,hour_of_week,arrivals_per_h,mean_charging_min\n" + "".join(f"*,{hour},2,60\n" for hour in range(168))


def wind_rows(days: int = 10) -> str:
    hours = [datetime.fromtimestamp(1_373_328_000 + 3600 * n, UTC) for n in range(24 * days)]
    return "time,speed,from\n" + "".join(
        f"{hour:%Y-%m-%d %H:%M},{4 + hour.hour % 5},{10 * hour.hour}\n" for hour in hours
    )


PARTS = {
    "scenario.toml": TOML,
    "stations.csv": STATIONS,
    "drones.toml": FLEET,
    "zones.geojson": ZONES,
    "wind.csv": wind_rows(),
    "load.csv": LOAD,
}


@pytest.fixture
def scenario_with(tmp_path):
    """Write a good scenario with some parts changed (None leaves a part out); returns its folder."""

    def write(change=None, **parts):
        for name, text in {**PARTS, **{key.replace("_", "."): value for key, value in parts.items()}}.items():
            if name == "scenario.toml" and change is not None:
                text = change(text)  # noqa: PLW2901
            if text is not None:
                (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return tmp_path

    return write


def said_of(folder) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_scenario(folder)
    lines = [str(fault) for fault in caught.value.faults]
    assert all(line.isprintable() for line in lines)
    return [line.removeprefix(f"{folder}/") for line in lines]


def with_line(line: str, after: str = "[network]"):
    return lambda text: text.replace(after, f"{after}\n{line}", 1)


def instead(old: str, new: str):
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return change


# --- New York ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def new_york():
    return read_scenario(NEW_YORK)


def test_new_york_has_46_stations_of_which_each_reaches_each(new_york):
    assert len(new_york.network) == 46
    assert len(new_york.network.parts()) == 1
    assert {len(new_york.drones), len({drone.provider for drone in new_york.drones})} == {4, 2}
    assert (new_york.name, new_york.timezone) == ("New York", "America/New_York")


def test_new_york_meets_the_wind_of_1048_miles_per_hour_and_says_so(new_york):
    assert new_york.history.counts.absurd == 1
    (said,) = [warning for warning in new_york.warnings if "1048" in warning]
    assert "rows dropped for a speed above 75 m/s: 1" in said
    assert np.nanmax(np.hypot(new_york.history.north, new_york.history.east)) < 75.0


def test_no_segment_of_new_york_is_longer_than_its_rule_or_over_an_airport(new_york):
    network = new_york.network
    assert network.distance_m.max() <= 13_000.0
    ends = (network.lat[network.tail], network.lon[network.tail], network.lat[network.head], network.lon[network.head])
    assert not network.zones.crossed_by(at_any_height(*ends)).any()
    pairs = set(zip(network.tail.tolist(), network.head.tolist(), strict=True))
    assert all((head, tail) in pairs for tail, head in pairs)


def test_a_day_of_the_record_is_laid_onto_a_departure_by_the_local_calendar(new_york):
    evening = datetime(2013, 7, 11, 1, tzinfo=UTC)  # still 10 July in New York
    truth = new_york.truth(date(2013, 7, 10), evening, 6)
    assert len(truth) == 1
    forecast = new_york.forecast(evening, 6, truth=date(2013, 7, 10))
    assert "2013-07-10" not in forecast.labels
    assert len(forecast) > 40


def test_a_naive_departure_is_refused_by_forecast_and_truth(new_york):
    noon = datetime(2013, 7, 10, 12)  # noqa: DTZ001
    with pytest.raises(InputError, match="no UTC offset"):
        new_york.forecast(noon, 6)
    with pytest.raises(InputError, match="no UTC offset"):
        new_york.truth(date(2013, 7, 10), noon, 6)


def test_a_drone_is_asked_for_by_id(new_york):
    first = new_york.drones[0]
    assert new_york.drone(first.id) is first
    with pytest.raises(InputError, match=f"no such drone .got 'nimbus'.; the fleet has {first.id}, "):
        new_york.drone("nimbus")


def test_a_delivery_target_joins_network_and_load(new_york):
    there = new_york.with_target(40.75, -73.99)
    assert len(there.network) == 47
    assert there.load.arrivals_per_s.shape[0] == 47
    assert there.load.arrivals_per_s[46].sum() == 0.0


def test_a_scenario_without_a_record_says_how_to_give_a_wind(new_york):
    with pytest.raises(InputError, match=r"has no wind record; give \[wind\] history .*--wind 8@270"):
        replace(new_york, history=None).forecast(datetime(2013, 7, 10, tzinfo=UTC), 6)


# --- what a good scenario may look like ---------------------------------------------------------------------------


def test_a_scenario_of_ones_own_is_read(scenario_with):
    scenario = read_scenario(scenario_with())
    assert [station.id for station in scenario.network.stations] == ["bx", "hm", "qn", "bk"]
    assert scenario.drones[0].id == "m200"
    assert scenario.warnings == ()
    assert len(scenario.sha256) == 64


def test_the_digest_changes_with_any_part(scenario_with):
    digests = {read_scenario(scenario_with()).sha256}
    for name, text in PARTS.items():
        changed = {**PARTS, name: text + "\n"}
        digests.add(
            read_scenario(scenario_with(**{key.replace(".", "_"): value for key, value in changed.items()})).sha256
        )
    assert len(digests) == 1 + len(PARTS)
    assert (
        read_scenario(scenario_with(**{key.replace(".", "_"): value for key, value in PARTS.items()})).sha256 in digests
    )


def test_a_scenario_of_stations_alone_is_enough(scenario_with):
    folder = scenario_with(lambda _: 'schema = "skyway.scenario/1"\n[network]\nstations = "stations.csv"\n')
    scenario = read_scenario(folder)
    assert scenario.drones == (M200_V2,)
    assert scenario.history is None
    assert scenario.name == folder.name
    assert scenario.warnings == ("no [load]: assuming that no other drones use the pads",)
    assert read_scenario(folder / "scenario.toml").sha256 == scenario.sha256


@pytest.mark.parametrize(
    "dress",
    [lambda text: text.replace("\n", "\r\n").encode(), lambda text: b"\xef\xbb\xbf" + text.encode()],
    ids=["CRLF", "byte-order mark"],
)
def test_files_from_any_editor_are_read(scenario_with, dress):
    folder = scenario_with(**{name.replace(".", "_"): dress(text) for name, text in PARTS.items()})
    assert len(read_scenario(folder).network) == 4


def test_parts_may_be_links_packed_or_elsewhere(scenario_with, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "wind.csv.gz").write_bytes(gzip.compress(PARTS["wind.csv"].encode()))
    folder = scenario_with(instead('"wind.csv"', f'"{elsewhere / "wind.csv.gz"}"'), wind_csv=None, stations_csv=None)
    (elsewhere / "s.csv").write_text(STATIONS)
    (folder / "stations.csv").symlink_to(elsewhere / "s.csv")
    assert len(read_scenario(folder).network) == 4


def test_given_segments_replace_the_rule_and_lose_those_over_a_zone(scenario_with):
    folder = scenario_with(
        with_line('segments = "segments.csv"'),
        segments_csv="from,to,both\nbx,hm,\nqn,bk,no\n",
        zones_geojson=ZONES.replace("-73.82", "-73.93")
        .replace("-73.75", "-73.86")
        .replace("40.62", "40.72")
        .replace("40.66", "40.75"),
    )
    scenario = read_scenario(folder)
    ids = [station.id for station in scenario.network.stations]
    assert {(ids[a], ids[b]) for a, b in zip(scenario.network.tail, scenario.network.head, strict=True)} == {
        ("bx", "hm"),
        ("hm", "bx"),
    }
    assert "1 given segments cross a no-fly zone and are ignored" in scenario.warnings


def test_a_station_without_pads_needs_no_load(scenario_with):
    rows = "".join(f"{name},{hour},2,60\n" for name in ("bx", "hm", "qn") for hour in range(168))
    folder = scenario_with(stations_csv=STATIONS.replace("20,5", "20,0"), load_csv=LOAD.split("\n", 1)[0] + "\n" + rows)
    assert read_scenario(folder).load.arrivals_per_s[3].sum() == 0.0


def test_more_load_than_pads_is_warned_of(scenario_with):
    (warning,) = read_scenario(scenario_with(load_csv=LOAD.replace(",2,60", ",9,60"))).warnings
    assert "more load than the pads can serve" in warning


# --- what may be wrong --------------------------------------------------------------------------------------------


def test_faults_of_all_parts_are_said_at_once(scenario_with):
    folder = scenario_with(
        lambda text: text.replace("cruise_height_m = 60", "cruise_height_m = -60").replace('"UTC"', '"Mars/Base"'),
        stations_csv=STATIONS + "bk,Again,95,-73.9,1,5\n",
        drones_toml=FLEET + "wind_limit_mps = nan\n",
        zones_geojson='{"type": "FeatureCollection", "features": [{}]}',
        load_csv=LOAD + "*,168,2,60\n",
    )
    said = said_of(folder)
    for part in (
        "stations.csv:6: lat: latitude out of range",
        "stations.csv:6: id: two stations",
        "drones.toml: drone[0].wind_limit",
    ):
        assert any(line.startswith(part) for line in said), part
    assert any(line.startswith("zones.geojson: features[0]: geometry: is not a polygon") for line in said)
    assert any(line.startswith("scenario.toml: flight.cruise_height_m: out of range (got '-60')") for line in said)
    assert any(line.startswith("scenario.toml: wind.time_zone: no such time zone (got 'Mars/Base')") for line in said)
    assert len(said) == 6  # the load is read against the stations, so it waits for them


def test_a_wrong_load_and_a_wrong_wind_are_said_at_once(scenario_with):
    said = said_of(scenario_with(load_csv=LOAD + "*,168,2,60\n", wind_csv=wind_rows() + "2013-07-20 00:00,fast,10\n"))
    assert [line.split(":")[0] for line in said] == ["wind.csv", "load.csv"]


def test_a_wrong_forecast_is_said_when_the_scenario_is_read_and_not_first_when_it_is_used(scenario_with):
    rows = "time,site,member,speed_mps,from_deg\n2026-07-10T00:00Z,JFK,a,-3,10\n2026-07-10T01:00Z,LGA,a,3,10\n"
    said = said_of(scenario_with(with_line('forecast = "forecast.csv"', "[wind]"), forecast_csv=rows))
    assert {line.split(":")[0] for line in said} == {"forecast.csv"}
    assert any("LGA" in line for line in said)
    assert any("-3" in line for line in said)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere", "no such folder; skyway scenario init DIR"),
        ("empty", "the folder has no scenario.toml; skyway scenario init DIR"),
        ("file.csv", "is not a scenario folder; skyway scenario init DIR"),
        ("other.toml", "no such folder"),
        ("x" * 300, "cannot be read: File name too long"),
        ("a\0b", "no such folder"),
    ],
)
def test_a_scenario_that_is_not_there_says_how_to_begin_one(tmp_path, name, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file.csv").write_text("x")
    with pytest.raises(InputError, match=said):
        read_scenario(tmp_path / name)


def test_a_folder_without_its_files_names_each(scenario_with):
    folder = scenario_with(**{name.replace(".", "_"): None for name in PARTS if name != "scenario.toml"})
    assert said_of(folder) == [
        f"scenario.toml: {field}: no such file (got '{name}')"
        for field, name in [
            ("network.stations", "stations.csv"),
            ("network.zones", "zones.geojson"),
            ("drones.fleet", "drones.toml"),
            ("wind.history", "wind.csv"),
            ("load.file", "load.csv"),
        ]
    ]


def test_a_folder_a_pipe_and_a_dead_link_are_no_files(scenario_with):
    folder = scenario_with(stations_csv=None, drones_toml=None, wind_csv=None)
    (folder / "stations.csv").mkdir()
    (folder / "drones.toml").symlink_to(folder / "nowhere")
    os.mkfifo(folder / "wind.csv")
    assert said_of(folder) == [
        "scenario.toml: network.stations: is a folder, not a file (got 'stations.csv')",
        "scenario.toml: drones.fleet: no such file (got 'drones.toml')",
        "scenario.toml: wind.history: no such file (got 'wind.csv')",
    ]


@pytest.mark.parametrize("part", ["stations.csv", "wind.csv", "load.csv", "zones.geojson", "drones.toml"])
def test_200_megabytes_are_refused(scenario_with, part):
    folder = scenario_with()
    with (folder / part).open("r+b") as stream:
        stream.truncate(200_000_000)
    (said,) = said_of(folder)
    assert f"is larger than 67 MB (got '{part}'); cut it" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (instead('"skyway.scenario/1"', '"skyway.scenario/9"'), "schema: is not known (got 'skyway.scenario/9')"),
        (instead('name = "Test"', "name = 3"), "name: must be a text that is not empty (got '3')"),
        (instead('name = "Test"', 'name = "a\\u001b[2J"'), "name: must be one line of plain text"),
        (instead("America/New_York", "America/NewYork"), "timezone: is not a time zone (got 'America/NewYork')"),
        (instead("America/New_York", "../../etc/passwd"), "timezone: is not a time zone (got '../../etc/passwd')"),
        (instead("America/New_York", "America"), "timezone: is not a time zone (got 'America')"),
        (instead("max_length_m = 13000", "max_length_km = 13"), "network.max_length_km: is not a field here; did you mean max_length_m?"),
        (instead("max_length_m = 13000", 'max_length_m = "13 km"'), "network.max_length_m: must be a number (got '13 km')"),
        (instead("max_length_m = 13000", "max_length_m = 0"), "network.max_length_m: out of range (got '0'); must be above 0"),
        (instead("max_length_m = 13000", "max_length_m = nan"), "network.max_length_m: must be a number (got 'nan')"),
        (with_line('rule = "gabrial"'), "network.rule: is not known (got 'gabrial'); one of max-length, nearest, gabriel"),
        (with_line("nearest = 2.5"), "network.nearest: must be a whole number (got '2.5')"),
        (with_line("nearest = 0"), "network.nearest: out of range (got '0'); must be from 1 to 1000"),
        (with_line("pads = -1"), "network.pads: out of range (got '-1'); must be from 0 to 10000"),
        (with_line("holding_spots = true"), "network.holding_spots: must be a whole number (got 'True')"),
        (with_line("columns = {latt = 'x'}"), "network.columns.latt: is not a field here; did you mean lat?"),
        (with_line("columns = {lat = 'latitude'}"), "stations.csv:1: latitude: column is missing; the header has id, name"),
        (with_line("columns = 3"), "network.columns: must be a table (got '3')"),
        (instead('stations = "stations.csv"', ""), "network.stations: is missing"),
        (instead('stations = "stations.csv"', "stations = 3"), "network.stations: must be a text that is not empty (got '3')"),
        (instead('stations = "stations.csv"', f'stations = "{"x" * 300}"'), "network.stations: cannot be read: File name too long"),
        (instead("[drones]", "[fleet]"), "fleet: is not a field here; known: airspace, costs, drones, flight, "),
        (instead("cruise_height_m = 60", "climb_rate_mps = 0"), "flight.climb_rate_mps: out of range (got '0')"),
        (instead("cruise_height_m = 60", "cruise_height_ft = 200"), "flight.cruise_height_ft: is not a field here; did you mean cruise_height_m?"),
        (instead('"m/s"', '"m/h"'), "wind.speed_unit: is not known (got 'm/h'); one of m/s, "),
        (instead('"UTC"', '"Utopia"'), "wind.time_zone: no such time zone (got 'Utopia')"),
        (instead('time_zone = "UTC"', 'time_format = "when"'), "wind.time_format: not a time format (got 'when')"),
        (instead('speed = "speed"', 'speed = "windspeed"'), "wind.csv:1"),
        (instead('speed = "speed"', 'missing = "NA"'), "wind.missing: must be a list of texts (got 'NA')"),
        (instead("lat = 40.64", "lat = 140.64"), "wind.sites[0].lat: out of range (got '140.64')"),
        (instead("lat = 40.64", ""), "wind.sites[0].lat: is missing"),
        (instead("lat = 40.64", "lat = 40.64\nheight = 10"), "wind.sites[0].height: is not a field here; known: icao, id, lat, lon"),
        (instead('[[wind.sites]]\nid = "JFK"\nlat = 40.64\nlon = -73.76', ""), "wind.sites: is missing; give the places of measurement"),
        (instead('file = "load.csv"', 'file = "load.csv"\noccupancy = "load.csv"'), "load.occupancy: file and occupancy are both given"),
        (with_line("mean_charging_min = 0", "[load]"), "load.mean_charging_min: out of range (got '0')"),
        (instead("[load]", "[[load]]"), "load: must be a table"),
    ],
)  # fmt: skip
def test_each_wrong_field_of_a_scenario_is_a_clear_line(scenario_with, change, said):
    lines = said_of(scenario_with(change))
    wanted = said if said.startswith(("stations.csv", "wind.csv")) else f"scenario.toml: {said}"
    assert any(line.startswith(wanted) for line in lines), lines
    assert len(lines) <= 2, lines


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize(
    "data", [b"", b"\0\0\0\0", b"\xff\xfe\x00i\x00d", b"Z\xfcrich,1,2\n", b"\x1f\x8b\x08\x00", b"{", b"a,b\n1,2\n"]
)
def test_no_rubbish_in_any_part_crashes(scenario_with, part, data):
    lines = said_of(scenario_with(**{part.replace(".", "_"): data}))
    assert all(part in line or "scenario.toml" in line or str(line).startswith("wind") for line in lines)


def test_a_broken_scenario_file_names_the_line(scenario_with):
    (said,) = said_of(scenario_with(instead("[flight]", "[flight")))
    assert said.startswith("scenario.toml:10: is not TOML")


# --- parts that do not fit together ---------------------------------------------------------------------------------


def swap(row: str) -> str:
    cells = row.split(",")
    cells[2], cells[3] = cells[3], cells[2]
    return ",".join(cells)


HEADER, *ROWS = STATIONS.splitlines()


def stations_text(rows) -> str:
    return "\n".join([HEADER, *rows]) + "\n"


def test_one_station_with_latitude_and_longitude_swapped_is_found(scenario_with):
    rows = [ROWS[0], swap(ROWS[1]), *ROWS[2:]]
    assert said_of(scenario_with(stations_csv=stations_text(rows))) == [
        "stations.csv: station hm: lat and lon look swapped (got '-73.94,40.81')"
    ]


def test_one_swapped_station_is_found_without_wind_too(scenario_with):
    folder = scenario_with(
        lambda _: 'schema = "skyway.scenario/1"\n[network]\nstations = "stations.csv"\n',
        stations_csv=stations_text([ROWS[0], swap(ROWS[1]), *ROWS[2:]]),
    )
    assert said_of(folder) == ["stations.csv: station hm: lat and lon look swapped (got '-73.94,40.81')"]


def test_all_stations_swapped_are_found_by_the_wind_sites(scenario_with):
    (said,) = said_of(
        scenario_with(
            stations_csv=stations_text(map(swap, ROWS)), zones_geojson='{"type": "FeatureCollection", "features": []}'
        )
    )
    assert said.startswith(
        "stations.csv: lat: lat and lon look swapped in all stations (got '-73.9,40.85'); compare them with"
    )


def test_a_swapped_wind_site_among_right_ones_is_found(scenario_with):
    second = '\n[[wind.sites]]\nid = "LGA"\nlat = -73.88\nlon = 40.78\n[load]'
    rows = wind_rows().splitlines()
    both = [f"{row},{'site' if not n else ('JFK', 'LGA')[n % 2]}" for n, row in enumerate(rows)]
    folder = scenario_with(
        lambda text: text.replace("\n[load]", second).replace('speed = "speed"', 'speed = "speed"\nsite = "site"'),
        wind_csv="\n".join(both) + "\n",
    )
    assert said_of(folder) == ["scenario.toml: wind.sites[1].lat: lat and lon look swapped (got '-73.88,40.78')"]


def test_swapped_stations_off_the_scale_are_out_of_range(scenario_with):
    folder = scenario_with(stations_csv="id,lat,lon\na,145.1,-37.7\nb,144.9,-37.8\n")
    assert said_of(folder) == [
        f"stations.csv:{line}: lat: latitude out of range (got '{lat}'); lat and lon may be swapped"
        for line, lat in ((2, 145.1), (3, 144.9))
    ]


def test_a_zone_with_latitude_first_is_found(scenario_with):
    turned = "[40.62,-73.82],[40.62,-73.75],[40.66,-73.75],[40.66,-73.82],[40.62,-73.82]"
    folder = scenario_with(zones_geojson=ZONES[: ZONES.index("[[[") + 2] + turned + "]]}}]}")
    assert said_of(folder) == [
        "zones.geojson: JFK: lat and lon look swapped (got '-73.785,40.64'); GeoJSON has longitude first, then latitude; or lat and lon of the stations are swapped"
    ]


def test_a_station_inside_a_no_fly_zone_is_a_fault(scenario_with):
    folder = scenario_with(stations_csv=STATIONS + "jfk,Airport,40.64,-73.78,4,5\n")
    assert said_of(folder) == ["stations.csv: station jfk: lies in the no-fly zone JFK"]


def _count(lat: float, lon: float) -> int:
    places = [tuple(map(float, row.split(",")[2:4])) for row in ROWS]
    return sum(geodesy.distance_m(lat, lon, *place) > 300_000.0 for place in places)


def test_wind_from_far_away_is_a_warning(scenario_with):
    boston = scenario_with(
        lambda text: text.replace("lat = 40.64", "lat = 42.36").replace("lon = -73.76", "lon = -70.5")
    )
    (warning,) = read_scenario(boston).warnings
    farthest = geodesy.distance_m(42.36, -70.5, 40.70, -73.92) / 1000.0
    assert warning == (
        f"{_count(42.36, -70.5)} stations lie more than 300 km from every wind site (farthest: station bk, {farthest:.1f} km)"
    )


def test_a_station_far_from_the_others_is_a_warning(scenario_with):
    scenario = read_scenario(scenario_with(stations_csv=STATIONS + "la,Los Angeles,34.05,-118.24,90,5\n"))
    said = "\n".join(scenario.warnings)
    assert "station la lies 39" in said
    assert "1 stations lie more than 300 km from every wind site (farthest: station la, 39" in said
    assert "the network falls into 2 parts that no segment joins (apart: la)" in said


def test_kilometres_given_as_metres_are_suspected(scenario_with):
    (warning,) = read_scenario(scenario_with(instead("13000", "13"))).warnings
    assert warning == "no segment joins any stations: is network.max_length_m long enough, in metres?"


def test_knots_given_as_metres_per_second_are_suspected(scenario_with):
    fast = "\n".join(row.replace(",", ",3", 1) if n else row for n, row in enumerate(wind_rows().splitlines()))
    (warning,) = read_scenario(scenario_with(wind_csv=fast)).warnings
    assert "is m/s really the unit?" in warning


def test_two_stations_at_one_place_are_a_warning(scenario_with):
    (warning,) = read_scenario(scenario_with(stations_csv=STATIONS + "b2,Bronx two,40.85,-73.90,10,5\n")).warnings
    assert warning == "stations that stand at the same place, no segment joins them: bx, b2"
