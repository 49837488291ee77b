"""What was measured is read as it was meant: signs, units, calm, gaps and every kind of bad row."""

import csv
import gzip
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.history import WindHistory, WindSite, read_history
from skyway.models.wind.triangle import speed_from

NEW_YORK = (
    WindSite("EWR", 40.6925, -74.1687),
    WindSite("JFK", 40.6398, -73.7789),
    WindSite("LGA", 40.7772, -73.8726),
)
NYC = WindColumns(
    time="time_hour",
    site="origin",
    speed="wind_speed",
    from_="wind_dir",
    speed_unit="mph",
    calm="direction-0",
)
LONDON = WindColumns(time="time_utc", site=None, speed="wind_speed_mps", from_="wind_from_deg")
MELBOURNE = WindColumns(
    site=None, speed="windspeed", from_="winddir", speed_unit="km/h", time_zone="Australia/Melbourne"
)
PLACE = (WindSite("here", 51.5, -0.15),)
ALONE = WindColumns(site=None)
PAIR = (WindSite("a", 40.0, -74.0), WindSite("b", 40.1, -74.0))


@pytest.fixture(scope="module")
def nyc_file(shared_data: Path) -> Path:
    return shared_data / "wind" / "nyc_2013_hourly_wind.csv.gz"


@pytest.fixture(scope="module")
def nyc(nyc_file: Path) -> WindHistory:
    return read_history(nyc_file, NYC, NEW_YORK, 10.0)


@pytest.fixture(scope="module")
def london(shared_data: Path) -> WindHistory:
    return read_history(shared_data / "wind" / "london_1998_2005_hourly_wind.csv.gz", LONDON, PLACE, 10.0)


@pytest.fixture(scope="module")
def melbourne(shared_data: Path) -> WindHistory:
    return read_history(shared_data / "wind" / "melbourne_2023_hourly_weather.csv", MELBOURNE, PLACE, 10.0)


def read(folder, *rows, columns=ALONE, sites=PLACE, header="time,speed_mps,from_deg"):
    path = folder / "wind.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return read_history(path, columns, sites, 10.0)


def read_pair(folder, *rows):
    header = "time,site,speed_mps,from_deg"
    return read(folder, *rows, columns=WindColumns(), sites=PAIR, header=header)


def faults(folder, *rows, **how):
    with pytest.raises(InputError) as caught:
        read(folder, *rows, **how)
    return caught.value.faults


def hour(number: int) -> str:
    return f"2013-07-{1 + number // 24:02d}T{number % 24:02d}:00Z"


def test_new_york_has_the_calm_variable_missing_and_absurd_rows_its_readme_tells_of(nyc):
    assert (nyc.counts.rows, nyc.counts.calm, nyc.counts.variable, nyc.counts.absurd) == (26115, 1256, 456, 1)
    assert nyc.counts.missing == 4
    assert nyc.north.shape == (8730, 3)
    assert nyc.start_s == datetime(2013, 1, 1, 6, tzinfo=UTC).timestamp()


