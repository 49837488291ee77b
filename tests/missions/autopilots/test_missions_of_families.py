"""Each autopilot's way with missions: every trap that was seen in flight is met here."""

import math
from dataclasses import replace

import pytest

from skyway.missions.autopilots.ardupilot import family as ardupilot
from skyway.missions.autopilots.px4 import family as px4
from skyway.missions.autopilots.registry import family_named, family_of
from skyway.missions.autopilots.wire import (
    fence_from_wire,
    fence_to_wire,
    from_wire,
    rally_from_wire,
    rally_to_wire,
    to_wire,
)
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.items.parameters import FlightNeeds
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import InputError

PX4, ARDUPILOT = family_named("px4"), family_named("ardupilot")
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=lambda d: d.name)


def at(command, lat=47.0, lon=8.0, z=60.0, **fields):
    point = Point.of_degrees(lat, lon)
    fields = {"param4": math.nan, **fields}
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=z, **fields)


TAKEOFF, LAND = at(Command.NAV_TAKEOFF), at(Command.NAV_LAND, 47.1, z=0.0)
WAYPOINT, ABOVE = at(Command.NAV_WAYPOINT, 47.05), at(Command.NAV_WAYPOINT, 47.1)
DELAY = MissionItem(Command.NAV_DELAY, Frame.MISSION, 600.0)
DISARM = MissionItem(Command.COMPONENT_ARM_DISARM, Frame.MISSION, 0.0)


def found(autopilot, *items, fence=None):
    document = MissionDocument(Mission(items), fence or Geofence())
    return {(finding.code, finding.item) for finding in autopilot.cannot_fly(document)}


def test_ardupilots_item_0_is_home_so_the_first_item_is_not_lost():
    wire = ARDUPILOT.to_wire(Mission((TAKEOFF, LAND)))
    assert [(w.seq, w.command) for w in wire] == [(0, 16), (1, 22), (2, 21)]
    assert (wire[0].x, wire[0].y) == (0, 0)
    home = Home(Point.of_degrees(47, 8), 400.0)
    assert ARDUPILOT.to_wire(Mission((TAKEOFF,), home))[0].z == 400.0


def test_px4_numbers_items_as_we_do():
    wire = PX4.to_wire(Mission((TAKEOFF, LAND)))
    assert [(w.seq, w.command) for w in wire] == [(0, 22), (1, 21)]


def test_jumps_and_the_current_item_shift_with_ardupilots_home():
    jump = MissionItem(Command.DO_JUMP, Frame.MISSION, 1.0, 2.0)
    mission = Mission((TAKEOFF, WAYPOINT, jump, LAND))
    ours, theirs = PX4.to_wire(mission, current=1), ARDUPILOT.to_wire(mission, current=1)
    assert (ours[2].param1, [w.current for w in ours]) == (1.0, [0, 1, 0, 0])
    assert (theirs[3].param1, [w.current for w in theirs]) == (2.0, [0, 0, 1, 0, 0])
    assert ARDUPILOT.from_wire(theirs).items[2].jump_target == 1


def test_places_of_commands_without_a_name_travel_as_places_as_from_qgroundcontrol():
    there = MissionItem(116, Frame.GLOBAL_RELATIVE_ALT, x=-353_624_001, y=1_491_650_003, z=20.0)
    wire = to_wire(there, 0)
    assert (wire.x, wire.y) == (-353_624_001, 1_491_650_003)
    assert from_wire(wire) == there
    plain = MissionItem(116, Frame.MISSION, x=50_000_000, y=0)
    assert (to_wire(plain, 0).x, from_wire(to_wire(plain, 0))) == (5, plain)


@BOTH
def test_of_a_command_without_a_name_it_is_said_that_no_known_version_has_it(autopilot):
    message = next(f.message for f in autopilot.cannot_fly(MissionDocument(Mission((TAKEOFF, MissionItem(219), LAND)))))
    assert "no known version has MAV_CMD 219 in missions" in message


@BOTH
def test_a_mission_comes_back_from_the_wire_with_its_places_and_jumps(autopilot):
    jump = MissionItem(Command.DO_JUMP, Frame.MISSION, 1.0, 2.0)
    mission = Mission((TAKEOFF, WAYPOINT, jump, LAND))
    assert autopilot.from_wire(autopilot.to_wire(mission)).items == mission.items


def test_ardupilot_is_given_nan_only_as_a_yaw():
    odd = MissionItem(Command.NAV_DELAY, Frame.MISSION, 60.0, math.nan, math.nan, math.nan)
    landing = replace(LAND, param1=math.nan)
    wire = ARDUPILOT.to_wire(Mission((odd, landing)))
    assert (wire[1].param2, wire[1].param3, wire[1].param4) == (0.0, 0.0, 0.0)
    assert wire[2].param1 == 0.0
    assert math.isnan(wire[2].param4)


