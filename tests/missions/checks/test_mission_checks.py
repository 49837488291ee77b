"""Checks of any mission: what is wrong, where, and what would be right."""

import math
import random
from dataclasses import replace

import pytest

from skyway.missions import FlightConditions, check, family_named
from skyway.missions.checks.route import MAX_REPEATED_STEPS, fly
from skyway.missions.files import plan_reader, plan_writer
from skyway.missions.files.dropped import dropped
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base import geodesy
from skyway.models.base.json_text import json_text, plain
from skyway.models.drones.drone import M200_V2

NAMED = FlightConditions(M200_V2)
HOME = Home(Point.of_degrees(47.0, 8.0), 400.0)


def at(command, lat=47.0, lon=8.0, z=60.0, frame=Frame.GLOBAL_RELATIVE_ALT, **fields):
    point = Point.of_degrees(lat, lon)
    return MissionItem(command, frame, x=point.lat_e7, y=point.lon_e7, z=z, **fields)


TAKEOFF = at(Command.NAV_TAKEOFF)
AWAY = at(Command.NAV_WAYPOINT, 47.02)
LAND = at(Command.NAV_LAND, 47.02, z=0.0)
RETURN = MissionItem(Command.NAV_RETURN_TO_LAUNCH)


def jump(target, repeats):
    return MissionItem(Command.DO_JUMP, Frame.MISSION, float(target), float(repeats))


def speed(mps):
    return MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, mps, -1.0)


def found(*items, home=HOME, fence=None, rally=(), **options):
    document = MissionDocument(Mission(items, home), fence or Geofence(), RallyPoints(tuple(rally)))
    return {(f.severity, f.code, f.item) for f in check(document, **options).findings}


def square(lat, lon, size, inclusion=True):
    corners = [(lat - size, lon - size), (lat - size, lon + size), (lat + size, lon + size), (lat + size, lon - size)]
    return FencePolygon(tuple(Point.of_degrees(a, b) for a, b in corners), inclusion)


def test_a_sound_mission_has_no_findings():
    assert found(TAKEOFF, speed(12.0), AWAY, LAND) == set()
    assert found(TAKEOFF, AWAY, RETURN) == set()


def test_take_off_comes_first():
    assert ("error", "takeoff-not-first", 1) in found(AWAY, TAKEOFF, LAND)
    assert ("warning", "no-takeoff", 0) in found(AWAY, LAND)


def test_a_mission_ends_on_the_ground():
    assert found(TAKEOFF, AWAY) == {("error", "no-landing", 1)}
    loiter = at(Command.NAV_LOITER_UNLIM, 47.01)
    assert ("error", "never-lands", 2) in found(TAKEOFF, AWAY, loiter, LAND)


def test_nothing_to_fly_is_said_so():
    assert found() == {("info", "no-mission", None)}
    assert ("warning", "no-positions", None) in found(speed(3.0))


@pytest.mark.parametrize("target", [-1, 4, 99])
def test_jumps_lead_to_items_that_exist(target):
    assert ("error", "jump-target", 2) in found(TAKEOFF, AWAY, jump(target, 1), LAND)


def test_a_jump_to_itself_or_to_no_number_is_an_error():
    assert ("error", "jump-target", 2) in found(TAKEOFF, AWAY, jump(2, 1), LAND)
    assert ("error", "jump-target", 2) in found(TAKEOFF, AWAY, MissionItem(177, 2, math.nan), LAND)
    tag = MissionItem(Command.DO_JUMP_TAG, Frame.MISSION, 7.0, 1.0)
    assert ("error", "jump-target", 2) in found(TAKEOFF, AWAY, tag, LAND)


def test_an_endless_jump_is_followed_once_and_said_so():
    assert ("warning", "endless-jump", 2) in found(TAKEOFF, AWAY, jump(0, -1), LAND)
    assert fly(Mission((TAKEOFF, AWAY, jump(1, -1), LAND))).endless_jumps == (2,)


