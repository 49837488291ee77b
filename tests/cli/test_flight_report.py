"""The report of a flight says what the journal says, whatever the journal is, and needs nothing but itself."""

import dataclasses
import html
import itertools
import json
import math
import random
import re
from datetime import datetime
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import msgspec
import pytest
from rich.console import Console

from benchmarks.link.deliveries import Stage, Story
from skyway.cli.views.flight import FlightView
from skyway.flying import line_of
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Truth
from skyway.models.base.formatting import duration
from skyway.models.base.json_text import plain
from skyway.report.report import flight, write_report
from skyway.report.svg import Band, Chart, Course, time_ticks
from skyway.web.work.history import told

VOID = {"meta"}
LINKING = {"src", "href", "xlink:href", "action", "data", "poster", "srcset"}


class Page(HTMLParser):
    """What a browser would see: its text by element, scripts, links; every element is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.scripts, self.links, self.handlers, self.words, self.faults = [], 0, [], [], [], []
        self.feed(text)
        self.close()

    def handle_startendtag(self, tag, attrs):
        self._look(tag, attrs)

    def handle_starttag(self, tag, attrs):
        self._look(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def _look(self, tag, attrs):
        self.scripts += tag == "script"
        self.links += [value for name, value in attrs if name in LINKING]
        self.handlers += [name for name, _ in attrs if name.startswith("on")]

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script") and data.strip():
            self.words.append(data.strip())

    @property
    def sound(self):
        return not self.open and not self.faults and self.scripts == 1 and not self.links and not self.handlers


def seen(path):
    """The page, found sound and without anything outside."""
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert page.sound, (page.open, page.faults, page.scripts, page.links, page.handlers)
    assert not re.findall(r"https?:|//[a-z]|@import|url\(|fetch\(|XMLHttpRequest|NaN|\binf\b|None", text)
    return page


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A delivery with a recharge in true wind; its journal knows the truth, as the demonstration's does."""
    stage = Stage(Story(start="bellevue", to="city-hall", soc=0.42, traffic=False), tmp_path_factory.mktemp("flown"))
    written = [-math.inf]

    def truth(ctx):
        if ctx.in_air and ctx.now_s >= written[0] + 5.0:
            written[0] = ctx.now_s
            north, east = stage.craft.true_wind
            ctx.note(Truth(wind_north_mps=north, wind_east_mps=east, soc=stage.craft.battery.soc))

    outcome = stage.fly(on_tick=truth)
    assert outcome.delivered, outcome
    return stage.journal_path


@pytest.fixture(scope="module")
def records(flown):
    return read_journal(flown).records


def of_kind(records, kind):
    return [record for record in records if record.event == kind]


def changed(flown, folder, change):
    """A journal like the real one, each record changed (or left out, where None comes back)."""
    lines = [change(json.loads(line)) for line in flown.read_text().splitlines()]
    path = folder / "changed.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines if line is not None))
    return path


class Moved(Stage):
    """A flight that only moves the drone, as a dispatcher orders it before it fetches a package."""

    def job(self):
        return dataclasses.replace(super().job(), hands_over=False)


def test_a_flight_without_a_package_is_no_delivery_and_keeps_no_promise(flown, tmp_path):
    stage = Moved(Story(start="bellevue", to="city-hall", traffic=False, supervised=False), tmp_path)
    assert stage.fly().state == "delivered"
    moved, delivered = flight(stage.journal_path), flight(flown)
    assert (moved.delivery.hands_over, moved.outcome.arrived, moved.outcome.delivered) == (False, True, False)
    assert (delivered.delivery.hands_over, delivered.outcome.arrived, delivered.outcome.delivered) == (True, True, True)
    rows = [row for path in (stage.journal_path, flown) for row in told(str(path.parent), [(path.name, 0.0)])]
    assert [row["hands_over"] for row in rows] == [False, True]
    assert [row["promise_kept"] is None for row in rows] == [True, False]
    write_report(stage.journal_path, tmp_path / "report.html")
    assert "Arrived, without a package to deliver" in seen(tmp_path / "report.html").words


