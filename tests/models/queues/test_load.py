"""The load of other drones: read from both kinds of files, on the local clock, with every fault said."""

import gzip
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from benchmarks.cases.loads import scaled_to
from skyway.models.base.errors import InputError
from skyway.models.queues.load import IDLE_CHARGING_S, PadLoad, hours_of_week
from skyway.models.queues.load_files import read_load, read_occupancy

NEW_YORK = "America/New_York"
HEADER = "station,hour_of_week,arrivals_per_h,mean_charging_min"


def week(station: str, arrivals: float = 3.0, charging: float = 60.0, skip: tuple[int, ...] = ()) -> list[str]:
    return [f"{station},{hour},{arrivals},{charging}" for hour in range(168) if hour not in skip]


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n")
    return path


def ramp() -> PadLoad:
    arrivals = np.vstack((np.arange(168.0), np.ones(168))) / 3600.0 / 50.0
    return PadLoad(arrivals, np.full((2, 168), 1800.0), NEW_YORK)


def posix(*local: int) -> float:
    return datetime(*local, tzinfo=ZoneInfo(NEW_YORK)).timestamp()


def faults_of(call) -> list[str]:
    with pytest.raises(InputError) as caught:
        call()
    return [str(fault) for fault in caught.value.faults]


def test_the_week_begins_on_monday_at_midnight_local_time():
    assert hours_of_week(NEW_YORK, posix(2013, 7, 8, 0), 3).tolist() == [0, 1, 2]
    assert hours_of_week(NEW_YORK, posix(2013, 7, 14, 23), 2).tolist() == [167, 0]


def test_the_first_hour_is_the_one_that_holds_the_start():
    assert hours_of_week(NEW_YORK, posix(2013, 7, 8, 5, 59, 59), 1).tolist() == [5]


def test_the_hour_that_comes_twice_in_autumn_is_lived_twice():
    sunday = hours_of_week(NEW_YORK, posix(2013, 11, 3, 0), 5) - 6 * 24
    assert sunday.tolist() == [0, 1, 1, 2, 3]


def test_the_hour_that_is_skipped_in_spring_is_skipped():
    sunday = hours_of_week(NEW_YORK, posix(2013, 3, 10, 0), 4) - 6 * 24
    assert sunday.tolist() == [0, 1, 3, 4]


def test_a_zone_with_half_an_hour_uses_the_local_hour_in_which_the_utc_hour_begins():
    assert hours_of_week("Asia/Kolkata", 4 * 86400.0, 2).tolist() == [5, 6]  # Monday 1970-01-05, 05:30


def test_hourly_rates_follow_the_local_clock():
    arrivals, charging = ramp().hourly(0, posix(2013, 7, 8, 9, 30), 3)
    assert arrivals * 3600.0 * 50.0 == pytest.approx([9.0, 10.0, 11.0])
    assert charging.tolist() == [1800.0] * 3


def test_utilisation_is_busy_pads_over_pads_and_zero_where_nobody_recharges():
    utilisation = ramp().utilisation([5, 0])
    assert utilisation[0, 100] == pytest.approx(2.0 * 0.5 / 5)
    assert not utilisation[1].any()


def test_a_benchmark_load_has_the_utilisation_asked_for_also_where_nobody_came():
    load = scaled_to(ramp().extended(2), 0.8, [5, 2, 3, 0])
    assert load.utilisation([5, 2, 3, 0]).mean(axis=1) == pytest.approx([0.8, 0.8, 0.8, 0.0])
    assert load.arrivals_per_s[0, 100] == pytest.approx(2 * load.arrivals_per_s[0, 50])


def test_delivery_targets_join_without_load():
    load = ramp().extended(1)
    assert len(load) == 3
    assert not load.arrivals_per_s[2].any()
    assert len(PadLoad.none(4, NEW_YORK)) == 4


@pytest.mark.parametrize("name", ["Mars/Olympus", "../etc/passwd", "", "America"])
def test_an_unknown_time_zone_is_named(name):
    assert "unknown time zone" in faults_of(lambda: PadLoad.none(1, name))[0]


def test_a_load_with_impossible_numbers_is_refused():
    good = np.full((1, 168), 0.5)
    faults = faults_of(lambda: PadLoad(np.full((1, 168), np.nan), good, NEW_YORK))
    assert len(faults) == 2
    assert "shape" in faults_of(lambda: PadLoad(good[:, :24], good[:, :24], NEW_YORK))[0]


def test_a_load_file_is_read_in_the_order_of_the_network_and_its_star_fills_the_rest(tmp_path):
    rows = [*week("*", 2.0, 30.0), "b,5,12,45", "b,6,0,0"]
    load, warnings = read_load(write(tmp_path / "load.csv", HEADER, *rows), ["a", "b"], NEW_YORK)
    assert warnings == []
    assert load.arrivals_per_s[:, 5] * 3600 == pytest.approx([2.0, 12.0])
    assert load.mean_charging_s[:, 5].tolist() == [1800.0, 2700.0]
    assert load.mean_charging_s[1, 6] == IDLE_CHARGING_S


