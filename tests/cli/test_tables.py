"""Tables: whatever the width, nothing is cut; in a pipe every row is one line."""

import math
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from cli_requests import HOP, TRIP
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from skyway.cli.views.plan import schedule_sheet
from skyway.cli.views.sheet import NO_NUMBER, Column, Sheet, wrapped
from skyway.models.base.formatting import (
    about,
    between,
    by,
    duration,
    later_text,
    minutes,
    percent,
    share,
    spent,
    step_of,
)
from skyway.models.base.statistics import Figure
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.service import DroneService, Place, Stop
from skyway.models.wind.summary import Wind

COMMANDS = {
    "plan": ("plan", *TRIP, "--drone", "m300"),
    "compare": ("compare", *HOP, "--drone", "m300", "--planners", "robust,pfs"),
    "wind": ("wind", "--depart", "2013-07-10T14:00-04:00", "--hours", "3"),
    "network": ("network",),
    "scenario check": ("scenario", "check"),
    "explained": ("plan", *HOP, "--explain", "--alternatives", "2", "--depart-window", "1h"),
}


@pytest.fixture(scope="module", autouse=True)
def planned_once():
    """Plan each request once: what is judged here is how it is shown, at several widths."""
    from skyway.planner import departure, plan, report

    plans, reports = {}, {}
    make_plan, make_report = plan.plan, report.plan_report

    def plan_of(scenario, request, **asked):
        key = repr(request), asked["planner"]
        if key not in plans:
            plans[key] = make_plan(scenario, request, **asked)
        return plans[key]

    def report_of(result, tried, *asked, explain, **more):
        key = result.composition.id, asked, explain, more.get("flown_runs")
        if key not in reports:
            reports[key] = make_report(result, tried, *asked, explain=explain, **more)
        return reports[key]

    patch = pytest.MonkeyPatch()
    patch.setattr(plan, "plan", plan_of)
    patch.setattr(departure, "plan", plan_of)
    patch.setattr(report, "plan_report", report_of)
    yield
    patch.undo()


def words(text):
    return sorted(text.replace("─", "").split())