def test_a_plan_that_simulated_no_deliveries_promises_nothing(flown, tmp_path):
    def unsimulated(line):
        if line["event"] == "start":
            line["data"]["composition"]["arrival"]["runs"] = None
        return line

    path = changed(flown, tmp_path, unsimulated)
    (row,) = told(str(path.parent), [(path.name, 0.0)])
    assert row["delivered"]
    assert (row["promise_kept"], row["half_kept"]) == (None, None)


@pytest.mark.parametrize(("payload_kg", "delivers"), [(0.0, False), (0.8, True)])
def test_a_journal_that_does_not_say_so_delivers_what_it_carries(flown, tmp_path, payload_kg, delivers):
    def older(line):
        if line["event"] == "start":
            del line["data"]["hands_over"]
            line["data"]["payload_kg"] = payload_kg
        return line

    assert flight(changed(flown, tmp_path, older)).delivery.hands_over is delivers


def test_the_document_has_the_figures_of_the_journal(flown, records):
    document = plain(flight(flown))
    assert document["schema"] == "skyway.flight/1"
    assert document["outcome"]["delivered"]
    assert document["outcome"]["reason"] == records[-1].reason
    landed, left, energy = (of_kind(records, kind) for kind in ("landed", "leg", "energy"))
    assert len(document["legs"]) == len(landed) == len(left)
    for leg, down, up, used in zip(document["legs"], landed, left, energy, strict=True):
        assert leg["soc_land"] == down.data["soc"]
        assert leg["flight_s"] == down.data["flight_s"]
        assert leg["landed_at"] == down.data["station"]
        assert (leg["planned_s"], leg["planned_soc"]) == (up.data["planned_s"], up.data["planned_soc"])
        assert leg["diverts"] == up.data["diverts"]
        assert leg["used_soc"] == used.data["used_soc"]
    assert [d["reason"] for d in document["decisions"]] == [r.reason for r in of_kind(records, "decision")]
    assert document["totals"]["planned"]["delivery_s"] == records[0].data["composition"]["delivery_time_s"]
    tracks = of_kind(records, "track")
    assert document["series"]["track"]["soc"] == [record.data["soc"] for record in tracks]
    json.dumps(document, allow_nan=False)


def test_waits_and_charges_are_the_times_in_those_states(flown, records):
    changes = [(record.time_s, record.data["after"]) for record in of_kind(records, "state")]
    changes.append((records[-1].time_s, ""))
    spent = {"waiting-for-pad": 0.0, "charging": 0.0}
    for (begin_s, state), (end_s, _) in itertools.pairwise(changes):
        spent[state] = spent.get(state, 0.0) + end_s - begin_s
    assert spent["charging"] > 60.0
    document = plain(flight(flown))
    assert document["totals"]["actual"]["charge_s"] == pytest.approx(spent["charging"], abs=1e-3)
    assert document["totals"]["actual"]["wait_s"] == pytest.approx(spent["waiting-for-pad"], abs=1e-3)
    stop = next(stop for stop in document["stops"] if stop["charge_s"] > 0.0)
    done = [record for record in of_kind(records, "pad") if record.data["answer"] == "done"]
    assert stop["soc_to"] == pytest.approx(done[0].data["soc"], abs=0.02)