def test_px4_gets_delays_and_speeds_in_frame_mission():
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.GLOBAL_RELATIVE_ALT, 1.0, 12.0, -1.0)
    delay = replace(DELAY, frame=Frame.GLOBAL)
    assert [w.frame for w in PX4.to_wire(Mission((speed, delay, LAND)))] == [2, 2, 3]


def test_a_plain_value_is_not_scaled_like_a_coordinate():
    camera = MissionItem(Command.DO_DIGICAM_CONTROL, Frame.MISSION, x=10_000_000, y=0)
    wire = PX4.to_wire(Mission((camera, WAYPOINT)))
    assert wire[0].x == 1
    assert wire[1].x == 470500000
    assert from_wire(wire[0]) == camera


def test_a_position_without_an_altitude_cannot_be_sent():
    for autopilot in (PX4, ARDUPILOT):  # the item is named by our number, not the autopilot's
        with pytest.raises(InputError, match="item 1: has no altitude"):
            autopilot.to_wire(Mission((TAKEOFF, replace(WAYPOINT, z=math.nan))))


def test_a_place_that_is_not_given_is_here():
    assert PX4.to_wire(Mission((replace(LAND, x=None, y=None),)))[0].x == 0


def test_px4_denies_a_second_takeoff_and_ardupilot_needs_one():
    legs = (TAKEOFF, WAYPOINT, LAND, DELAY, ABOVE, WAYPOINT, LAND)
    again = (TAKEOFF, WAYPOINT, LAND, DELAY, at(Command.NAV_TAKEOFF, 47.1), WAYPOINT, LAND)
    assert found(PX4, *again) == {("px4-takeoff-not-first", 4)}
    assert found(PX4, *legs) == set()
    assert ("ardupilot-no-takeoff", 4) in found(ARDUPILOT, *legs)
    assert found(ARDUPILOT, *again) == {("ardupilot-land-ends-mission", 2)}


def test_setting_home_or_a_region_of_interest_before_take_off_is_no_position():
    home = at(Command.DO_SET_HOME)
    assert found(PX4, home, TAKEOFF, WAYPOINT, LAND) == set()


def test_px4_leaving_a_pad_sideways_is_an_error():
    assert ("px4-sideways-after-land", 4) in found(PX4, TAKEOFF, WAYPOINT, LAND, DELAY, WAYPOINT, LAND)


def test_ardupilot_has_no_disarm_item_and_needs_none():
    assert ("ardupilot-unsupported-command", 2) in found(ARDUPILOT, TAKEOFF, LAND, DISARM)
    assert found(PX4, TAKEOFF, LAND, DISARM) == set()
    assert ARDUPILOT.disarm() == ()
    assert PX4.disarm() == (DISARM,)


def test_commands_and_frames_that_an_autopilot_refuses_are_named():
    spline = at(Command.NAV_SPLINE_WAYPOINT)
    terrain = replace(WAYPOINT, frame=Frame.GLOBAL_TERRAIN_ALT)
    assert found(PX4, TAKEOFF, spline, LAND) == {("px4-unsupported-command", 1)}
    assert found(PX4, TAKEOFF, terrain, LAND) == {("px4-unsupported-frame", 1)}
    assert found(ARDUPILOT, TAKEOFF, spline, terrain, LAND) == set()
    assert ("ardupilot-unsupported-command", 1) in found(ARDUPILOT, TAKEOFF, MissionItem(31014), LAND)


def test_a_position_of_zero_zero_is_here_for_ardupilot_only():
    nowhere = replace(WAYPOINT, x=0, y=0)
    assert found(PX4, TAKEOFF, nowhere, LAND) == {("px4-no-position", 1)}
    assert found(ARDUPILOT, TAKEOFF, nowhere, LAND) == set()


def test_a_hold_longer_than_16_bits_is_an_error_on_ardupilot():
    assert found(ARDUPILOT, TAKEOFF, replace(WAYPOINT, param1=70_000.0), LAND) == {("ardupilot-hold-too-long", 1)}


def test_a_delay_of_zero_lasts_until_midnight_on_ardupilot():
    assert ("ardupilot-delay-until-midnight", 2) in found(ARDUPILOT, TAKEOFF, LAND, replace(DELAY, param1=0.0), TAKEOFF)
    clock = replace(DELAY, param1=0.0, param2=14.0)
    assert not any("midnight" in code for code, _ in found(ARDUPILOT, TAKEOFF, clock, WAYPOINT, LAND))


def test_several_inclusion_areas_mean_all_of_them_to_ardupilot():
    ring = (Point(0, 0), Point(0, 9), Point(9, 9))
    fence = Geofence((FencePolygon(ring), FencePolygon(ring)))
    assert found(ARDUPILOT, TAKEOFF, LAND, fence=fence) == {("ardupilot-inclusion-areas", None)}
    assert found(PX4, TAKEOFF, LAND, fence=fence) == set()


