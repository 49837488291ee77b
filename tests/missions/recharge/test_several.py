"""One mission for several drones: another program flies what each does, and finds all pictures once, and nobody on another's pad."""

import itertools

import pytest
from mission_interpreter import Vehicle, fly
from mission_worlds import FAMILIES, at, do, mission_of, options, pad

from skyway.missions import Command, Frame, MissionDocument, MissionItem
from skyway.models.base.errors import InputError
from skyway.planner.fixed_route.sharing import APART_S
from skyway.recharge.several import BESIDE_M, shared_among

HOME = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION)
PADS = [pad("barn", -50, 0), pad("shed", 500, 500, 415.0)]


def lines(count, length=700.0):
    items = []
    for number in range(count):
        items += [
            at(number * 60.0, 0),
            do(Command.DO_SET_CAM_TRIGG_DIST, 25.0, 0.0, 1.0),
            at(number * 60.0, length),
            do(Command.DO_SET_CAM_TRIGG_DIST, 0.0),
        ]
    return items


def pictures_of(missions, grounds_m, origin, *, ardupilot):
    vehicle = Vehicle(origin)
    for mission, ground in zip(missions, grounds_m, strict=True):
        vehicle.ground_m, vehicle.held, vehicle.every_m, vehicle.every_s = ground, {}, 0.0, 0.0
        fly(mission, vehicle, speed=8.0, ardupilot=ardupilot)
    return vehicle.pictures


@pytest.mark.parametrize("reorder", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_part_is_flown_once_and_no_pad_is_anybody_elses(reorder):
    mission = mission_of([*lines(6), HOME])
    work = shared_among(
        MissionDocument(mission), PADS, FAMILIES, options(share=0.14, reorder=reorder), 2, iterations=40
    )
    assert sum(share.units for share in work.shares) == work.units == 6
    assert 0.0 < work.bound_s <= work.end_s
    origin = (mission.home.point.lat, mission.home.point.lon)
    for name in work.shares[0].found.flights:
        ardupilot = name == "ardupilot"
        before = pictures_of([mission], [0.0], origin, ardupilot=ardupilot)
        after = []
        for share in work.shares:
            missions = [flight.document.mission for flight in share.found.flights[name]]
            grounds = [one.home.altitude_m - mission.home.altitude_m for one in missions]
            after += pictures_of(missions, grounds, origin, ardupilot=ardupilot)
        assert len(before) == len(after)
        for one in before:
            near = min(after, key=lambda other: sum((a - b) ** 2 for a, b in zip(one[:3], other[:3], strict=True)))
            assert sum((a - b) ** 2 for a, b in zip(one[:3], near[:3], strict=True)) <= 1.0
            after.remove(near)
    stays = [(stay.pad, stay.number, stay.from_s, stay.until_s) for share in work.shares for stay in share.stays]
    assert stays
    for (pad_a, number_a, _, until), (pad_b, number_b, first, _) in itertools.pairwise(sorted(stays)):
        assert (pad_a, number_a) != (pad_b, number_b) or first - until >= APART_S - 1e-6
    for share in work.shares:
        for flight in share.found.told:
            assert flight.report.legs[-1].p_reserve >= 0.999 - 1e-9
    homes = [share.found.problem.work.mission.home.point for share in work.shares]
    assert (homes[1].lon - homes[0].lon) * 75_000.0 == pytest.approx(BESIDE_M, rel=0.02)


def test_what_must_be_done_in_its_order_is_not_shared():
    mission = mission_of([*lines(1), at(100, 100), do(Command.DO_GRIPPER, 1, 0), *lines(1), HOME])
    with pytest.raises(InputError, match=r"cannot be shared among drones: .*DO_GRIPPER"):
        shared_among(MissionDocument(mission), PADS, FAMILIES, options(share=0.2), 2)