def test_errors_of_the_wind_are_those_one_computes_by_hand(flown, records):
    leg = plain(flight(flown))["legs"][0]
    inside = [r for r in records if leg["depart_s"] <= r.time_s <= leg["land_s"]]
    realizations = [(r.time_s, r.data["wind_north_mps"], r.data["wind_east_mps"]) for r in inside if r.event == "truth"]
    squares = []
    for record in inside:
        if record.event == "track" and record.data.get("wind_north_mps") is not None:
            _, north, east = min(realizations, key=lambda row: abs(row[0] - record.time_s))
            squares.append((record.data["wind_north_mps"] - north) ** 2 + (record.data["wind_east_mps"] - east) ** 2)
    assert leg["wind"]["estimate_rms_mps"] == pytest.approx(math.sqrt(sum(squares) / len(squares)), abs=0.05)
    assert leg["wind"]["forecast_rms_mps"] > 0.0


def test_the_page_shows_outcome_decisions_checks_and_zones_and_needs_no_network(flown, records, tmp_path):
    report = tmp_path / "report.html"
    write_report(flown, report)
    page = seen(report)
    told = " ".join(page.words)
    assert "Delivered" in page.words
    for record in (*of_kind(records, "decision"), *of_kind(records, "landed"), records[-1]):
        assert record.reason in told
    for check in of_kind(records, "preflight")[0].data["checks"]:
        assert check["said"] in told
    assert "no-fly zone" in told  # the built-in scenario's
    assert "Times are EDT" in told, "the lines of the flight were in the zone of the scenario, its report in UTC"
    assert "UTC" not in page.words
    for axis in ("time, EDT", "m/s", "State of charge, %", "two sigma", "true (simulation)", "first plan"):
        assert axis in told
    plotted = re.search(
        r'aria-label="State of charge over time">.*?class="line actual" d="M[\d.]+ ([\d.]+)', report.read_text()
    )
    first = next(one.data["soc"] for one in of_kind(records, "track") if one.data["soc"] is not None)
    assert float(plotted[1]) == pytest.approx(240 - 40 - first * (240 - 66), abs=0.1)


def test_a_flight_without_a_truth_claims_none(flown, tmp_path):
    path = changed(flown, tmp_path, lambda line: None if line["event"] == "truth" else line)
    document = plain(write_report(path, tmp_path / "report.html"))
    assert document["legs"][0]["wind"]["truth"] is None
    assert document["legs"][0]["wind"]["estimate_rms_mps"] is None
    assert "unknown" in seen(tmp_path / "report.html").words


def test_a_journal_that_breaks_off_anywhere_makes_a_report_that_says_so(flown, tmp_path):
    data = flown.read_bytes()
    start = data.index(b"\n") + 1
    for number, end in enumerate((start, *sorted(random.Random(9).sample(range(start, len(data) - 2), 12)))):
        path = tmp_path / f"{number}.jsonl"
        path.write_bytes(data[:end])
        document = plain(write_report(path, tmp_path / f"{number}.html"))
        assert not document["outcome"]["ended"]
        assert not document["outcome"]["delivered"]
        assert any("breaks off" in words for words in seen(tmp_path / f"{number}.html").words)


def test_a_delivery_that_was_stopped_is_not_called_delivered(flown, tmp_path):
    def stop(line):
        if line["event"] == "end":
            line["data"] = {"outcome": "stopped-safe", "station": "bellevue", "flights": 1}
            line["reason"] = "no pad"
        return line

    write_report(changed(flown, tmp_path, stop), tmp_path / "report.html")
    page = seen(tmp_path / "report.html")
    assert "Not delivered: stopped, safe on the ground" in page.words
    assert "Delivered" not in page.words


EVIL = (
    "</script><script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "<!--", "]]>", "&lt;", "'--><svg/onload=x>",
    "\x00\x1b[2J\u202e", "<!--BODY-->",
)  # fmt: skip