def test_what_lies_behind_an_endless_jump_is_checked_as_if_a_person_ended_it():
    far = at(Command.NAV_LAND, 48.0, z=3000.0)
    fence = Geofence((square(47.01, 8.0, 0.05),))
    behind = found(TAKEOFF, AWAY, jump(1, -1), at(Command.NAV_WAYPOINT, 48.0, z=3000.0), far, fence=fence)
    assert {("error", "outside-fence", 3), ("info", "high", 3), ("warning", "battery-empty", 4)} <= behind
    assert ("error", "no-landing", 3) in found(TAKEOFF, AWAY, jump(1, -1), at(Command.NAV_WAYPOINT, 47.01))
    assert {code for _, code, _ in found(TAKEOFF, AWAY, jump(1, -1))} == {"endless-jump"}
    nested = fly(Mission((TAKEOFF, AWAY, jump(1, -1), jump(0, -1), LAND)))
    assert nested.endless_jumps == (2, 3)
    assert nested.steps[-1].item == 4


def test_places_that_are_never_reached_are_told():
    behind = at(Command.NAV_WAYPOINT, 48.0, z=3000.0)
    assert found(TAKEOFF, AWAY, RETURN, behind, LAND) == {("warning", "never-reached", 3)}
    assert found(TAKEOFF, jump(3, -1), behind, AWAY, LAND) == {("warning", "never-reached", 2)}


def test_a_boat_need_not_take_off_nor_land():
    way = (AWAY, at(Command.NAV_WAYPOINT, 47.01, z=0.0))
    mission = Mission(way, HOME, firmware=3, vehicle_type=11)
    assert {(f.severity, f.code) for f in check(mission).findings} == {("warning", "not-for-the-air")}


def test_a_take_off_into_the_ground_is_told_wherever_the_vehicle_stands():
    here = MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, z=-10.0)
    assert ("error", "takeoff-too-low", 0) in found(here, AWAY, LAND, home=None)
    assert ("error", "takeoff-too-low", 0) in found(here, AWAY, LAND)
    assert not [f for f in found(replace(here, z=20.0), AWAY, LAND, home=None) if f[1] == "takeoff-too-low"]


@pytest.mark.parametrize("frame", [1, 2, 4, 7, 8, 12, 20, 21])
def test_a_place_in_a_frame_that_is_not_global_is_an_error(frame):
    local = at(Command.NAV_LAND, 10.0, 10.0, z=0.0, frame=frame)
    assert ("error", "not-global", 2) in found(TAKEOFF, AWAY, local)
    marker = at(Command.DO_LAND_START, 47.01, frame=Frame.MISSION)
    here = MissionItem(Command.NAV_LAND, Frame.MISSION)
    assert not [f for f in found(TAKEOFF, AWAY, marker, here) if f[1] == "not-global"]


@pytest.mark.parametrize("vehicle_type", [1, 19, 20, 22])
def test_an_aeroplane_that_nobody_named_is_not_judged_as_the_multirotor_that_is_assumed(vehicle_type):
    far = [at(Command.NAV_WAYPOINT, 47.0 + 0.08 * n) for n in range(1, 4)]
    mission = Mission((TAKEOFF, speed(24.0), *far, *far[::-1], *far, LAND), HOME, vehicle_type=vehicle_type)
    report = check(mission)
    assert {(f.severity, f.code) for f in report.findings} == {("warning", "not-a-multirotor")}
    assert not report.vehicle_judged
    assert all(leg["energy_wh"] is None and leg["distance_m"] > 0 for leg in plain(report)["legs"])
    named = check(mission, conditions=NAMED)
    assert {"speed-limit", "battery-empty"} <= {f.code for f in named.findings}


def test_every_warning_about_a_vehicle_that_is_assumed_says_so():
    mission = Mission((TAKEOFF, AWAY, LAND), HOME, hover_speed_mps=24.0)
    told = [f for f in check(mission).findings if f.code == "speed-not-held"]
    assert told
    assert all("(vehicle assumed: " in f.message for f in told)


def test_places_of_commands_without_a_name_are_no_fractions():
    there = MissionItem(116, Frame.GLOBAL_RELATIVE_ALT, x=-353_624_000, y=1_491_650_000, z=20.0)
    assert "fraction-lost" not in {code for _, code, _ in found(TAKEOFF, there, AWAY, LAND)}
    pasted = MissionItem(Command.DO_MOUNT_CONTROL, Frame.MISSION, 25.0, x=473_977_656, y=85_454_441, z=2.0)
    assert "fraction-lost" not in {code for _, code, _ in found(TAKEOFF, pasted, AWAY, LAND)}
    plain = MissionItem(116, Frame.MISSION, x=15_000_000)
    assert ("warning", "fraction-lost", 1) in found(TAKEOFF, plain, AWAY, LAND)


