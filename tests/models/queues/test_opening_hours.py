"""Opening hours, minute by minute."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.queues.opening_hours import Closures, OpeningHours, closed_path
from skyway.models.queues.paths import QueuePath

DAYS = ["Mo", "Tu", "We", "Th", "Fr", "Sa", "Su"]
BEGIN = datetime(2026, 3, 24, 10, 17, tzinfo=UTC)
"""A week in which the clock changes in Berlin (29 March) and does not in New York."""


def is_open(rules, local):
    """By the definition, for one minute: rules are [(days, spans)], the later one for a day counts."""

    def spans_of(day):
        found = []
        for days, spans in rules:
            if days is None or day in days:
                found = spans
        return found

    minute, day = 60 * local.hour + local.minute, local.weekday()
    today = any(a <= minute < (b if b > a else b + 1440) for a, b in spans_of(day))
    return today or any(b <= a and minute < b for a, b in spans_of((day - 1) % 7))


def text_of(rules):
    def clock(minute):
        return f"{minute // 60:02d}:{minute % 60:02d}"

    parts = []
    for days, spans in rules:
        listed = "" if days is None else ",".join(DAYS[day] for day in days) + " "
        parts.append(listed + (",".join(f"{clock(a)}-{clock(b)}" for a, b in spans) or "off"))
    return "; ".join(parts)


SPAN = st.tuples(st.integers(0, 1439), st.integers(0, 1440))
RULE = st.tuples(
    st.one_of(st.none(), st.lists(st.integers(0, 6), min_size=1, max_size=3, unique=True)), st.lists(SPAN, max_size=2)
)


@settings(max_examples=60)
@given(st.lists(RULE, min_size=1, max_size=3), st.sampled_from(["UTC", "Europe/Berlin", "America/New_York"]))
def test_closures_are_those_of_every_minute(rules, timezone):
    """Against the definition, on the local clock; hours within a change of the clock are left out."""
    text = text_of(rules)
    try:
        hours = OpeningHours.parse(text)
    except InputError:
        assert not any(is_open(rules, BEGIN + timedelta(minutes=step)) for step in range(0, 7 * 1440, 7))
        return
    start = BEGIN.timestamp()
    closed = hours.closed_between(timezone, start, start + 6 * 86400.0)
    assert (closed[:, 0] < closed[:, 1]).all()
    assert (closed[1:, 0] > closed[:-1, 1]).all()
    for step in range(0, 6 * 1440, 53):
        at = BEGIN + timedelta(minutes=step)
        local = at.astimezone(ZoneInfo(timezone))
        changes = timezone == "Europe/Berlin" and local.date().isoformat() == "2026-03-29" and local.hour < 4
        shut = bool(((closed[:, 0] <= at.timestamp()) & (at.timestamp() < closed[:, 1])).any())
        assert changes or shut != is_open(rules, local)


@pytest.mark.parametrize(
    "text",
    ["7-19", "07:00", "07:00-25:00", "07:60-08:00", "Mon 07:00-08:00", "Mo-Xx 07:00-08:00", "PH off", "; ", "Mo off", "07:00-19:00;", "off", "24:00-25:00"],
)  # fmt: skip
def test_what_is_no_opening_hours(text):
    """Refused, with an example."""
    with pytest.raises(InputError):
        OpeningHours.parse(text)


def test_always_and_over_the_week():
    """All of the week is never closed, and a span over Sunday's midnight joins Monday's."""
    assert OpeningHours.parse("24/7").always
    assert OpeningHours.parse("00:00-24:00").always
    assert OpeningHours.parse("06:00-06:00").always
    assert OpeningHours.parse("Su 22:00-06:00; Mo 06:00-10:00").spans == ((6 * 1440 + 22 * 60, 7 * 1440 + 10 * 60),)


@st.composite
def paths(draw):
    """A queue path whose pad times do not fall."""
    count = draw(st.integers(0, 6))
    arrival = np.sort(np.array(draw(st.lists(st.floats(0.0, 900.0), min_size=count, max_size=count, unique=True))))
    pad = np.maximum.accumulate([draw(st.floats(0.0, 1100.0)) for _ in range(count + 1)])
    pad[0] = draw(st.sampled_from([-np.inf, pad[0]]))
    delay = np.full(count + 1, draw(st.sampled_from([0.0, 37.0])))
    land = np.minimum(pad, draw(st.sampled_from([-np.inf, 0.0, 2000.0])))
    return QueuePath(arrival, pad, np.maximum.accumulate(land), delay, 2, np.empty(0))


@given(paths(), st.lists(st.integers(0, 1000), min_size=2, max_size=6, unique=True), st.integers(0, 1))
def test_a_pad_is_had_when_the_station_opens(path, edges, spots):
    """The path within opening hours against each time put off by itself."""
    edges = sorted(edges)[: len(edges) // 2 * 2]
    closed = np.array(edges, dtype=np.float64).reshape(-1, 2)

    def put_off(time_s):
        return next((end for begin, end in closed.tolist() if begin <= time_s < end), time_s)

    found = closed_path(path, closed, spots=spots)
    for time_s in np.arange(-10.3, 1200.0, 7.7):
        pad, land = float(path.pad_time(time_s)), float(path.land_time(time_s))
        assert float(found.pad_time(time_s)) == pytest.approx(put_off(pad))
        assert float(found.land_time(time_s)) == pytest.approx(land if spots else put_off(land))
        assert found.present_at(time_s) == path.present_at(time_s)


@given(st.lists(st.integers(0, 300), min_size=2, max_size=6, unique=True), st.integers(0, 300), st.integers(0, 200))
def test_a_charge_goes_on_when_it_opens(edges, begin, lasts):
    """So many open seconds later, second by second."""
    edges = sorted(edges)[: len(edges) // 2 * 2]
    closed = np.array(edges, dtype=np.float64).reshape(-1, 2)
    closures = Closures(closed)

    def open_in(second):
        return not any(a <= second < b for a, b in closed.tolist())

    end = float(closures.past(np.array([begin]), np.array([begin + lasts]))[0])
    assert sum(open_in(second) for second in range(begin, int(end))) == lasts
    assert lasts == 0 or open_in(int(end) - 1)
    assert float(closures.within(np.array([begin]), np.array([end]))[0]) == end - begin - lasts
