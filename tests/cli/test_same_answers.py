"""The example with zones, ground and forecast: plan, mission, check, flight and report count with the same of each."""

import json
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from skyway.models.base import geodesy
from skyway.models.composition.file import load
from skyway.report.heights import planned_heights
from skyway.report.report import write_report
from skyway.scenarios import load_scenario
from skyway.sim_stub.faults import parse_fault
from tests.hills_example import FOLDER, files
from tests.link.hills_stage import HillsStage

FROM_TO = ("--from", "depot", "--to", "eastvale", "--payload", "0.8")
TEN, AFTER = "2026-06-01T10:00Z", "2026-06-01T11:05Z"
QUARRY, QUARRY_M = (45.0255, -30.03), 700.0
HERON_LON, HERON_TOP_M = (-30.158, -30.146), 75.0


@pytest.fixture
def example(skyway):
    assert skyway("scenario", "init", "hills", "--example", "hills").code == 0
    return skyway


def planned(skyway, name, depart, *more):
    answer = skyway("plan", "hills", *FROM_TO, "--depart", depart, "-o", name, *more)
    assert answer.code == 0, answer.err
    return json.loads(Path(name).read_text())


def via(plan):
    return {name.split("-")[1] for leg in plan["legs"] for name in leg["via"]}


def test_files_of_the_example_are_those_that_are_made():
    for name, text in files().items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, "run: python -m tests.hills_example"


def test_plan_mission_and_check_agree_on_zones_ground_and_wind(example):
    plan, after = planned(example, "plan.json", TEN), planned(example, "after.json", AFTER)
    assert via(plan) == {"HERON", "QUARRY"}
    assert via(after) == {"HERON"}  # blasting is over
    for name in ("plan", "after"):
        assert example("mission", f"{name}.json", "-o", f"{name}.plan").code == 0
    where = ("--scenario", "hills", "--payload", "0.8", "--json")
    checked = json.loads(example("check", "plan.plan", *where, "--depart", TEN).out)
    assert checked["ok"]
    early = example("check", "after.plan", *where, "--depart", TEN)
    assert early.code == 1
    errors = [one["message"] for one in json.loads(early.out)["findings"] if one["severity"] == "error"]
    assert errors
    assert all("QUARRY" in message for message in errors)
    for leg, seen, heights in zip(plan["legs"], checked["legs"], checked["heights"], strict=True):
        assert seen["energy_wh"] == pytest.approx(leg["energy_wh"], rel=0.06)
        assert seen["time_s"] == pytest.approx(leg["flight_time_s"], rel=0.06)
        mine = leg["heights"]
        same = np.interp(heights["along_m"], mine["along_m"], mine["ground_m"])
        np.testing.assert_allclose(heights["ground_m"], same, atol=2.0)
        assert heights["least_m"] == pytest.approx(mine["least_m"], abs=2.0)
        assert planned_heights(leg) is not None
    forecast = load_scenario(Path("hills")).forecast(datetime.fromisoformat(TEN), 6)
    a, b = (plan["stations"][plan["legs"][0][end]] for end in ("from", "to"))
    at = 0.5 * (a["lat"] + b["lat"]), 0.5 * (a["lon"] + b["lon"])
    speeds = np.hypot(*forecast.wind_at(*at, forecast.slot_at(datetime.fromisoformat(TEN).timestamp())))
    told = plan["legs"][0]["wind"]
    assert told["speed_mps"] == pytest.approx(float(forecast.probability @ speeds), rel=0.15)


@pytest.mark.parametrize("known", ["scenario", "files"])
def test_a_flight_after_a_hold_of_any_length_is_tested_from_then_on_and_from_its_own_ground(example, known):
    """Nobody knows when the second flight begins; a zone that ended before the first does not close it, and home is where it stands."""
    planned(example, "after.json", AFTER)
    assert example("mission", "after.json", "-o", "after.plan").code == 0
    alone = ("--terrain", "hills/terrain.tif", "--obstacles", "hills/obstacles.csv", "--zones", "hills/airspace.json")
    where = ("--scenario", "hills") if known == "scenario" else (*alone, "--authorized", "FIELD")
    late = example("check", "after.plan", *where, "--depart", AFTER, "--json")
    assert not [one for one in json.loads(late.out)["findings"] if one["code"] == "no-fly-zone"], late.out
    early = example(
        "check", "after.plan", *where, "--depart", "2026-06-01T10:30Z", "--json"
    )  # the hold may end before 11:00
    errors = [one["message"] for one in json.loads(early.out)["findings"] if one["code"] == "no-fly-zone"]
    assert errors
    assert all("QUARRY" in message for message in errors)


def test_compare_has_the_very_plans_of_plan_and_evaluate_says_what_it_lacks(example):
    plan = planned(example, "plan.json", TEN)
    (other,) = json.loads(example("compare", "hills", *FROM_TO, "--depart", TEN, "--planners", "robust", "--json").out)[
        "plans"
    ]
    for part in ("scenario", "stations", "legs", "zones", "terrain"):
        assert other["composition"].get(part) == plan.get(part), part
    assert via(other["composition"]) == {"HERON", "QUARRY"}
    refused = example("evaluate", "hills", *FROM_TO, "--depart", TEN)
    assert refused.code == 2
    assert "no wind record to hold days out of" in refused.err


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", [None, "battery-drop=0.45@T+160s"])
def test_a_flight_keeps_zones_and_ground_of_its_plan_and_of_its_diverts(example, tmp_path, autopilot, fault):
    plan = planned(example, "plan.json", TEN)
    stage = HillsStage(
        load(Path("plan.json")),
        tmp_path / "j.jsonl",
        autopilot=autopilot,
        faults=(parse_fault(fault),) if fault else (),
    )
    outcome = stage.fly()
    assert outcome.delivered, stage.lines
    assert any(line.startswith("divert: ") for line in stage.lines) == (fault is not None)
    time_s, lat, lon, height_m = np.array(stage.track).T
    ground_m = stage.region.network.over.terrain.ground_m(lat, lon)
    heron = (lon > HERON_LON[0]) & (lon < HERON_LON[1]) & (lat > 44.93) & (lat < 45.085)
    assert heron.sum() > 20
    assert (height_m - ground_m)[heron].min() >= HERON_TOP_M
    distance_m, _ = geodesy.inverse(lat, lon, *QUARRY)
    blasting = time_s < datetime.fromisoformat("2026-06-01T11:00Z").timestamp()
    assert distance_m[blasting].min() >= QUARRY_M
    away = (
        np.min([geodesy.inverse(lat, lon, one.lat, one.lon)[0] for one in stage.region.network.stations], axis=0)
        > 100.0
    )
    assert (height_m - ground_m)[away].min() >= 30.0
    if fault is None:
        flown_s = sum(leg["flight_time_s"] for leg in plan["legs"])
        assert len(stage.track) == pytest.approx(flown_s, rel=0.08)
    write_report(tmp_path / "j.jsonl", tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "least clearance" in page.lower()
    assert "Quarry" in page