def test_altitudes_above_terrain_of_older_qgroundcontrol_are_understood_and_kept():
    old = {"Altitude": 50, "AltitudeMode": 2, "AMSLAltAboveTerrain": 460.0}
    terrain = at(Command.NAV_WAYPOINT, 47.01, z=460.0, frame=Frame.GLOBAL, extra=old)
    assert found(TAKEOFF, terrain, AWAY, LAND) == set()
    document = MissionDocument(Mission((TAKEOFF, terrain, LAND), HOME))
    assert any("1 items were computed above terrain" in line for line in dropped(document, ".waypoints"))
    written = plan_reader.loads(plan_writer.dumps(document)).mission.items[1]
    assert written.extra == {**old, "AltitudeMode": 3}
    framed = replace(terrain, frame=Frame.GLOBAL_TERRAIN_ALT, z=50.0)
    assert not framed.was_planned_above_terrain


def test_an_altitude_that_qgroundcontrol_shows_otherwise_is_told():
    odd = at(Command.NAV_WAYPOINT, 47.01, z=60.0, extra={"Altitude": 3, "AltitudeMode": 1})
    assert found(TAKEOFF, odd, AWAY, LAND) == {("warning", "altitude-disagrees", 1)}
    huge = at(Command.NAV_WAYPOINT, 47.01, z=60.0, extra={"Altitude": 10**400, "AltitudeMode": 1})
    assert found(TAKEOFF, huge, AWAY, LAND) == {("warning", "altitude-disagrees", 1)}
    terrain = at(Command.NAV_WAYPOINT, 47.01, z=460.0, frame=Frame.GLOBAL, extra={"Altitude": 50, "AltitudeMode": 3})
    assert found(TAKEOFF, terrain, AWAY, LAND) == set()


def test_a_take_off_after_an_item_without_a_position_is_still_the_first():
    here = MissionItem(Command.NAV_LOITER_TIME, Frame.GLOBAL_RELATIVE_ALT, 5.0, z=60.0)
    assert ("error", "takeoff-not-first", 1) not in found(here, TAKEOFF, AWAY, LAND)


def test_coordinates_that_an_item_does_not_use_are_not_judged():
    pasted = {"x": 473_971_234, "y": 85_481_234, "z": 20.0}
    change = MissionItem(Command.DO_CHANGE_SPEED, Frame.GLOBAL_RELATIVE_ALT, 1.0, 12.0, -1.0, **pasted)
    back = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.GLOBAL_RELATIVE_ALT, **pasted)
    assert found(TAKEOFF, change, AWAY, back) == set()


def test_the_place_of_a_take_off_that_ardupilot_ignores_is_not_judged():
    elsewhere = at(Command.NAV_TAKEOFF, 10.0, 20.0)
    fence = Geofence((square(47.01, 8.0, 0.05),))
    assert found(elsewhere, AWAY, LAND, fence=fence, dialect=family_named("ardupilot")) == set()
    assert ("error", "outside-fence", 0) in found(elsewhere, AWAY, LAND, fence=fence, dialect=family_named("px4"))


def test_jumps_are_followed_as_often_as_they_say():
    route = fly(Mission((TAKEOFF, AWAY, at(Command.NAV_WAYPOINT), jump(1, 2), LAND)))
    assert [step.item for step in route.steps] == [0, 1, 2, 1, 2, 1, 2, 4]
    tagged = MissionItem(Command.JUMP_TAG, Frame.MISSION, 7.0)
    back = MissionItem(Command.DO_JUMP_TAG, Frame.MISSION, 7.0, 1.0)
    assert [s.item for s in fly(Mission((TAKEOFF, tagged, AWAY, back, LAND))).steps] == [0, 2, 2, 4]


def test_jumps_within_jumps_end_even_where_they_would_take_years():
    nested = (TAKEOFF, AWAY, *(jump(1, 30_000) for _ in range(10)), LAND)
    route = fly(Mission(nested))
    assert route.is_cut
    assert len(route.steps) <= MAX_REPEATED_STEPS + len(nested)
    assert ("warning", "too-many-repeats", None) in found(*nested)