def test_more_items_than_usual_storage_holds_are_a_warning():
    assert ("ardupilot-many-items", None) in found(ARDUPILOT, TAKEOFF, *[WAYPOINT] * 800, LAND)


def test_a_fence_on_the_wire_carries_its_vertex_counts():
    ring = (Point(0, 0), Point(0, 90), Point(90, 90), Point(90, 0))
    fence = Geofence(
        (FencePolygon(ring), FencePolygon(ring[:3], False)), (FenceCircle(Point(5, 5), 30.0),), Point(1, 1)
    )
    wire = fence_to_wire(fence)
    assert [w.param1 for w in wire] == [0, 4, 4, 4, 4, 3, 3, 3, 30]
    assert {w.mission_type for w in wire} == {1}
    assert fence_from_wire(wire) == fence


def test_rally_points_on_the_wire_are_above_home():
    rally = RallyPoints((RallyPoint(Point(5, 5), 60.0),))
    wire = rally_to_wire(rally)
    assert (wire[0].mission_type, wire[0].frame, wire[0].command) == (2, 3, 5100)
    assert rally_from_wire(wire) == rally


def parameters(autopilot, **needs):
    asked = FlightNeeds(14.0, 5.0, 3.0, 130.0, **needs)
    ways = [way for parameter in autopilot.parameters(asked) for way in parameter.ways]
    return {way.name: (way.rule, way.value) for way in reversed(ways)}


def test_speed_limits_of_the_vehicle_are_required_because_they_cap_the_plan():
    assert parameters(PX4)["MPC_XY_VEL_MAX"] == ("at-least", 14.0)
    assert parameters(PX4)["MPC_XY_CRUISE"] == ("equal", 14.0)
    assert parameters(ARDUPILOT)["WPNAV_SPEED"] == ("at-least", 1400.0)
    assert parameters(ARDUPILOT)["WP_SPD"] == ("at-least", 14.0)


def test_returns_clear_the_ground_and_reach_far_rally_points():
    assert parameters(ARDUPILOT)["RTL_ALT"] == ("at-least", 13000.0)
    assert parameters(ARDUPILOT, has_rally_points=True)["RALLY_LIMIT_KM"] == ("equal", 0)
    assert "RALLY_LIMIT_KM" not in parameters(ARDUPILOT)
    assert parameters(PX4)["RTL_RETURN_ALT"] == ("at-least", 130.0)


def test_the_fence_is_switched_on_for_polygons_only():
    needed = parameters(ARDUPILOT, fenced=True)
    assert (needed["FENCE_ENABLE"], needed["FENCE_TYPE"]) == (("equal", 1), ("equal", 4))
    assert parameters(PX4, fenced=True)["GF_ACTION"] == ("equal", 3)


def test_going_on_after_a_landing_needs_its_options_on_ardupilot():
    needed = parameters(ARDUPILOT, continues_after_landing=True)
    assert needed["MIS_OPTIONS"] == ("bits", ardupilot.CONTINUE_AFTER_LAND)
    assert needed["DISARM_DELAY"] == ("equal", 0)
    assert "MIS_OPTIONS" not in parameters(ARDUPILOT)
    assert parameters(PX4, stays_armed=True)["COM_DISARM_LAND"] == ("equal", -1)


def test_a_lost_link_does_not_end_the_leg():
    assert parameters(ARDUPILOT)["FS_OPTIONS"] == ("bits", 11)
    assert parameters(PX4)["COM_DLL_EXCEPT"] == ("bits", 1)
    assert parameters(PX4)["COM_RCL_EXCEPT"] == ("bits", 1)


def test_no_autopilot_is_asked_for_more_than_20_metres_per_second():
    assert px4.MAX_SPEED_MPS == ardupilot.MAX_SPEED_MPS == 20.0
    fast = FlightNeeds(25.0, 5.0, 3.0, 60.0)
    speed = ARDUPILOT.parameters(fast)[0]
    assert {way.name: way.value for way in speed.ways} == {"WP_SPD": 20.0, "WPNAV_SPEED": 2000.0}


def test_dialects_are_found_by_name_and_by_number():
    assert family_of(12) is PX4
    assert family_of(3) is ARDUPILOT
    assert family_of(None) is None
    with pytest.raises(InputError, match="px4 or ardupilot"):
        family_named("betaflight")


def test_a_command_that_only_the_newest_ardupilot_takes_is_a_warning():
    arc = MissionItem(Command.NAV_ARC_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, param2=90.0, x=1, y=1, z=9.0)
    found = list(family_named("ardupilot").cannot_fly(MissionDocument(Mission((arc,)))))
    assert [(f.severity, f.code) for f in found] == [("warning", "ardupilot-new-command")]
