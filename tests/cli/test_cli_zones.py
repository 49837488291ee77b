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
