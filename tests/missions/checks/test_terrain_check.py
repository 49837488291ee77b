"""Checks of heights above the terrain: what follows the ground is judged over the ground."""

import numpy as np
import pytest
import shapely

from skyway.missions import check
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import Limit
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.flight.rules import Clearance
from skyway.models.flight.way_heights import Over
from tests.models.terrain.grids import NORTH, WEST, terrain_of

ABOVE_HOME, ABOVE_TERRAIN = Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_TERRAIN_ALT
LAT = NORTH - 0.05
# level at 600 m in the west; from 0.03 degrees on it rises to 900 m within 0.04 degrees
EAST = np.arange(121) / 1200
GROUND = np.tile(np.interp(EAST, [0.03, 0.07], [600.0, 900.0]), (121, 1))
OVER = Over(terrain_of(GROUND), Clearance(), 60.0)
HOME = Home(Point.of_degrees(LAT, WEST + 0.01), 600.0)
CODES = ("below-terrain", "below-terrain-clearance", "high")


def at(east, z, frame, command=Command.NAV_WAYPOINT):
    point = Point.of_degrees(LAT, WEST + east)
    return MissionItem(command, frame, x=point.lat_e7, y=point.lon_e7, z=z)


def flown(*items, **options):
    return check(Mission(items, HOME, firmware=3), over=OVER, **options)


def told(report):
    return [finding for finding in report.findings if finding.code in CODES]


RETURN = MissionItem(Command.NAV_RETURN_TO_LAUNCH)


@pytest.mark.parametrize("frame", [ABOVE_HOME, ABOVE_TERRAIN])
def test_a_take_off_above_the_terrain_begins_over_its_ground(frame):
    report = flown(at(0.01, 60.0, frame, Command.NAV_TAKEOFF), at(0.025, 60.0, ABOVE_HOME), RETURN)
    assert told(report) == []
    (heights,) = report.heights
    assert heights.path_height_m[0] == pytest.approx(660.0, abs=0.5)


@pytest.mark.parametrize("frame", [ABOVE_HOME, ABOVE_TERRAIN])
def test_the_way_to_a_landing_is_flown_at_the_height_before_it(frame):
    up = at(0.01, 80.0, ABOVE_HOME, Command.NAV_TAKEOFF)
    land = at(0.07, 0.0, frame, Command.NAV_LAND)
    over_rising_ground = told(flown(up, at(0.025, 80.0, ABOVE_TERRAIN), at(0.05, 80.0, ABOVE_HOME), land))
    assert [one.code for one in over_rising_ground if one.severity == "error"] == ["below-terrain"]
    level = at(0.025, 0.0, frame, Command.NAV_LAND)
    assert told(flown(up, at(0.02, 80.0, ABOVE_TERRAIN), level)) == []


def test_a_landing_above_the_terrain_follows_it_as_the_way_before_did():
    up = at(0.01, 110.0, ABOVE_HOME, Command.NAV_TAKEOFF)
    land = at(0.06, 0.0, ABOVE_TERRAIN, Command.NAV_LAND)
    assert told(flown(up, at(0.04, 110.0, ABOVE_TERRAIN), land)) == []


def test_a_return_from_the_terrain_keeps_its_height():
    up = at(0.01, 100.0, ABOVE_HOME, Command.NAV_TAKEOFF)
    (high,) = [one for one in told(flown(up, at(0.05, 100.0, ABOVE_TERRAIN), RETURN)) if one.code == "high"]
    assert high.message.startswith("250 m above the ground")  # 850 m over 600 m, until it descends


def zoned(low_m, high_m, *items):
    box = shapely.box(WEST + 0.055, LAT - 0.01, WEST + 0.065, LAT + 0.01)
    zones = Airspace((Zone("hill", "", "prohibited", (Volume(box, Limit(low_m), Limit(high_m)),)),))
    return [one.item for one in flown(*items, zones=zones).findings if one.code == "no-fly-zone"]


@pytest.mark.parametrize(("low_m", "high_m", "meets"), [(880.0, 960.0, True), (640.0, 700.0, False)])
def test_zones_above_the_sea_meet_what_follows_the_terrain(low_m, high_m, meets):
    up = at(0.01, 60.0, ABOVE_HOME, Command.NAV_TAKEOFF)
    # the ground below the zone lies from 787 to 863 m: 847 to 923 m are flown there
    way = (
        up,
        at(0.05, 60.0, ABOVE_TERRAIN),
        at(0.068, 60.0, ABOVE_TERRAIN),
        at(0.08, 0.0, ABOVE_TERRAIN, Command.NAV_LAND),
    )
    assert zoned(low_m, high_m, *way) == ([2] if meets else [])
