"""Units and instants: exact factors, no naive times, nothing lost in writing."""

from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base import units
from skyway.models.base.errors import InputError

YEARS = {"min_value": datetime(1900, 1, 1), "max_value": datetime(2200, 1, 1)}  # noqa: DTZ001
OFFSETS = st.integers(-14 * 60, 14 * 60).map(lambda minutes: timezone(timedelta(minutes=minutes)))


def test_speeds_are_exact():
    assert units.SPEED_UNITS_MPS["km/h"] * 81.0 == pytest.approx(22.5, rel=1e-15)
    assert units.SPEED_UNITS_MPS["mph"] == pytest.approx(0.44704, rel=1e-15)
    assert units.SPEED_UNITS_MPS["kn"] * 3600.0 == pytest.approx(1852.0, rel=1e-15)
    assert units.SPEED_UNITS_MPS["m/s"] == 1.0


@given(st.datetimes(**YEARS, timezones=OFFSETS))
def test_an_instant_written_and_read_is_the_same_instant(instant):
    text = units.iso(instant)
    assert text.endswith("Z")
    assert units.parse_instant(text) == instant
    assert units.parse_instant(instant.isoformat()) == instant


def test_a_day_that_does_not_exist_is_told_from_a_text_that_is_no_time():
    with pytest.raises(InputError, match=r"not an ISO 8601 time: .*day.*month"):
        units.parse_instant("2023-02-29T10:00+13:00")
    with pytest.raises(InputError, match=r"not an ISO 8601 time \("):
        units.parse_instant("tomorrow")


@given(st.datetimes(**YEARS, timezones=OFFSETS))
def test_inside_the_code_every_instant_is_utc(instant):
    assert units.utc(instant).tzinfo is UTC
    assert units.parse_instant(instant.isoformat()).utcoffset() == timedelta(0)


@pytest.mark.parametrize("text", ["2013-07-10T14:00-04:00", " 2013-07-10T18:00Z\n", "20130710T180000+0000"])
def test_an_instant_is_read_with_its_offset(text):
    assert units.parse_instant(text) == datetime(2013, 7, 10, 18, tzinfo=UTC)


@pytest.mark.parametrize("text", ["2013-07-10T14:00", "2013-07-10", "2013-07-10 14:00:00"])
def test_a_naive_time_is_refused_and_the_message_shows_how_to_write_it(text):
    with pytest.raises(InputError, match=r"f\.csv: depart: the time has no UTC offset .*2013-07-10T14:00-04:00"):
        units.parse_instant(text, field="depart", file="f.csv")


@pytest.mark.parametrize("text", ["", "noon", "NaN", "1373479200", "10.7.2013 14:00", "2013-13-01T00:00Z", "\x00"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(InputError, match="not an ISO 8601 time"):
        units.parse_instant(text)


def test_the_ends_of_the_calendar_are_refused_not_crashed_on():
    with pytest.raises(InputError, match="out of range"):
        units.parse_instant("0001-01-01T00:00+14:00")
    with pytest.raises(InputError, match="no UTC offset"):
        units.utc(datetime(2013, 7, 10))  # noqa: DTZ001


@pytest.mark.parametrize(
    ("microsecond", "text"), [(0, "18:00:00Z"), (250_000, "18:00:00.250Z"), (1, "18:00:00.000001Z")]
)
def test_seconds_are_written_with_the_digits_they_have(microsecond, text):
    assert units.iso(datetime(2013, 7, 10, 18, microsecond=microsecond, tzinfo=UTC)) == f"2013-07-10T{text}"


def test_posix_seconds_become_utc():
    assert units.from_posix(1_373_479_200.0) == datetime(2013, 7, 10, 18, tzinfo=UTC)