@pytest.mark.parametrize("evil", EVIL)
def test_words_from_a_journal_stay_words(flown, tmp_path, evil):
    def spoil(value):
        if isinstance(value, dict):
            return {
                key + (evil if key in ("bellevue", "city-hall") else ""): spoil(item) for key, item in value.items()
            }
        if isinstance(value, list):
            return [spoil(item) for item in value]
        return value + evil if isinstance(value, str) and not value.startswith(("skyway.", "2013-")) else value

    def change(line):
        return line | {"data": spoil(line["data"]), "reason": spoil(line["reason"]), "state": spoil(line["state"])}

    path = changed(flown, tmp_path, change)
    write_report(path, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.sound, (page.open, page.faults, page.scripts, page.links, page.handlers)
    assert not any(c in text for c in "\x00\x1b\u202e")
    if evil.isprintable():
        assert html.escape(evil) in text


def test_a_journal_of_nonsense_is_told_as_unknown_and_never_breaks(flown, tmp_path):
    nonsense = (None, True, "x" * 5000, -1e300, 10**400, [], {}, [[[]]], {"lat": "n"}, 9e15, "2013-13-45T99:00Z", -5)
    rng = random.Random(4)

    def spoil(value, depth=0):
        if rng.random() < 0.25 and depth:
            return rng.choice(nonsense)
        if isinstance(value, dict):
            return {key: spoil(item, depth + 1) for key, item in value.items() if rng.random() > 0.1}
        return [spoil(item, depth + 1) for item in value] if isinstance(value, list) else value

    view = FlightView(Console(force_terminal=True, width=80))
    for number in range(12):
        rng.seed(number)

        def change(line):
            time = rng.choice(("", "never", "0001-01-01T00:00:00Z", "9999-12-31T00:00:00Z", line["time"]))
            if line["event"] == "start":
                return line | {
                    "data": {"schema": "skyway.journal/1"} | {"composition": spoil(line["data"]["composition"])}
                }
            return line | {"data": spoil(line["data"]), "time": time}

        path = changed(flown, tmp_path, change)
        document = plain(write_report(path, tmp_path / "report.html", force=True))
        json.dumps(document, allow_nan=False)
        assert Page((tmp_path / "report.html").read_text()).sound
        for record in read_journal(path).records[:200]:
            line_of(record)
            view.table(record)


def test_what_is_no_journal_is_refused_in_a_line(refused, tmp_path):
    (tmp_path / "empty.jsonl").write_text("")
    assert "not a flight journal" in refused("report", "empty.jsonl")
    assert "no such file" in refused("report", "nothing.jsonl")
    (tmp_path / "plan.json").write_text('{"schema": "skyway.plan/1",\n "legs": []}\n')
    assert refused("report", "plan.json") == (
        "skyway: plan.json: is not a flight journal; name a journal (.jsonl) that skyway fly wrote"
    )
    assert "plan.json: is JSON (a plan, mission or journal), not a flight log; name a MAVLink" in refused(
        "replay", "plan.json"
    )


def test_the_command_writes_the_page_and_never_over_another(skyway, flown, tmp_path):
    first = skyway("report", str(flown))
    assert first.code == 0
    assert first.out.splitlines()[-1] == "report.html"
    seen(tmp_path / "report.html")
    assert "exists already" in skyway("report", str(flown)).err
    assert skyway("report", str(flown), "--force").code == 0
    printed = skyway("report", str(flown), "--json")
    assert json.loads(printed.out)["outcome"]["delivered"]
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".html") == ["report.html"]


def test_another_plan_is_compared_with_when_it_is_named(skyway, flown, tmp_path):
    asked = ("plan", "--from", "bellevue", "--to", "city-hall", "--payload", "0.8", "--drone", "m200", "--planner",
             "shortest", "--depart", "2013-07-10T14:00-04:00", "-o", "other.json")  # fmt: skip
    assert skyway(*asked).code == 0
    answer = json.loads(skyway("report", str(flown), "--plan", "other.json", "--json").out)
    other = json.loads((tmp_path / "other.json").read_text())
    assert answer["totals"]["planned"]["delivery_s"] == other["delivery_time_s"]
    assert answer["sources"]["plan"] == "other.json"