def test_speeds_stay_within_what_the_vehicle_flies():
    assert ("error", "speed-limit", 1) in found(TAKEOFF, speed(25.0), AWAY, LAND, conditions=NAMED)
    assert ("warning", "speed-missing", 1) in found(TAKEOFF, speed(0.0), AWAY, LAND)


def test_distances_stay_within_reach():
    assert ("warning", "far-from-home", 0) in found(at(Command.NAV_TAKEOFF, 47.5), at(Command.NAV_LAND, 47.5, z=0.0))
    far = found(TAKEOFF, at(Command.NAV_WAYPOINT, 48.0), at(Command.NAV_WAYPOINT, 40.0), LAND, conditions=NAMED)
    assert ("error", "too-far", 2) in far


def test_what_only_an_assumed_vehicle_cannot_do_is_a_warning():
    beyond = (TAKEOFF, speed(25.0), at(Command.NAV_WAYPOINT, 48.0), at(Command.NAV_WAYPOINT, 40.0), LAND)
    severities = {severity for severity, _, _ in found(*beyond)}
    assert severities == {"warning"}
    assert "error" in {severity for severity, _, _ in found(*beyond, conditions=NAMED)}


def test_a_mission_whose_battery_is_empty_is_never_ok_whoever_flies_it():
    mission = Mission((TAKEOFF, AWAY, at(Command.NAV_WAYPOINT, 50.0), at(Command.NAV_LAND, 50.0, z=0.0)), HOME)
    assumed, named = check(mission), check(mission, conditions=NAMED)
    assert {f.severity for f in assumed.findings} == {"warning"}
    assert not assumed.ok
    assert not named.ok
    told = next(f.message for f in assumed.findings if f.code == "battery-empty")
    assert "begins with 100 %" in told


def test_rally_points_far_from_the_route_are_told_with_their_distance():
    rally = [RallyPoint(Point.of_degrees(47.01, 8.0), 60.0), RallyPoint(Point.of_degrees(47.01, 8.224), 60.0)]
    document = MissionDocument(Mission((TAKEOFF, AWAY, LAND), HOME), Geofence(), RallyPoints(tuple(rally)))
    [finding] = check(document).findings
    assert (finding.severity, finding.code) == ("warning", "rally-far")
    assert "rally point 1 is 17.1 km from here" in finding.message
    long_way = (TAKEOFF, at(Command.NAV_WAYPOINT, 47.05), at(Command.NAV_LAND, 47.05, z=0.0))
    aside = [RallyPoint(Point.of_degrees(47.05, 8.066), 60.0)]
    assert found(*long_way, rally=aside) == {("info", "rally-far", 1)}


def test_heights_are_above_the_ground():
    assert ("error", "takeoff-too-low", 0) in found(at(Command.NAV_TAKEOFF, z=1.0), AWAY, LAND)
    assert ("warning", "not-above-ground", 1) in found(TAKEOFF, at(Command.NAV_WAYPOINT, 47.01, z=-5.0), LAND)
    downhill = (TAKEOFF, AWAY, at(Command.NAV_LAND, 47.02, z=-100.0))
    assert found(*downhill) == set()
    assert ("info", "high", 1) in found(TAKEOFF, at(Command.NAV_WAYPOINT, 47.01, z=300.0), LAND)
    assert ("error", "no-altitude", 1) in found(TAKEOFF, at(Command.NAV_WAYPOINT, 47.01, z=math.nan), LAND)
    half = replace(at(Command.NAV_WAYPOINT, 47.01), x=None)
    assert ("error", "half-a-place", 1) in found(TAKEOFF, half, LAND)


def test_heights_above_sea_level_need_the_height_of_home():
    absolute = at(Command.NAV_WAYPOINT, 47.01, z=380.0, frame=Frame.GLOBAL)
    assert ("warning", "not-above-ground", 1) in found(TAKEOFF, absolute, LAND)
    assert ("info", "height-reference", 1) in found(TAKEOFF, absolute, LAND, home=Home(HOME.point, None))
    report = check(Mission((TAKEOFF, absolute, RETURN), Home(HOME.point, None)))
    (told,) = [one.message for one in report.findings if one.code == "height-reference"]
    assert told.startswith("1 height above sea level")