@pytest.mark.parametrize("arguments", COMMANDS.values(), ids=COMMANDS.keys())
@pytest.mark.parametrize("columns", [60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal_and_no_name_is_cut(skyway, monkeypatch, arguments, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    shown = skyway(*arguments)
    assert shown.code == 0, shown.err
    assert max(cell_len(line) for line in shown.out.splitlines()) <= columns
    assert "…" not in shown.out.replace(" … ", "")
    if arguments[0] == "plan":
        assert f"{arguments[4]}: delivered" in shown.out
    if arguments[0] == "network":
        assert "Staten Island University Hospital North (Ocean Breeze), Staten Island" in " ".join(shown.out.split())


def test_a_long_leg_keeps_its_destination_in_a_pipe(skyway, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    out = skyway(*COMMANDS["plan"]).out
    assert any(" > (" in line and "km" not in line and "m/s" not in line and "%" in line for line in out.splitlines())
    assert "…" not in out


def test_a_narrow_table_holds_the_same_values():
    sheet = Sheet([Column("leg", justify="left"), Column("wind", "m/s"), Column("charge", words="charge {} %")])
    sheet.add("a > (b) > a-very-long-destination", "8 (5 to 11)", "50 > 20")
    sheet.note("a stop")
    sheet.add("東京 > b", "7", "40 > 20")
    wide, narrow = sheet.lines(None), sheet.lines(30)
    assert len(wide) == 6
    assert all(cell_len(line) <= 36 for line in narrow)
    for value in ("8 (5 to 11)", "50 > 20", "a-very-long-destination", "東京", "a stop"):
        assert any(value in line for line in wide)
        assert value in " ".join(" ".join(narrow).split())


def test_a_line_is_broken_between_words_only():
    text = "one two-three four " * 10
    assert " ".join(" ".join(wrapped(text, 24)).split()) == text.strip()
    assert all(len(line) <= 24 for line in wrapped(text, 24))
    assert wrapped(text, None) == [text]


def unknown_delivery():
    """A composition in which whatever may be unknown is."""
    start = datetime(2013, 7, 10, 18, tzinfo=UTC)
    landed = start + timedelta(minutes=5)
    wind = Wind(3.0, None)
    legs = (
        DroneService("1", "a", "b", start, landed, 5000.0, 0.0, 15.0, 500.0, 1.0, 0.5, wind, -3.0, 0.0),
        DroneService(
            "2", "b", "c", landed, landed + timedelta(minutes=5), 5000.0, 0.0, 15.0, 500.0, 0.5, 0.4, wind, 0.0, 0.0
        ),
    )
    stop = Stop("b", landed, wait_s=0.0, recharge_s=60.0, hold_s=0.0, soc_from=0.5, soc_to=0.5)
    places = {name: Place(40.0, -74.0) for name in "abc"}
    return Composition(
        "x", "pfs", "m200", 0.8, 20.0, 20.0, 60.0, 5.0, 3.0, 0.2, start, "a", "c", places, legs, (stop,),
        ArrivalDistribution(None, None, None), 0.0,
    )  # fmt: skip


def test_a_plan_whose_figures_are_unknown_says_so():
    delivery = unknown_delivery()
    text = "\n".join(schedule_sheet(delivery, ZoneInfo("America/New_York")).lines(None))
    assert "unknown" in text
    assert NO_NUMBER.search(text) is None


@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "+nan", "nan > 40", "nan %", "8 (nan to inf)", "nan ± nan"])
def test_a_cell_that_is_no_number_is_unknown(cell):
    sheet = Sheet([Column("leg"), Column("tail", "m/s")])
    sheet.add("nan > inf", cell)
    sheet.add("a > nancy", "inferior")
    [*_, bad, good] = sheet.lines(None)
    assert NO_NUMBER.search(bad.removeprefix("nan > inf")) is None
    assert "unknown" in bad
    assert bad.startswith("nan > inf")  # the name of a station is a name
    assert good.endswith("inferior")


@given(st.floats(-1e9, 1e9), st.floats(0.0, 1e9), st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 2))
def test_words_for_figures_never_show_what_is_no_number(value, width, hole, place):
    values = [value, value - width, value + width]
    values[place] = hole
    figure, delivery, zone = Figure(*values), unknown_delivery(), ZoneInfo("America/New_York")
    said = [words_for(figure) for words_for in (about, between, minutes, share, later_text)]
    said += [by(figure, delivery, zone), duration(hole), spent(hole), percent(hole), percent(None)]
    assert all(NO_NUMBER.search(text) is None for text in said)
    assert "unknown" in said


@given(st.floats(60.0, 80_000.0), st.floats(0.0, 600.0))
def test_a_clock_shows_no_seconds_that_are_not_sure(value, half_width):
    """Seconds only where the interval reaches a few of them; else the minute that has begun by then, whatever the rounding."""
    delivery = unknown_delivery()
    said = by(Figure(value, value - half_width, value + half_width), delivery, ZoneInfo("UTC")).split(" +")[0]
    assert len(said) == (8 if half_width <= 4.0 else 5) or 3.999 < half_width < 4.001
    hours, *rest = map(int, said.split(":"))
    told = 3600 * hours + 60 * rest[0] + (rest[1] if len(rest) > 1 else 0)
    off = (told - (18 * 3600 + value) + 43_200.0) % 86_400.0 - 43_200.0
    rounding_s = 0.5 * step_of(Figure(value, value - half_width, value + half_width))
    assert -rounding_s <= off <= 60.0 + rounding_s if len(rest) == 1 else abs(off) <= 1.0


def test_what_takes_exactly_as_long_is_told_as_no_difference():
    assert later_text(Figure(0.0, 0.0, 0.0)) == "no difference on average"
    assert later_text(Figure(-60.0, -60.0, -60.0)).endswith("min earlier on average")
