"""What the plan page shows, asks and opens again, without a browser."""

from __future__ import annotations

import json
import shlex
from datetime import UTC

import msgspec
import pytest

from skyway.cli.main import main
from skyway.models.terrain.files import read_terrain
from skyway.web import drawn
from skyway.web.pages.plan_answer import explained, figures
from skyway.web.preferences import Preferences
from skyway.web.work.exports import export, opened
from skyway.web.work.planned import plan
from skyway.web.work.question import Question
from skyway.web.work.region import ground, region

ROUND = {"start": "bellevue", "to": "40.75,-73.93", "payload": "0.5", "depart": "2013-07-10T14:00-04:00", "wind": "3@250", "drone": "m300",
         "return_to": "home", "dwell": "5min", "if_undelivered": "back", "not_before": "2013-07-10T14:20-04:00"}  # fmt: skip


@pytest.fixture(scope="module")
def hills(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenario") / "hills"
    assert main(["scenario", "init", str(folder), "--example", "hills"]) == 0
    return folder


def test_a_round_is_planned_as_by_the_command_and_asked_again_from_its_file(capsys, tmp_path):
    question = Question(**ROUND)
    shown = plan(None, msgspec.to_builtins(question))["plans"][0]
    words = [one for one in shlex.split(question.command(None)) if one not in {"skyway", "--explain"}]
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["return"]["asked"] == "home"
    assert told["return"]["dwell_s"] == 300.0
    assert told["return"]["undelivered_to"] == "bellevue"
    assert told["arrival"]["delivery_mean_s"]["value"] == shown["mean_s"]
    assert any(bar["kind"] == "fly" and bar["where"].endswith("to bellevue") for bar in shown["bars"])
    ((name, content),) = export(None, shown["composition"], "plan.json", "round", {})
    (tmp_path / name).write_bytes(content)
    again = msgspec.convert(opened(str(tmp_path / name))["question"], Question)
    assert (again.return_to, again.dwell, again.if_undelivered) == ("home", "300s", "bellevue")
    same = plan(None, msgspec.to_builtins(msgspec.structs.replace(again, wind=question.wind)))["plans"][0]
    assert same["mean_s"] == shown["mean_s"]
    assert same["bars"] == shown["bars"]


def test_the_page_and_the_command_name_the_same_energies(capsys):
    question = Question(start="bellevue", to="jacobi", payload="0.8", depart="2013-07-10T14:00-04:00")
    shown = plan(None, msgspec.to_builtins(question))["plans"][0]
    words = [one for one in shlex.split(question.command(None)) if one not in {"skyway", "--explain"}]
    assert main([*words, "--json"]) == 0
    assert shown["energy_j"] / 3600.0 == pytest.approx(json.loads(capsys.readouterr().out)["energy_wh"])
    assert main(words) == 0
    told = capsys.readouterr().out
    tiles = figures(shown, Preferences())
    typically, on_average = (f"{shown[name] / 3600.0:.0f} Wh" for name in ("energy_j", "mean_energy_j"))
    assert typically != on_average
    assert f"<dt>energy, typically</dt><dd>{typically}<span class='small'>{on_average} on average; " in tiles
    (line,) = [one for one in told.splitlines() if one.startswith("Typical total:")]
    assert f"{typically} ({on_average} on average)" in line


def test_arrivals_beyond_the_axis_are_told_with_the_time_at_its_end():
    arrivals = {"edges_s": [3600.0, 7200.0, 10800.0], "share": [0.9, 0.095], "beyond": 0.005, "quantiles_s": {"0.5": 5000.0, "0.95": 7000.0}}  # fmt: skip
    told = drawn.arrivals({"arrivals": arrivals, "deadline_s": 18000.0, "depart_s": 3000.0}, UTC)
    assert ">0.5 % arrive after 03:00</text>" in told
    assert "later" not in told


def test_the_ground_of_the_map_is_that_of_the_terrain_model(hills):
    found = ground(str(hills))
    west, south, east, north = found["box"]
    rows, columns = found["rows"], found["columns"]
    terrain = read_terrain([str(hills / "terrain.tif")], [])
    import numpy as np

    for row, column in ((0, 0), (rows // 2, columns // 3), (rows - 1, columns - 1), (rows // 4, columns // 2)):
        y = [np.log(np.tan(np.pi / 4 + np.radians(lat) / 2)) for lat in (north, south)]  # Mercator, as a map is drawn
        lat = 2.0 * np.arctan(np.exp(y[0] + (y[1] - y[0]) * row / (rows - 1))) - np.pi / 2
        lon = west + (east - west) * column / (columns - 1)
        expected = terrain.ground_m(np.degrees(np.array([lat])), np.array([lon]))[0]
        told = found["heights_m"][row * columns + column]
        assert (told is None) == bool(np.isnan(expected))
        assert told is None or told == pytest.approx(expected, abs=0.51)
    assert ground(None) == {}


def test_zones_far_above_the_flights_do_not_close_the_map(hills):
    closed = {one["id"]: one["closed"] for one in region(str(hills))["zones"]}
    assert closed == {
        "HERON": True,
        "QUARRY": True,
        "FIELD": True,
        "AREA": False,
    }  # the last from 900 m above the sea on


def test_heights_over_terrain_are_drawn_with_the_least_clearance_in_the_units_wanted(hills):
    question = Question(start="depot", to="midvale", depart="2026-06-01T10:00Z", wind="6@250")
    found = plan(str(hills), msgspec.to_builtins(question))["plans"][0]["heights"]
    least_m = min(leg["least_m"] for leg in found)
    assert least_m >= 29.9  # what the scenario keeps
    assert f"least clearance {least_m:.0f} m" in drawn.heights(found, Preferences())
    assert f"least clearance {least_m / 0.3048:.0f} ft" in drawn.heights(found, Preferences(height="ft"))
    assert drawn.heights([], Preferences()) == ""


def test_commands_in_the_reasons_are_marked_up_and_what_is_said_is_escaped():
    found = {"reasons": [], "rests_on": [], "bound": "", "not_counted": [],
             "between_sites": ["No site measures the wind near <b>: 90 % keep the reserve;", "`skyway fly` turns back"]}  # fmt: skip
    told = "<p>No site measures the wind near &lt;b&gt;: 90 % keep the reserve; <code>skyway fly</code> turns back</p>"
    assert explained(found, Preferences()) == told