def test_parameters_left_open_where_the_command_does_not_allow_it_are_told():
    assert ("info", "parameter-not-given", 1) in found(TAKEOFF, MissionItem(93, 2, 5.0, math.nan), AWAY, LAND)
    loiter = at(Command.NAV_LOITER_UNLIM, 47.02, param4=math.nan)  # PX4: the yaw as it is, which is not 0
    told = {name: found(TAKEOFF, loiter, dialect=family_named(name)) for name in ("px4", "ardupilot")}
    assert ("info", "parameter-not-given", 1) in told["ardupilot"]
    assert ("info", "parameter-not-given", 1) not in told["px4"]
    assert found(TAKEOFF, at(Command.NAV_WAYPOINT, 47.01, param4=math.nan), LAND) == set()


def test_a_fraction_that_the_wire_cannot_carry_is_told():
    actuator = MissionItem(Command.DO_SET_ACTUATOR, Frame.MISSION, 0.5, x=5_000_000)
    assert ("warning", "fraction-lost", 1) in found(TAKEOFF, actuator, AWAY, LAND)


def test_the_route_stays_in_the_fence():
    inside, small = Geofence((square(47.0, 8.0, 0.05),)), Geofence((square(47.0, 8.0, 0.01),))
    assert found(TAKEOFF, AWAY, LAND, fence=inside) == set()
    assert ("error", "outside-fence", 1) in found(TAKEOFF, AWAY, LAND, fence=small)


def test_the_way_between_two_positions_inside_may_still_leave_the_fence():
    corners = [(46.9, 7.9), (46.9, 8.1), (47.1, 8.1), (47.1, 8.05), (46.95, 8.0), (47.1, 7.95), (47.1, 7.9)]
    bay = Geofence((FencePolygon(tuple(Point.of_degrees(*c) for c in corners)),))
    west, east = at(Command.NAV_TAKEOFF, 47.05, 7.92), at(Command.NAV_WAYPOINT, 47.05, 8.08)
    result = found(west, east, at(Command.NAV_LAND, 47.05, 8.08, z=0.0), fence=bay, home=None)
    assert ("error", "outside-fence", 1) in result


def test_exclusion_areas_are_kept_out_of():
    pond = Geofence((square(47.01, 8.0, 0.002, False),), (FenceCircle(Point.of_degrees(47.3, 8.3), 100.0, False),))
    assert found(TAKEOFF, AWAY, LAND, fence=pond) == {("error", "in-exclusion-area", 1)}
    dome = Geofence((), (FenceCircle(Point.of_degrees(47.0, 8.0), 3000.0),))
    assert found(TAKEOFF, AWAY, LAND, fence=dome) == set()


def test_two_inclusion_areas_mean_any_to_px4_and_all_to_ardupilot():
    two = Geofence((square(47.01, 8.0, 0.02), square(48.0, 9.0, 0.02)))
    assert found(TAKEOFF, AWAY, LAND, fence=two, dialect=family_named("px4")) == set()
    codes = {code for _, code, _ in found(TAKEOFF, AWAY, LAND, fence=two, dialect=family_named("ardupilot"))}
    assert codes == {"outside-fence", "ardupilot-inclusion-areas"}


def test_a_fence_that_is_broken_is_an_error_of_its_own():
    bow_tie = FencePolygon(tuple(Point.of_degrees(*c) for c in [(47, 8), (47.1, 8.1), (47.1, 8), (47, 8.1)]))
    assert ("error", "fence-crosses-itself", None) in found(TAKEOFF, AWAY, LAND, fence=Geofence((bow_tie,)))


def test_rally_points_and_the_ways_there_stay_in_the_fence():
    fence = Geofence((square(47.01, 8.0, 0.02),))
    outside = RallyPoint(Point.of_degrees(47.5, 8.0), 60.0)
    assert ("error", "rally-outside-fence", None) in found(TAKEOFF, AWAY, LAND, fence=fence, rally=[outside])
    ring = [(46.9, 7.9), (46.9, 8.1), (47.1, 8.1), (47.1, 8.05), (46.95, 8.0), (47.1, 7.95), (47.1, 7.9)]
    bay = Geofence((FencePolygon(tuple(Point.of_degrees(*c) for c in ring)),))
    across = RallyPoint(Point.of_degrees(47.05, 8.08), 60.0)
    west = at(Command.NAV_TAKEOFF, 47.05, 7.92)
    result = found(west, at(Command.NAV_LAND, 47.05, 7.92, z=0.0), fence=bay, rally=[across], home=None)
    assert ("warning", "divert-outside-fence", 0) in result