def test_columns_in_another_order_extra_columns_and_gzip_are_read(tmp_path):
    path = tmp_path / "load.csv.gz"
    lines = ["note,mean_charging_min,arrivals_per_h,hour_of_week,station"]
    lines += [f'"a, b",60,1,{hour},x' for hour in range(168)]
    path.write_bytes(gzip.compress(("\ufeff" + "\r\n".join(lines)).encode()))
    load, _ = read_load(path, ["x"], NEW_YORK)
    assert load.arrivals_per_s[0, 0] == pytest.approx(1 / 3600)


def test_more_load_than_the_pads_can_serve_is_a_warning(tmp_path):
    path = write(tmp_path / "load.csv", HEADER, *week("a", 6.0, 60.0), *week("b", 4.0, 60.0))
    _, warnings = read_load(path, ["a", "b"], NEW_YORK, pads=[5, 5])
    assert len(warnings) == 1
    assert "a (1.20)" in warnings[0]
    assert "b (" not in warnings[0]


def test_a_delivery_target_needs_no_rows(tmp_path):
    path = write(tmp_path / "load.csv", HEADER, *week("a"))
    load, _ = read_load(path, ["a", "target"], NEW_YORK, pads=[5, 0])
    assert not load.arrivals_per_s[1].any()


def test_every_wrong_row_is_said_at_once_with_its_line(tmp_path):
    rows = [
        *week("station-a"),  # lines 2 to 169
        "staton-a,0,1,60",
        "station-a,168,1,60",
        "station-a,-1,1,60",
        "station-a,1.5,1,60",
        "station-a,3,1,60",
        "station-a,3,-1,60",
        "station-a,3,nan,60",
        "station-a,3,many,60",
        "station-a,3,1_0,60",
        "station-a,3,9999,60",
        "station-a,3,1,-60",
        "station-a,3,1,0",
        "station-a,3,1,",
        "station-a,3,1,inf",
        "station-a,3,1",
    ]
    path = write(tmp_path / "load.csv", HEADER, *rows)
    faults = faults_of(lambda: read_load(path, ["station-a"], NEW_YORK))
    assert [int(fault.split("load.csv:")[1].split(":")[0]) for fault in faults] == list(range(170, 185))
    expected = ["did you mean station-a?", *["hour of the week"] * 3, "second row", *["rate per hour"] * 5]
    expected += [*["charging time"] * 4, "has 3 cells"]
    for fault, words in zip(faults, expected, strict=True):
        assert words in fault


def test_hours_without_a_row_are_listed_for_each_station(tmp_path):
    path = write(tmp_path / "load.csv", HEADER, *week("a", skip=(7, 9)))
    faults = faults_of(lambda: read_load(path, ["a", "b", "c"], NEW_YORK))
    assert "no rows for b, c" in faults[0]
    assert "station a has no row for hours 7, 9" in faults[1]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        (HEADER + "\n", "no rows"),
        ("station,hour_of_week,arrivals_per_h\na,0,1\n", "mean_charging_min: no such column"),
        (HEADER + ",station\n", "appears twice"),
        ('station,"' + "x" * 200_000, "is not CSV"),
    ],
)
def test_a_file_that_is_no_table_of_loads_is_said_to_be_none(tmp_path, content, words):
    path = tmp_path / "load.csv"
    path.write_text(content)
    assert words in faults_of(lambda: read_load(path, ["a"], NEW_YORK))[0]


def test_thousands_of_faults_are_cut_to_twenty_and_counted(tmp_path):
    path = write(tmp_path / "load.csv", HEADER, *["a,168,1,60"] * 1000)
    faults = faults_of(lambda: read_load(path, ["a"], NEW_YORK))
    assert len(faults) == 21
    assert "980 more" in faults[-1]


def test_an_unknown_station_is_said_once(tmp_path):
    path = write(tmp_path / "load.csv", HEADER, *["x,0,1,60"] * 1000)
    assert len(faults_of(lambda: read_load(path, ["a"], NEW_YORK))) == 1


def test_a_missing_file_and_an_unknown_zone_are_input_errors(tmp_path):
    assert "no such file" in faults_of(lambda: read_load(tmp_path / "no.csv", ["a"], NEW_YORK))[0]
    assert "time zone" in faults_of(lambda: read_load(tmp_path / "no.csv", ["a"], "Nowhere"))[0]


def occupancy(path, columns, rows):
    return write(path, ",".join(("", *columns)), *(",".join(map(str, row)) for row in rows))


def local_hours(days: int, first: str = "2013-07-08T00:00"):
    start = np.datetime64(first)
    return [str(start + np.timedelta64(hour, "h")).replace("T", " ") for hour in range(24 * days)]