def test_the_picture_is_one_svg_that_needs_nothing_else(skyway, flown, tmp_path):
    assert skyway("report", str(flown), "--plot", "flight.svg").code == 0
    root = ET.parse(tmp_path / "flight.svg").getroot()
    words = {element.text for element in root.iter() if element.tag.endswith("}text")}
    assert {"State of charge, %", "Wind at the vehicle, m/s", "bellevue", "city-hall", "time, EDT"} <= words
    text = (tmp_path / "flight.svg").read_text()
    assert re.findall(r"https?:[^\"]*", text) == ["http://www.w3.org/2000/svg"]
    assert "FILE.svg" in skyway("report", str(flown), "--plot", "flight.png", "--force").err


def test_lines_break_where_nothing_was_told_and_no_peak_is_thinned_away():
    course = Course("", "", [(0.0, 1.0), (5.0, 2.0), (10.0, None), (15.0, 3.0), (99.0, 4.0)], gap_s=30.0)
    assert course.pieces() == [[(0.0, 1.0), (5.0, 2.0)], [(15.0, 3.0)], [(99.0, 4.0)]]
    long = [(float(i), 0.0) for i in range(100_000)]
    long[54_321] = (54_321.0, 7.0)
    (kept,) = Course("", "", long).pieces()
    assert len(kept) < 3_000
    assert (54_321.0, 7.0) in kept
    assert kept[0] == long[0]
    assert kept[-1] == long[-1]
    band = Band("", "", [(0.0, 1.0, 3.0), (5.0, 2.0, 4.0)])
    assert band.pieces() == [[(0.0, 1.0), (5.0, 2.0), (5.0, 4.0), (0.0, 3.0)]]


@pytest.mark.parametrize("highest", [0.7, 3.0, 12.0, 12.6, 99.0, 4e3, 7e8])
def test_figures_at_an_axis_are_where_they_say(highest):
    drawn = Chart(
        "x", "m", 0.0, 60.0, courses=[Course("a", "actual", [(0.0, 0.0), (60.0, highest)])], low=0.0
    ).picture()
    ticks = [
        (float(y) - 4.0, float(value)) for y, value in re.findall(r'y="([\d.]+)" text-anchor="end">([\d.]+)<', drawn)
    ]
    assert 4 <= len(ticks) <= 8
    (low_y, low), (high_y, high) = ticks[0], ticks[-1]
    assert high >= highest
    for y, value in ticks:
        assert y == pytest.approx(low_y + (value - low) / (high - low) * (high_y - low_y), abs=0.11)


@pytest.mark.parametrize("span_s", [1.0, 59.0, 600.0, 7_000.0, 86_000.0, 4e6, 4e9])
def test_an_axis_has_a_few_round_times_however_long_it_is(span_s):
    ticks = time_ticks(1e6, 1e6 + span_s)
    assert len(ticks) <= 8
    assert len({label for _, label in ticks}) == len(ticks)


def test_the_live_table_sets_expected_beside_actual(records):
    view = FlightView(Console(width=100))
    track = next(r for r in of_kind(records, "track") if r.data.get("cross_track_m") is not None)
    leg = next(r for r in of_kind(records, "leg") if r.flight == track.flight)
    view.take(leg)
    rows = {name: (expected, actual) for name, expected, actual in view.rows(track)}
    assert rows["charge at the landing"] == tuple(
        f"{100 * track.data[key]:.0f} %" for key in ("planned_soc_land", "soc_land")
    )
    assert rows["off the route"][1] == f"{track.data['cross_track_m']:.0f} m"
    assert "±" in rows["wind"][1]
    assert re.fullmatch(r"\d+ \(\d+ to \d+\) m/s(, variable direction| from \d{3}°)", rows["wind"][0])
    assert duration(track.data["late_s"], signed=True) in rows["flight time"][1]