def test_the_absurd_row_of_newark_is_dropped_and_told_with_its_line_and_value(nyc):
    (warning,) = [text for text in nyc.warnings if "dropped" in text]
    assert "75 m/s: 1, first" in warning
    assert "line 1011: 1048.36058 mph" in warning
    slot = int((datetime(2013, 2, 12, 8, tzinfo=UTC).timestamp() - nyc.start_s) // 3600)
    assert np.hypot(nyc.north, nyc.east)[np.isfinite(nyc.north)].max() < 30.0
    assert np.isfinite(nyc.north[slot, 0])


def test_a_wind_from_the_west_moves_the_air_towards_the_east(nyc):
    assert nyc.east[0, 0] == pytest.approx(10.35702 * 0.44704)
    assert nyc.north[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_every_plain_row_of_new_york_comes_back_from_its_slot(nyc, nyc_file):
    with gzip.open(nyc_file, "rt") as stream:
        rows = [row for row in csv.DictReader(stream) if "NA" not in (row["wind_dir"], row["wind_speed"])]
    for row in rows[::97]:
        slot = int((datetime.fromisoformat(row["time_hour"]).timestamp() - nyc.start_s) // 3600)
        site = [place.id for place in nyc.sites].index(row["origin"])
        speed, direction = speed_from(nyc.north[slot, site], nyc.east[slot, site])
        assert speed == pytest.approx(float(row["wind_speed"]) * 0.44704)
        if speed > 0.0:
            assert np.cos(np.radians(direction - float(row["wind_dir"]))) == pytest.approx(1.0)


def test_variable_wind_keeps_its_speed_and_takes_a_direction_from_around_it(nyc):
    assert nyc.counts.directions_filled == nyc.counts.variable


def test_few_hours_of_new_york_stay_empty_and_they_are_counted(nyc):
    assert np.isnan(nyc.north).sum() == nyc.counts.hours_empty < 40
    assert any(f"without wind: {nyc.counts.hours_empty}" in warning for warning in nyc.warnings)


def test_in_london_direction_0_is_north_and_not_calm(london):
    assert (london.counts.rows, london.counts.missing) == (65533, 632)
    with_direction_0 = 608 - 13 - 11  # 13 of the rows are calm, 11 have no speed
    misread = WindColumns(time="time_utc", site=None, speed="wind_speed_mps", from_="wind_from_deg", calm="direction-0")
    wrong = read_history(Path(london.source), misread, PLACE, 10.0)
    assert wrong.counts.variable - london.counts.variable == with_direction_0
    assert any('"speed-0"' in warning and f"variable: {with_direction_0}" in warning for warning in wrong.warnings)
    assert not any("direction 0" in warning for warning in london.warnings)


def test_melbourne_is_read_from_km_per_hour_and_local_time(melbourne):
    assert melbourne.start_s == datetime(2023, 3, 31, 13, tzinfo=UTC).timestamp()
    speed, direction = speed_from(melbourne.north[0, 0], melbourne.east[0, 0])
    assert speed == pytest.approx(9.4 / 3.6)
    assert direction == pytest.approx(268.0)


def test_the_hour_that_melbourne_repeats_but_its_record_does_not_is_interpolated(melbourne):
    assert len(melbourne) == 4392 + 1
    assert melbourne.counts.hours_interpolated == 1
    assert melbourne.complete.all()
    assert any("the clock repeats in Australia/Melbourne: 1;" in warning for warning in melbourne.warnings)


def test_an_hour_given_twice_when_the_clock_repeats_it_becomes_two_hours(tmp_path):
    columns = WindColumns(site=None, time_zone="Australia/Melbourne")
    rows = [
        "2023-04-02 01:00,1,90",
        "2023-04-02 02:00,2,90",
        "2023-04-02 02:00,3,90",
        "2023-04-02 03:00,4,90",
    ]
    history = read(tmp_path, *rows, columns=columns)
    assert np.allclose(history.east[:, 0], [-1, -2, -3, -4])


def test_a_time_that_the_clock_skips_is_taken_as_the_hour_after_with_a_warning(tmp_path):
    columns = WindColumns(site=None, time_zone="Australia/Melbourne")
    history = read(tmp_path, "2023-10-01 01:00,1,90", "2023-10-01 02:30,2,90", columns=columns)
    assert np.allclose(history.east[:, 0], [-1, -2])
    assert "the clock skips in Australia/Melbourne: 1," in history.warnings[0]


def test_times_with_an_offset_are_taken_as_they_are_whatever_the_zone(tmp_path):
    columns = WindColumns(site=None, time_zone="America/New_York")
    history = read(tmp_path, "2013-07-10T14:00+02:00,3,270", columns=columns)
    assert history.start_s == datetime(2013, 7, 10, 12, tzinfo=UTC).timestamp()


def test_times_in_a_format_of_their_own_are_read_by_it(tmp_path):
    columns = WindColumns(site=None, time_zone="UTC", time_format="%d/%m/%Y %H:%M")
    history = read(tmp_path, "10/07/2013 14:00,3,270", columns=columns)
    assert history.start_s == datetime(2013, 7, 10, 14, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("unit", "factor"), [("m/s", 1.0), ("km/h", 1 / 3.6), ("mph", 0.44704), ("knots", 1852 / 3600)]
)
def test_each_unit_becomes_metres_per_second(tmp_path, unit, factor):
    history = read(tmp_path, f"{hour(0)},10,180", columns=WindColumns(site=None, speed_unit=unit))
    assert history.north[0, 0] == pytest.approx(10.0 * factor)


def test_several_rows_of_an_hour_are_averaged_as_vectors(tmp_path):
    history = read(tmp_path, "2013-07-01T00:05Z,4,350", "2013-07-01T00:55Z,4,10")
    assert len(history) == 1
    assert history.north[0, 0] == pytest.approx(-4.0 * np.cos(np.radians(10.0)))
    assert history.east[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_rows_may_be_unsorted_and_doubled(tmp_path):
    rows = [f"{hour(number)},{number + 1},90" for number in range(6)]
    sorted_once = read(tmp_path, *rows)
    shuffled = read(tmp_path, *(rows[number] for number in (3, 0, 5, 1, 2, 4, 0, 3)))
    assert np.allclose(shuffled.east, sorted_once.east)


def test_calm_needs_no_direction(tmp_path):
    history = read(tmp_path, f"{hour(0)},0,NA", f"{hour(1)},0,0", f"{hour(2)},0,VRB")
    assert np.all(history.north == 0.0)
    assert np.all(history.east == 0.0)
    assert history.counts.calm == 3


def test_a_gap_of_three_hours_is_bridged_by_a_straight_line_of_vectors(tmp_path):
    history = read(tmp_path, f"{hour(0)},4,90", f"{hour(4)},4,180")
    assert np.allclose(history.east[:, 0], [-4, -3, -2, -1, 0])
    assert np.allclose(history.north[:, 0], [0, 1, 2, 3, 4])


def test_a_gap_of_four_hours_stays_empty_where_there_is_no_other_site(tmp_path):
    history = read(tmp_path, f"{hour(0)},4,90", f"{hour(5)},4,180")
    assert np.isnan(history.north[1:5]).all()
    assert history.counts.hours_empty == 4
    assert any("without wind: 4" in warning for warning in history.warnings)


def test_a_long_gap_is_filled_from_the_other_site(tmp_path):
    rows = [f"{hour(number)},a,5,180" for number in range(12)]
    history = read_pair(tmp_path, *rows, f"{hour(0)},b,3,90", f"{hour(11)},b,3,90")
    assert history.complete.all()
    assert np.allclose(history.north[1:11, 1], 5.0)
    assert history.counts.hours_borrowed == 10


def test_nearer_sites_count_by_the_inverse_square_of_the_distance(tmp_path):
    sites = (WindSite("a", 0.0, 0.0), WindSite("b", 0.0, 1.0), WindSite("c", 0.0, 3.0))
    header = "time,site,speed_mps,from_deg"
    rows = (f"{hour(0)},b,10,270", f"{hour(0)},c,0,0")
    history = read(tmp_path, *rows, columns=WindColumns(), sites=sites, header=header)
    assert history.east[0, 0] == pytest.approx(10.0 * 9 / 10, rel=1e-6)


def test_a_variable_wind_between_known_ones_keeps_its_speed(tmp_path):
    history = read(tmp_path, f"{hour(0)},4,90", f"{hour(1)},7,VRB", f"{hour(2)},4,90")
    assert history.east[1, 0] == pytest.approx(-7.0)


def test_a_long_variable_wind_takes_its_direction_from_the_other_site(tmp_path):
    rows = [f"{hour(number)},a,5,180" for number in range(6)]
    history = read_pair(tmp_path, *rows, *(f"{hour(number)},b,2,VRB" for number in range(6)))
    assert np.allclose(history.north[:, 1], 2.0)
    assert history.counts.directions_filled == 6


def test_a_variable_wind_without_any_neighbour_is_missing(tmp_path):
    history = read(tmp_path, f"{hour(0)},4,90", f"{hour(1)},7,VRB")
    assert np.isnan(history.north[1, 0])


def test_direction_0_with_a_speed_is_variable_where_0_says_calm(tmp_path):
    columns = WindColumns(site=None, calm="direction-0")
    history = read(tmp_path, f"{hour(0)},4,90", f"{hour(1)},7,0", f"{hour(2)},4,90", columns=columns)
    assert history.east[1, 0] == pytest.approx(-7.0)


def test_a_median_of_a_storm_asks_whether_the_unit_is_right(tmp_path):
    history = read(tmp_path, f"{hour(0)},18,90", f"{hour(1)},25,80")
    assert any("is m/s really the unit?" in warning for warning in history.warnings)


def test_a_site_without_rows_borrows_its_wind_and_says_so(tmp_path):
    history = read_pair(tmp_path, f"{hour(0)},a,5,180")
    assert history.north[0, 1] == pytest.approx(5.0)
    assert any("no row of b" in warning for warning in history.warnings)


@given(
    winds=st.lists(
        st.tuples(st.floats(0.0, 60.0), st.one_of(st.none(), st.floats(0.0, 360.0))), min_size=2, max_size=12
    )
)
def test_filling_never_makes_a_wind_stronger_than_any_measured(tmp_path_factory, winds):
    folder = tmp_path_factory.mktemp("record")
    rows = [f"{hour(n)},{s!r},{'NA' if d is None else repr(d)}" for n, (s, d) in enumerate(winds)]
    if all(speed > 0.0 and direction is None for speed, direction in winds):
        return
    history = read(folder, *rows)
    speed = np.hypot(history.north, history.east)
    assert np.nanmax(speed) <= max(s for s, _ in winds) + 1e-9


@pytest.mark.parametrize(
    ("row", "field", "problem", "remedy"),
    [
        ("2013-07-01T00:00Z,-1,90", "speed_mps", "negative speed", "list it under missing"),
        ("2013-07-01T00:00Z,NaN,90", "speed_mps", "not a finite number", "under missing"),
        ("2013-07-01T00:00Z,inf,90", "speed_mps", "not a finite number", "under missing"),
        ('2013-07-01T00:00Z,"3,5",90', "speed_mps", "not a number", "decimals after a point"),
        ("2013-07-01T00:00Z,fast,90", "speed_mps", "not a number", "under missing"),
        ("2013-07-01T00:00Z,1_0,90", "speed_mps", "not a finite number", "under missing"),
        ("2013-07-01T00:00Z,3,361", "from_deg", "direction out of range", "0 to 360"),
        ("2013-07-01T00:00Z,3,-10", "from_deg", "direction out of range", "0 to 360"),
        ("2013-07-01T00:00Z,3,990", "from_deg", "direction out of range", "under variable"),
        ("2013-07-01T00:00Z,3,north", "from_deg", "not a number", "a number"),
        ("2013-07-01T00:00,3,90", "time", "no UTC offset", 'time_zone = "UTC"'),
        ("yesterday,3,90", "time", "not an ISO 8601 time", "2013-07-10T18:00Z"),
        ("9999-12-31T23:59Z,3,90", "time", "out of range", "to 2200"),
        (",3,90", "time", "not an ISO 8601 time", "2013-07-10T18:00Z"),
        ("2013-02-30T00:00Z,3,90", "time", "not an ISO 8601 time", "2013-07-10T18:00Z"),
        ("2013-07-01T00:00Z,3", None, "2 cells where the header has 3", "one cell for each column"),
        ("2013-07-01T00:00Z,3,90,1", None, "4 cells where the header has 3", "one cell for each column"),
    ],
)
def test_a_bad_row_is_named_with_line_field_value_and_remedy(tmp_path, row, field, problem, remedy):
    (fault,) = faults(tmp_path, f"{hour(0)},3,90", row)
    assert (fault.line, fault.field) == (3, field)
    assert problem in fault.problem
    assert remedy in fault.remedy
    assert fault.file == str(tmp_path / "wind.csv")


def test_all_faults_come_at_once_in_the_order_of_the_lines(tmp_path):
    found = faults(tmp_path, "x,3,90", f"{hour(0)},-3,400", f"{hour(1)},3")
    assert [fault.line for fault in found] == [2, 3, 3, 4]


def test_beyond_twenty_faults_the_rest_is_counted(tmp_path):
    found = faults(tmp_path, *(f"{hour(0)},-{number},400" for number in range(1, 6001)))
    assert len(found) == 21
    assert "and 11,980 more faults" in found[-1].problem
    assert found[0].line == 2


def test_a_file_of_nothing_but_faults_is_not_read_to_its_end(tmp_path):
    found = faults(tmp_path, *["x,y,z"] * 60_000)
    assert "more faults in the lines read so far" in found[-1].problem


def test_a_record_of_more_than_five_million_rows_is_refused(tmp_path):
    path = tmp_path / "wind.csv"
    path.write_text("1\n" * 5_000_002)
    with pytest.raises(InputError, match="more than 5,000,000 rows"):
        read_history(path, ALONE, PLACE, 10.0)


def test_an_unknown_site_is_named_once_with_the_sites_there_are(tmp_path):
    with pytest.raises(InputError, match=r"wind\.csv:2: site: unknown site .*'EWR'.*the sites are a, b") as caught:
        read_pair(tmp_path, f"{hour(0)},EWR,3,90", f"{hour(1)},EWR,3,90")
    assert len(caught.value.faults) == 1


def test_a_record_separated_by_semicolons_is_the_same(tmp_path):
    table = "time,speed_mps,from_deg\n2013-07-01T00:00Z,2.5,30\n2013-07-01T01:00Z,3,40\n"
    found = []
    for name, text in (("commas.csv", table), ("semicolons.csv", table.replace(",", ";"))):
        (tmp_path / name).write_text(text)
        found.append(read_history(tmp_path / name, ALONE, PLACE, 10.0))
    assert np.array_equal(found[0].north, found[1].north)
    assert np.isfinite(found[0].north).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("time,speed_mps,from_deg\n", "has a header but no rows"),
        (
            "time,speed,from\n1,2,3\n",
            r"speed_mps: no such column; the file has the columns time, speed, from",
        ),
        ("time\tspeed_mps\tfrom_deg\n1\t2\t3\n", "separated by tabs"),
        (
            "time;speed_mps;from_deg\n2013-07-01T00:00Z;2,5;3\n",
            "wind.csv:2: has a decimal comma between semicolons .*2,5",
        ),
        ("time,speed_mps,speed_mps,from_deg\n1,2,2,3\n", "the column appears twice"),
        ("time,speed_mps,from_deg\n2013-07-01T00:00Z,NA,NA\n", "no row with both a speed and a direction"),
        ("time,speed_mps,from_deg\n1850-01-01T00:00Z,1,1\n2013-01-01T00:00Z,1,1\n", "too long a time"),
        ('time,speed_mps,from_deg\n"' + "x" * 200_000, "is not CSV"),
    ],
)
def test_a_file_that_is_no_record_says_why(tmp_path, text, message):
    path = tmp_path / "wind.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_history(path, ALONE, PLACE, 10.0)


def test_a_file_that_is_not_there_or_not_text_says_so(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_history(tmp_path / "none.csv", ALONE, PLACE, 10.0)
    with pytest.raises(InputError, match="is a folder"):
        read_history(tmp_path, ALONE, PLACE, 10.0)
    (tmp_path / "wind.csv").write_bytes(b"time,\xff\xfe")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_history(tmp_path / "wind.csv", ALONE, PLACE, 10.0)


def test_a_record_of_200_mb_is_refused(tmp_path):
    path = tmp_path / "wind.csv"
    with path.open("wb") as stream:
        stream.truncate(200_000_000)
    with pytest.raises(InputError, match="is larger than 64 MB"):
        read_history(path, ALONE, PLACE, 10.0)


def test_every_wrong_setting_is_told_at_once():
    with pytest.raises(InputError) as caught:
        WindColumns(
            speed_unit="furlongs",
            calm="never",
            time_zone="Mars/Olympus",
            time_format="%Q",
            max_speed_mps=-1.0,
        )
    fields = {fault.field for fault in caught.value.faults}
    assert fields == {f"wind.{k}" for k in ("speed_unit", "calm", "time_zone", "time_format", "max_speed_mps")}


def test_sites_must_be_there_once_each_and_on_earth(tmp_path):
    (tmp_path / "wind.csv").write_text("time,speed_mps,from_deg\n")
    for sites, message in (
        ((), "there is no wind site"),
        ((PLACE[0], PLACE[0]), "same id"),
        ((WindSite("x", -74.0, 140.0), WindSite("y", 140.0, -74.0)), "may be swapped"),
        (PAIR, "does not name its site"),
    ):
        with pytest.raises(InputError, match=message):
            read_history(tmp_path / "wind.csv", ALONE, sites, 10.0)
    with pytest.raises(InputError, match="not a height"):
        read_history(tmp_path / "wind.csv", ALONE, PLACE, 0.0)
    with pytest.raises(InputError, match="unknown site"):
        read_history(tmp_path / "wind.csv", WindColumns(site=None, default_site="z"), PAIR, 10.0)