def test_thousands_of_rally_points_need_no_more_memory_than_they_must():
    import tracemalloc

    fence = Geofence((square(47.01, 8.0, 0.5),))
    rally = [RallyPoint(Point.of_degrees(47.0 + i * 1e-6, 8.0), 60.0) for i in range(10_000)]
    way = [at(Command.NAV_WAYPOINT, 47.0 + i * 1e-6) for i in range(10_000)]
    tracemalloc.start()
    found(TAKEOFF, *way, LAND, fence=fence, rally=rally)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6


def test_each_far_rally_point_is_told_with_the_nearest_place_of_the_route():
    """Against every geodesic, on routes around the pole and over the antimeridian, with places that come twice."""
    luck = random.Random(5)
    for south, north, west, east in 4 * (
        (85.0, 89.9, -180.0, 180.0), (-20.0, -15.0, 177.0, 183.0), (46.0, 47.0, 7.0, 9.0)
    ):  # fmt: skip

        def place(margin, bounds=(south, north, west, east)):
            lat = luck.uniform(bounds[0] - margin, min(bounds[1] + margin, 90.0))
            return lat, (luck.uniform(bounds[2] - margin, bounds[3] + margin) + 180.0) % 360.0 - 180.0

        way = [at(Command.NAV_WAYPOINT, *place(0.0)) for _ in range(30)]
        way = [TAKEOFF, *way, *way[:10]]
        rally = [RallyPoint(Point.of_degrees(*place(3.0)), 60.0) for _ in range(20)]
        document = MissionDocument(Mission(tuple(way), HOME), Geofence(), RallyPoints(tuple(rally)))
        told = {f.message.split(" from here")[0]: f.item for f in check(document).findings if f.code == "rally-far"}
        expected = {}
        for number, one in enumerate(rally):
            every = [geodesy.distance_m(one.point.lat, one.point.lon, w.x / 1e7, w.y / 1e7) for w in way]
            if min(every) > 5000.0:
                expected[f"rally point {number} is {min(every) / 1000:.1f} km"] = every.index(min(every))
        assert told == expected
        assert len(told) > 10


def test_no_fly_zones_are_not_crossed():
    import shapely

    from skyway.models.airspace.airspace import Airspace

    zone = Airspace.of_polygons(("airport",), (shapely.box(7.99, 47.005, 8.01, 47.01),))
    assert found(TAKEOFF, AWAY, LAND, zones=zone) == {("error", "no-fly-zone", 1)}
    aside = Airspace.of_polygons(("airport",), (shapely.box(8.01, 46.99, 8.02, 47.03),))
    assert found(TAKEOFF, AWAY, LAND, zones=aside) == set()
    beyond = [RallyPoint(Point.of_degrees(47.0, 8.05), 60.0)]
    assert found(TAKEOFF, AWAY, LAND, zones=aside, rally=beyond) == {("warning", "divert-through-zone", 0)}


def test_what_the_named_autopilot_cannot_fly_is_found_without_asking():
    mission = Mission((TAKEOFF, AWAY, LAND, at(Command.NAV_TAKEOFF, 47.02), AWAY, LAND), HOME, firmware=12)
    assert "px4-takeoff-not-first" in {finding.code for finding in check(mission).findings}


def test_floods_of_one_kind_are_counted_instead_of_repeated():
    low = [at(Command.NAV_WAYPOINT, 47.0 + i * 1e-5, z=-1.0) for i in range(100)]
    report = check(Mission((TAKEOFF, *low, at(Command.NAV_LAND, z=0.0)), HOME))
    told = [finding for finding in report.findings if finding.code == "not-above-ground"]
    assert len(told) == 21
    assert told[-1].message.startswith("80 more items")


def test_errors_come_first_and_a_report_is_plain_json():
    import json

    report = check(Mission((AWAY, TAKEOFF, speed(25.0)), HOME))
    order = [finding.severity for finding in report.findings]
    assert order == sorted(order, key=["error", "warning", "info"].index)
    raw = json.loads(json_text(report))
    assert raw["schema"] == "skyway.check/1"
    assert raw["ok"] is False
    assert set(raw["findings"][0]) == {"severity", "item", "code", "message", "remedy"}
    keys = {"item_from", "item_to", "distance_m", "time_s", "energy_wh", "soc_end", "p_reserve"}
    assert set(raw["legs"][0]) == keys


