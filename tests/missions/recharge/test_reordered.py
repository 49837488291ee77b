"""Parts of missions in another order: another program flies both, and finds the same pictures with all that holds there."""

import math

import pytest
from mission_interpreter import Vehicle, assert_same_work, fly
from mission_worlds import FAMILIES, at, do, mission_of, options, pad

from skyway.missions import Command, Frame, MissionDocument, MissionItem
from skyway.recharge.order.picture_audit import audited
from skyway.recharge.recharged import recharged

PADS = [pad("barn", -50, 0), pad("shed", 500, 950, 415.0)]
HOME = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION)


class Photographer(Vehicle):
    """A vehicle that notes what holds where it takes a picture, the region and the gimbal among it."""

    def picture(self):
        self.seen = [*getattr(self, "seen", []), (self.at, tuple(sorted(self.held.items(), key=str)))]
        super().picture()


def seen_on(missions, grounds_m, origin, *, ardupilot):
    vehicle = Photographer(origin)
    for mission, ground in zip(missions, grounds_m, strict=True):
        vehicle.ground_m, vehicle.held, vehicle.every_m, vehicle.every_s = ground, {}, 0.0, 0.0
        fly(mission, vehicle, speed=8.0, ardupilot=ardupilot)
    return getattr(vehicle, "seen", [])


def assert_reordered(mission, found):
    """The flights fly the mission that was written, and that takes the pictures of the given one with what holds there."""
    assert audited(found).off_m <= 0.2
    origin = (mission.home.point.lat, mission.home.point.lon)
    for name, flights in found.flights.items():
        ardupilot = name == "ardupilot"
        missions = [flight.document.mission for flight in flights]
        grounds = [one.home.altitude_m - mission.home.altitude_m for one in missions]
        assert_same_work(found.problem.work.mission, missions, grounds, speed=8.0, ardupilot=ardupilot)
        before = seen_on([mission], [0.0], origin, ardupilot=ardupilot)
        after = seen_on(missions, grounds, origin, ardupilot=ardupilot)
        assert len(before) == len(after)
        for place, held in before:
            same = [one for one in after if math.dist(one[0], place) <= 1.0]
            assert same, place
            assert any(one[1] == held for one in same), (place, held)
            after.remove(same[0])
        for flight in flights:
            assert not [one for one in flight.report.findings if one.severity == "error"]
            assert flight.report.legs[-1].p_reserve >= 0.999 - 1e-9


def lines_of(order, every=25.0, length=700.0):
    items = []
    for number in order:
        items += [
            at(number * 60.0, 0),
            do(Command.DO_SET_CAM_TRIGG_DIST, every, 0.0, 1.0),
            at(number * 60.0, length),
            do(Command.DO_SET_CAM_TRIGG_DIST, 0.0),
        ]
    return items


@pytest.mark.parametrize("families", [FAMILIES, *(pytest.param([one], marks=pytest.mark.slow) for one in FAMILIES)])
def test_lines_of_a_survey_are_flown_in_the_better_order_and_from_their_ends(families):
    mission = mission_of([*lines_of([0, 3, 1, 4, 2]), HOME])
    found = recharged(MissionDocument(mission), PADS, families, options(share=0.165, reorder=True))
    told = found.order
    assert set(found.flights) == {family.name for family in families}
    assert (told.units, told.before_s > told.end_s) == (5, True)
    assert 0.0 < told.bound_s <= told.end_s == found.plan.end_s
    assert_reordered(mission, found)


def test_inspected_places_are_looked_at_with_their_gimbal_wherever_they_come():
    places = [(300, 300), (0, 600), (320, 350), (30, 620), (340, 300), (20, 560)]
    items = []
    for number, place in enumerate(places):
        items += [
            do(Command.DO_MOUNT_CONTROL, -10.0 * number),
            do(Command.DO_CHANGE_SPEED, 1, 5.0 + number, -1),
            at(*place, param1=4.0),
            do(Command.IMAGE_START_CAPTURE, 0, 0, 1),
        ]
    mission = mission_of([at(10, 10), *items, HOME])
    found = recharged(MissionDocument(mission), PADS, FAMILIES, options(reorder=True))
    assert found.order.moved
    assert found.order.end_s < found.order.before_s
    assert_reordered(mission, found)


def test_what_acts_on_the_world_keeps_its_place_and_that_is_said():
    first, then = lines_of([1, 0]), lines_of([3, 2])
    mission = mission_of([*first, at(100, 100), do(Command.DO_GRIPPER, 1, 0), *then, HOME])
    found = recharged(MissionDocument(mission), PADS, FAMILIES, options(reorder=True))
    assert any("order kept: item" in note and "DO_GRIPPER" in note for note in found.notes)
    flown = list(found.problem.work.mission.items)
    gripper = next(number for number, item in enumerate(flown) if item.command == Command.DO_GRIPPER)
    own = {item.y for item in first if item.command == Command.NAV_WAYPOINT}
    others = {item.y for item in then if item.command == Command.NAV_WAYPOINT}
    assert not others & {item.y for item in flown[:gripper]}
    assert not own & {item.y for item in flown[gripper:]}
    assert_reordered(mission, found)


def test_a_patrol_keeps_its_order_and_says_why():
    mission = mission_of([at(0, 400), at(700, 400), do(Command.DO_JUMP, 1, 3), at(0, 0, Command.NAV_LAND, 0.0)])
    found = recharged(MissionDocument(mission), PADS, FAMILIES, options(share=0.16, reorder=True))
    plain = recharged(MissionDocument(mission), PADS, FAMILIES, options(share=0.16))
    assert found.order.moved == 0
    assert found.order.bound_s == found.plan.end_s == plain.plan.end_s
    assert any("order kept" in note for note in found.notes)