def test_busy_pads_become_arrivals_by_littles_law_matched_by_column_name(tmp_path):
    rows = [(t, 2.0, 1.0 if i < 168 else 3.0) for i, t in enumerate(local_hours(14))]
    path = occupancy(tmp_path / "o.csv", ["b", "a"], rows)
    load, warnings = read_occupancy(path, ["a", "b"], NEW_YORK, [5, 5], 30.0)
    assert warnings == []
    assert load.arrivals_per_s * 1800.0 == pytest.approx(np.full((2, 168), 2.0))
    assert (load.mean_charging_s == 1800.0).all()


def test_hours_with_every_pad_busy_are_clamped_and_counted(tmp_path):
    rows = [(t, 9.0 if i < 10 else 1.0) for i, t in enumerate(local_hours(7))]
    load, warnings = read_occupancy(occupancy(tmp_path / "o.csv", ["a"], rows), ["a"], NEW_YORK, 5, 60.0)
    assert load.utilisation(5)[0, :10] == pytest.approx(np.full(10, 0.95))
    assert "10 hours" in warnings[0]


def test_stations_without_a_column_get_no_load_and_a_warning(tmp_path):
    rows = [(t, 1.0, 1.0) for t in local_hours(7)]
    path = occupancy(tmp_path / "o.csv", ["a", "other"], rows)
    load, warnings = read_occupancy(path, ["a", "b"], NEW_YORK, [5, 5], 60.0)
    assert not load.arrivals_per_s[1].any()
    assert "no load, for b" in warnings[0]
    assert "1 columns are not stations of the network: other" in warnings[1]


def test_a_clock_change_in_the_record_breaks_nothing(tmp_path):
    fall = [t for t in local_hours(14, "2013-10-28T00:00") for _ in range(2 if t == "2013-11-03 01:00" else 1)]
    spring = [t for t in local_hours(14, "2013-03-04T00:00") if t != "2013-03-10 02:00"]
    for name, times in (("fall.csv", fall), ("spring.csv", spring)):
        path = occupancy(tmp_path / name, ["a"], [(t, 1.5) for t in times])
        load, _ = read_occupancy(path, ["a"], NEW_YORK, 5, 60.0)
        assert load.arrivals_per_s * 3600.0 == pytest.approx(np.full((1, 168), 1.5))


def test_times_with_an_offset_are_turned_into_local_time(tmp_path):
    rows = [(f"{t}+00:00", i) for i, t in enumerate(local_hours(7))]
    load, _ = read_occupancy(occupancy(tmp_path / "o.csv", ["a"], rows), ["a"], NEW_YORK, 999, 60.0)
    assert load.arrivals_per_s[0, 0] * 3600.0 == pytest.approx(4.0)  # Monday 00:00 is 04:00 UTC in summer


def test_gaps_are_left_out_of_the_average_and_counted(tmp_path):
    rows = [(t, "" if i == 3 else "NaN" if i == 4 else 2.0) for i, t in enumerate(local_hours(14))]
    load, warnings = read_occupancy(occupancy(tmp_path / "o.csv", ["a"], rows), ["a"], NEW_YORK, 5, 60.0)
    assert load.arrivals_per_s * 3600.0 == pytest.approx(np.full((1, 168), 2.0))
    assert "2 values are missing" in warnings[0]


def test_every_wrong_cell_of_a_record_is_said_at_once(tmp_path):
    times = local_hours(7)
    rows = [(t, 1.0) for t in times] + [("noon", 1.0), (times[0], -1), (times[1], "x"), (times[2],)]
    path = occupancy(tmp_path / "o.csv", ["a"], rows)
    faults = faults_of(lambda: read_occupancy(path, ["a"], NEW_YORK, 5, 60.0))
    for number, (fault, words) in enumerate(
        zip(faults, ["not a time", "not an occupancy", "not an occupancy", "has 1 cell "], strict=True)
    ):
        assert f":{170 + number}:" in fault
        assert words in fault


def test_a_record_of_less_than_a_week_is_refused(tmp_path):
    path = occupancy(tmp_path / "o.csv", ["a"], [(t, 1.0) for t in local_hours(6)])
    assert "no value for 24 of the 168" in faults_of(lambda: read_occupancy(path, ["a"], NEW_YORK, 5, 60.0))[0]


@pytest.mark.parametrize("minutes", [0.0, -5.0, float("nan"), 1e6])
def test_an_absurd_charging_time_is_refused(tmp_path, minutes):
    path = occupancy(tmp_path / "o.csv", ["a"], [(t, 1.0) for t in local_hours(7)])
    assert "out of range" in faults_of(lambda: read_occupancy(path, ["a"], NEW_YORK, 5, minutes))[0]


def test_the_record_of_melbournes_charging_sites_is_read_by_name(shared_data):
    path = shared_data / "stations" / "melbourne_duration.csv.gz"
    ids = [str(number) for number in range(63)]
    load, warnings = read_occupancy(path, ids, "Australia/Melbourne", [25] * 62 + [0], 60.0)
    busy = load.arrivals_per_s * 3600.0
    assert warnings == []
    assert not busy[44].any()
    assert busy[3] == pytest.approx(np.ones(168))
    assert busy[35] == pytest.approx(np.full(168, 4.0))
    assert not busy[62].any()