def legs_of(*items, home=HOME, **fields):
    return check(Mission(items, home, **fields), conditions=NAMED).legs


def test_without_a_home_the_way_back_counts_to_the_first_place():
    flight = (TAKEOFF, AWAY, RETURN)
    (known,), (unknown,) = legs_of(*flight), legs_of(*flight, home=None)
    assert unknown.distance_m == pytest.approx(known.distance_m) == pytest.approx(2 * 2224, rel=1e-3)
    assert unknown.energy_j == pytest.approx(known.energy_j)
    assert found(*flight, home=None, conditions=NAMED) == {("info", "home-unknown", 0)}
    assert found(TAKEOFF, AWAY, LAND, home=None, conditions=NAMED) == set()


def test_an_unknown_way_to_the_first_place_is_a_warning():
    here = MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, z=60.0)
    assert ("warning", "home-unknown", 1) in found(here, AWAY, RETURN, home=None)
    assert ("warning", "home-unknown", 1) not in found(here, AWAY, RETURN)


@pytest.mark.parametrize(
    ("radius_m", "speed_mps", "turn_s"),
    [
        (0.0, 5.0, 18.0),  # CIRCLE_RADIUS 10 m at CIRCLE_RATE 20 degrees a second
        (5.0, 5.0, 18.0),
        (-30.0, 12.0, 2 * math.pi * 30 / math.sqrt(0.5 * 2.5 * 30)),  # half of WPNAV_ACCEL
        (50.0, 2.0, 2 * math.pi * 50 / 2),
    ],
)
def test_circles_take_as_long_as_ardupilot_flies_them(radius_m, speed_mps, turn_s):
    circles = at(Command.NAV_LOITER_TURNS, 47.02, param1=10.0, param3=radius_m)
    (with_them,) = legs_of(TAKEOFF, speed(speed_mps), circles, RETURN, firmware=3)
    (without,) = legs_of(TAKEOFF, speed(speed_mps), AWAY, RETURN, firmware=3)
    assert with_them.time_s - without.time_s == pytest.approx(10 * turn_s, rel=1e-6)


def test_exchanged_coordinates_are_named():
    exchanged = at(Command.NAV_WAYPOINT, 8.0, 47.02)
    findings = check(Mission((TAKEOFF, exchanged, RETURN), HOME)).findings
    assert next(one for one in findings if one.code == "too-far").remedy.startswith("latitude and longitude look exch")
    far = at(Command.NAV_WAYPOINT, 40.0, 8.0)
    findings = check(Mission((TAKEOFF, far, RETURN), HOME)).findings
    assert next(one for one in findings if one.code == "too-far").remedy.startswith("correct the coordinates")


def test_corrections_leave_a_pattern_editable():
    from skyway.missions.checks.fixes import fixed

    shot = {"type": "SimpleItem", "command": 2000, "frame": 2, "autoContinue": True, "params": [0, 0, 1, *[None] * 4]}
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "TransectStyleComplexItem": {"version": 1, "Items": [shot]},
    }
    document = plan_reader.loads(
        f'{{"fileType": "Plan", "mission": {{"items": {json_text([survey, shot])}}}}}'  # one in the survey, one after it
    )
    mended, told = fixed(document, check(document).findings)
    assert [line.split(":")[0] for line in told] == ["item 1"]
    again = plan_reader.loads(plan_writer.dumps(mended))
    assert [dict(one.source) for one in again.mission.complex_items] == [survey]
    assert again.mission.items[0] == document.mission.items[0]
    assert again.mission.items[1].param4 == 0.0


def test_a_wait_until_a_time_of_day_is_told():
    until = MissionItem(Command.NAV_DELAY, Frame.MISSION, -1.0, 14.0, 30.0, 0.0)
    findings = check(Mission((TAKEOFF, AWAY, until, LAND), HOME), conditions=NAMED).findings
    assert [(one.code, one.item, one.message[:24]) for one in findings] == [
        ("wait-not-counted", 2, "waits until 14:30:00 UTC")
    ]
    lasting = MissionItem(Command.NAV_DELAY, Frame.MISSION, 20.0, -1.0, -1.0, -1.0)
    assert found(TAKEOFF, AWAY, lasting, LAND, conditions=NAMED) == set()
