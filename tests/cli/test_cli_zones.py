"""Zones that are handed over: recorded in the plan, and used again by what follows."""

import json

import pytest

ZONES = {
    "features": [
        {
            "identifier": "PARK", "name": "Park", "country": "USA", "restriction": "PROHIBITED", "applicability": [{"permanent": "YES"}],
            "geometry": [{"uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 80, "upperVerticalReference": "AGL",
                          "horizontalProjection": {"type": "Circle", "center": [-73.9215, 40.8435], "radius": 2200}}],
        }
    ]
}  # fmt: skip
ASKED = (
    "--from", "columbia", "--to", "montefiore", "--payload", "0.4", "--depart", "2013-07-10T14:00-04:00", "--drone", "m300",
)  # fmt: skip


def test_a_plan_names_its_zones_and_mission_reads_them_again(skyway, tmp_path):
    zones = tmp_path / "park.json"
    zones.write_text(json.dumps(ZONES), encoding="utf-8")
    plan = tmp_path / "plan.json"
    assert skyway("plan", *ASKED, "--wind", "5@270", "--zones", zones, "-o", plan).code == 0
    told = json.loads(plan.read_text(encoding="utf-8"))
    assert told["zones"] == [str(zones)]
    (leg,) = told["legs"]
    assert leg["via"] == ["over-PARK-1", "over-PARK-2"]
    assert skyway("mission", plan, "-o", tmp_path / "one.plan").code == 0
    taller = json.loads(json.dumps(ZONES).replace('"upperLimit": 80', '"upperLimit": 150'))
    zones.write_text(json.dumps(taller), encoding="utf-8")
    refused = skyway("mission", plan, "-o", tmp_path / "two.plan")
    assert refused.code == 1
    assert "PARK" in refused.err
    zones.unlink()
    missing = skyway("mission", plan, "-o", tmp_path / "three.plan")
    assert missing.code == 2
    assert "give the zones of the plan with --zones" in missing.err


@pytest.mark.slow
def test_evaluations_keep_out_of_zones(skyway, tmp_path):
    zones = tmp_path / "park.json"
    zones.write_text(json.dumps(ZONES).replace('"upperLimit": 80', '"upperLimit": 99999'), encoding="utf-8")
    means = []
    for more in ((), ("--zones", zones)):
        found = skyway("evaluate", *ASKED, "--days", "3", "--runs", "30", "--json", *more)
        assert found.code == 0, found.err
        means.append(json.loads(found.out)["flight_s"]["value"])
    assert means[1] > means[0] + 5.0


def test_zones_with_longitude_and_latitude_exchanged_are_refused_by_plan_mission_and_check(skyway, tmp_path):
    square = [[40.7, -73.9], [40.8, -73.9], [40.8, -73.8], [40.7, -73.8], [40.7, -73.9]]
    feature = {"type": "Feature", "properties": {"id": "z"}, "geometry": {"type": "Polygon", "coordinates": [square]}}
    swapped = tmp_path / "swapped.json"
    swapped.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    asked = (
        "--from",
        "bellevue",
        "--to",
        "jacobi",
        "--payload",
        "0.8",
        "--depart",
        "2013-07-10T14:00-04:00",
        "--wind",
        "5@270",
    )
    plan, mission = tmp_path / "p.json", tmp_path / "p.plan"
    assert skyway("plan", *asked, "--planner", "exact", "-o", plan).code == 0
    assert skyway("mission", plan, "-o", mission).code == 0
    zones = ("--zones", str(swapped))
    for words in (
        ("plan", *asked),
        ("mission", str(plan), "-o", str(tmp_path / "q.plan")),
        ("check", str(mission), "--depart", asked[7]),
    ):
        answer = skyway(*words, *zones)
        assert answer.code == 2, words
        assert "lat and lon look swapped" in answer.err
        assert "swapped.json" in answer.err