def test_what_limits_the_speed_is_shown_while_it_does(records):
    view = FlightView(Console(width=100))
    track = next(r for r in of_kind(records, "track") if r.data.get("cross_track_m") is not None)
    view.take(next(r for r in of_kind(records, "leg") if r.flight == track.flight))
    said = "limited by lean 30°: 11.8 m/s over ground of 20.0 commanded"
    limited = msgspec.structs.replace(track, data=track.data | {"limited": said})
    assert said in [actual for _, _, actual in view.rows(limited)]
    assert line_of(limited).endswith(f"; {said}")
    free = msgspec.structs.replace(track, data=track.data | {"limited": None})
    assert not any("limited" in actual for _, _, actual in view.rows(free))
    assert "limited" not in line_of(free)


def test_what_was_heard_before_the_link_was_lost_is_not_shown_as_current(records):
    view = FlightView(Console(width=100))
    track = next(r for r in of_kind(records, "track") if r.data.get("cross_track_m") is not None)
    view.take(next(r for r in of_kind(records, "leg") if r.flight == track.flight))
    lost = msgspec.structs.replace(track, state="lost-link")
    assert "lost-link    last heard: " in line_of(lost)
    assert "last heard" not in line_of(track)
    assert [str(column.header) for column in view.table(lost).columns][2] == "last heard"
    assert [str(column.header) for column in view.table(track).columns][2] == "actual"


def test_a_terminal_gets_the_table_and_a_pipe_gets_lines(records, capsys):
    shown = records[:120]
    screen = Console(force_terminal=True, width=100)
    with FlightView(screen).shown() as view:
        for record in shown:
            view.take(record)
    live = capsys.readouterr().out
    assert "expected" in live
    assert "charge at the landing" in live
    with FlightView(Console(force_terminal=False)).shown() as view:
        for record in shown:
            view.take(record)
    plain = capsys.readouterr().out
    assert "expected" not in plain
    assert "off the route" in plain
    assert "\x1b" not in plain


def test_the_page_begins_with_what_was_expected_and_what_came(flown, tmp_path):
    document = plain(write_report(flown, tmp_path / "report.html"))
    text = html.unescape((tmp_path / "report.html").read_text())
    arrival = json.loads(flown.read_text().splitlines()[0])["data"]["composition"]
    begun = datetime.fromisoformat(arrival["depart"])
    mean, half, most = (
        duration((datetime.fromisoformat(arrival["arrival"][name]) - begun).total_seconds())
        for name in ("mean", "p50", "p95")
    )
    took = duration(document["totals"]["actual"]["delivery_s"])
    assert (
        f"It took {took}; expected at the first plan: {mean} on average, half within {half}, 95 % within {most}."
        in text
    )
    assert "typical schedule" in text
    assert ">planned 0:" not in text


def test_winds_of_the_page_are_told_as_everywhere_and_not_measured_is_no_wind(flown, tmp_path):
    def unmeasured(line):
        data = {
            key: value for key, value in line["data"].items() if not key.startswith("wind_n") and key != "wind_east_mps"
        }
        return line | {"data": data} if line["event"] == "track" else line

    def expected_only(line):
        data = line["data"] | {"wind_source": "forecast"}
        return line | {"data": data} if line["event"] == "track" else line

    not_measured = plain(flight(changed(flown, tmp_path, expected_only)))
    assert not_measured["legs"][0]["wind"]["estimate"] is None
    assert set(not_measured["series"]["track"]["wind_north_mps"]) == {None}
    leg = plain(flight(flown))["legs"][0]
    words = r"\d+ \(\d+ to \d+\) m/s(, variable direction| from \d{3}°)|\d+\.\d m/s from \d{3}°"
    assert re.fullmatch(words, leg["wind"]["forecast"]["words"])
    assert re.fullmatch(words, leg["wind"]["estimate"]["words"])
    write_report(changed(flown, tmp_path, unmeasured), tmp_path / "report.html")
    assert "not measured" in (tmp_path / "report.html").read_text()
