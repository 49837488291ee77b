"""Other people's missions, as they are in the wild: read, checked, written in both formats, read again."""

import pytest

from skyway.missions import FlightConditions, check
from skyway.missions.files import mission_file, plan_writer, waypoints_file
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import plain
from skyway.models.drones.drone import M200_V2

REFUSED = {
    "mavlink__qgroundcontrol_sample_wrong_mission_version.plan": "an unknown mission version",
}
EXPECTED = {
    "ardupilot__cmac-foamy-fence.txt": (0, 1, 0),
    "ardupilot__cmac-foamy-mission-ccw.txt": (11, 0, 0),
    "ardupilot__cmac-foamy-rally.txt": (0, 0, 1),
    "ardupilot__fence-110.txt": (0, 3, 0),
    "ardupilot__gates-rally.txt": (0, 0, 5),
    "ardupilot__rally-110.txt": (0, 0, 2),
    "ardupilot__sonoma-copter.txt": (76, 0, 0),
    "ardupilot__springvalleybottom-foamy-fence.txt": (0, 1, 0),
    "canberrauav__Dalby-fence.txt": (0, 1, 0),
    "canberrauav__Dalby-mission-Porter-north-takeoff.txt": (81, 23, 0),
    "canberrauav__fence.txt": (0, 1, 0),
    "canberrauav__mission-heli.txt": (56, 0, 0),
    "canberrauav__scrutineering-2014.txt": (21, 0, 0),
    "cubepilot__MissionPlanner.waypoints.txt": (14, 0, 0),
    "cubepilot__OldFileFormat.mission": (6, 0, 0),
    "cubepilot__SectionTest.plan": (5, 0, 0),
    "droneicarus__test2-Petite_mission_necssitant_une_recharge-generated.plan": (8, 0, 0),
    "droneicarus__test2-Petite_mission_necssitant_une_recharge.plan": (5, 0, 0),
    "dronekit__mpmission.txt": (6, 0, 0),
    "harry169__CMAC-VTOL-ccw.txt": (12, 0, 0),
    "harry169__copter_AVC2013_mission.txt": (9, 0, 0),
    "harry169__copter_mission.txt": (14, 0, 0),
    "harry169__copter_spline_mission.txt": (13, 0, 0),
    "kasperg3__uas_center_autonomous_flight.plan": (6, 0, 0),
    "luk8426__Mission1_Manching_2X.plan": (12, 5, 4),
    "luk8426__Mission31.plan": (5, 5, 4),
    "luk8426__V8_Gewicht_Absetzen.plan": (11, 5, 4),
    "mavlink__example-mission.plan": (5, 0, 2),
    "mavlink__mission_planner_sample.txt": (4, 0, 0),
    "mavlink__qgroundcontrol_sample.plan": (6, 0, 0),
    "mavlink__qgroundcontrol_sample_with_survey.plan": (13, 0, 0),
    "nxxvaa__mission.waypoints": (0, 1, 0),
    "raoskaran__final_mission.plan": (206, 7, 0),
    "xidian-uav__mission_px4.txt": (17, 0, 0),
}


@pytest.fixture
def real(shared_data):
    return lambda name: mission_file.read(shared_data / "missions" / name)


def test_every_file_is_expected_here(shared_data):
    names = {path.name for path in (shared_data / "missions").iterdir()} - {"README.md"}
    assert names == set(EXPECTED) | set(REFUSED)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_real_file_reads_and_comes_back_from_both_formats(real, name, tmp_path):
    document = real(name)
    parts = len(document.mission.items), len(document.fence.areas), len(document.rally)
    assert parts == EXPECTED[name]
    again = mission_file.loads(plan_writer.dumps(document).encode())
    assert again == document
    mission_file.write(document, tmp_path / "again.waypoints")
    text = mission_file.read(tmp_path / "again.waypoints")
    assert text.mission.items == document.mission.items
    assert text.mission.home == document.mission.home
    assert (text.fence, text.rally) == (document.fence, document.rally)
    # a second writing changes nothing
    assert plan_writer.dumps(again) == plan_writer.dumps(mission_file.loads(plan_writer.dumps(again).encode()))
    assert waypoints_file.dumps_mission(text) == waypoints_file.dumps_mission(document)


@pytest.mark.parametrize("name", EXPECTED)
@pytest.mark.parametrize("autopilot", [None, "px4", "ardupilot"])
def test_a_real_file_is_checked_to_the_end(real, name, autopilot):
    from skyway.missions import family_named

    report = check(real(name), dialect=family_named(autopilot) if autopilot else None)
    raw = plain(report)
    bad = any(f["severity"] == "error" or f["code"] == "battery-empty" for f in raw["findings"])
    assert raw["ok"] is not bad
    assert all(leg["distance_m"] >= 0 for leg in raw["legs"])


@pytest.mark.parametrize(("name", "reason"), REFUSED.items())
def test_a_file_that_cannot_be_flown_as_it_is_is_refused_with_the_reason(real, name, reason):
    with pytest.raises(InputError, match=reason):
        real(name)


def codes(report, severity=None):
    return {(f.code, f.item) for f in report.findings if severity in (None, f.severity)}


def test_the_delivery_contest_is_legal_inside_any_area_and_a_breach_inside_all(real):
    from skyway.missions import family_named

    document = real("luk8426__Mission1_Manching_2X.plan")
    assert not any(code == "outside-fence" for code, _ in codes(check(document, dialect=family_named("px4"))))
    breaches = [f for f in check(document, dialect=family_named("ardupilot")).findings if f.code == "outside-fence"]
    assert {f.item for f in breaches} == set(range(12))


def test_the_recharge_mission_of_another_planner_lands_delays_and_takes_off_again(real):
    from skyway.missions import family_named

    name = "droneicarus__test2-Petite_mission_necssitant_une_recharge-generated.plan"
    assert check(real(name)).legs[0].soc_end is None  # planned for an aeroplane, and nobody named the drone
    px4 = check(real(name), dialect=family_named("px4"), conditions=FlightConditions(M200_V2))
    assert ("px4-takeoff-not-first", 5) in codes(px4, "error")
    assert [(leg.item_from, leg.item_to) for leg in px4.legs] == [(0, 3), (5, 7)]
    assert px4.legs[1].soc_start > px4.legs[0].soc_end
    ardupilot = check(real(name), dialect=family_named("ardupilot"))
    assert ("ardupilot-land-ends-mission", 3) in codes(ardupilot)


def test_a_take_off_to_an_absolute_height_below_the_ground_is_found(real):
    report = check(real("dronekit__mpmission.txt"))
    assert ("takeoff-too-low", 0) in codes(report, "error")


def test_a_race_track_never_ends(real):
    report = check(real("ardupilot__sonoma-copter.txt"))
    assert ("endless-jump", 75) in codes(report)


def test_speeds_of_an_aeroplane_are_too_fast_for_a_multirotor(real):
    report = check(real("canberrauav__scrutineering-2014.txt"))
    assert ("speed-limit", 4) in codes(report, "warning")  # nobody named the vehicle


def test_a_fence_with_a_vertex_missing_is_an_error(real):
    report = check(real("nxxvaa__mission.waypoints"))
    assert ("fence-vertex-count", None) in codes(report, "error")


def test_a_survey_is_flown_item_by_item(real):
    document = real("mavlink__qgroundcontrol_sample_with_survey.plan")
    assert [item.command for item in document.mission.items[:4]] == [530, 16, 206, 16]
    assert '"complexItemType": "survey"' in plan_writer.dumps(document)
