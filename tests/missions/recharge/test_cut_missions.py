"""Missions cut at pads: another program flies them before and after, and compares."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mission_interpreter import assert_same_work
from mission_worlds import FAMILIES, WIND, at, do, mission_of, options, pad, small

from skyway.missions import (
    Command,
    FlightConditions,
    Frame,
    Home,
    MissionDocument,
    MissionItem,
    read,
)
from skyway.missions.checks.route import fly as route_of
from skyway.missions.recharge.item_roles import role_of, roles
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.drones import time_belief
from skyway.models.drones.energy_belief import EXACT
from skyway.models.network.station import Station
from skyway.recharge.order.picture_audit import audited, kept_pictures
from skyway.recharge.problem import RechargeOptions
from skyway.recharge.recharged import recharged
from skyway.recharge.simulated import Taught, simulated

HOME = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION)


def cut(mission, pads, chosen=None, families=FAMILIES):
    return recharged(MissionDocument(mission), pads, families, chosen or options())


def compare(mission, found, *, laps=1, speed=8.0, memories=(False,)):
    assert audited(found).off_m <= 0.1
    for name, flights in found.flights.items():
        grounds = [flight.document.mission.home.altitude_m - mission.home.altitude_m for flight in flights]
        for forgets in memories:
            assert_same_work(
                mission,
                [flight.document.mission for flight in flights],
                grounds,
                laps=laps,
                speed=speed,
                ardupilot=name == "ardupilot",
                forgets=forgets,
            )
        for flight in flights:
            assert not [one for one in flight.report.findings if one.severity == "error"]
            assert flight.report.legs[-1].p_reserve >= 0.999 - 1e-9


def survey(lines=8, length=900.0, apart=60.0, every=25.0):
    items = []
    for number in range(lines):
        ends = [0.0, length] if number % 2 == 0 else [length, 0.0]
        items += [
            at(number * apart, ends[0]),
            do(Command.DO_SET_CAM_TRIGG_DIST, every, 0, 1),
            at(number * apart, ends[1]),
            do(Command.DO_SET_CAM_TRIGG_DIST, 0),
        ]
    return [*items, MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION)]


def test_a_survey_is_cut_and_no_picture_is_lost_or_taken_twice():
    mission = mission_of(survey())
    found = cut(mission, [pad("barn", -50, 0), pad("shed", 500, 950, 415.0)])
    assert len(found.plan.stops) >= 2
    assert set(found.flights) == {"px4", "ardupilot"}
    compare(mission, found, memories=(False, True))


def test_a_line_longer_than_a_battery_is_left_between_two_pictures():
    items = [
        at(0, 100),
        do(Command.DO_SET_SERVO, 5, 1700),
        do(Command.DO_SET_ROI_LOCATION),
        do(Command.DO_SET_CAM_TRIGG_DIST, 30, 0, 0),
        at(0, 6000, height=90.0),
        do(Command.DO_SET_CAM_TRIGG_DIST, 0),
        at(100, 6000, Command.NAV_LAND, 0.0),
    ]
    items[2] = at(300, 3000, Command.DO_SET_ROI_LOCATION, 10.0)
    mission = mission_of(items)
    found = cut(mission, [pad("a", 50, 1500, 380.0), pad("b", -80, 3600, 430.0), pad("c", 60, 5200)], options(0.3))
    inside = [found.problem.work.points[one.point] for one in found.cuts]
    assert any(point.share < 1.0 for point in inside)
    compare(mission, found, memories=(False, True))


def test_pictures_every_so_many_seconds_go_on_where_they_would_have():
    items = [
        at(0, 100),
        do(Command.IMAGE_START_CAPTURE, 0, 5, 0),
        at(0, 6000),
        do(Command.IMAGE_STOP_CAPTURE),
        at(100, 6000, Command.NAV_LAND, 0.0),
    ]
    mission = mission_of(items)
    pads = [pad("a", 50, 1500), pad("b", -80, 3600), pad("c", 60, 5200)]
    found = cut(mission, pads, options(0.3), FAMILIES[:1])
    assert any(found.problem.work.points[one.point].share < 1.0 for one in found.cuts)
    compare(mission, found)


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        (do(Command.IMAGE_START_CAPTURE, 0, 4, 0), do(Command.IMAGE_STOP_CAPTURE)),
        (do(Command.DO_SET_CAM_TRIGG_INTERVAL, 4000), do(Command.DO_TRIGGER_CONTROL)),
    ],
)
def test_pictures_by_the_clock_go_on_over_corners_and_changes_of_speed(begin, end):
    corners = [at(0, 600), do(Command.DO_CHANGE_SPEED, 1, 5, -1), at(700, 600), at(700, 0), at(0, 0)]
    mission = mission_of([at(0, 0), begin, *corners, *corners, end, HOME])
    found = cut(mission, [pad("barn", -60, 20), pad("shed", 500, 600)], options(0.3), FAMILIES[:1])
    assert len(found.plan.stops) >= 2
    compare(mission, found)


def test_pictures_of_a_stay_are_counted():
    mission = mission_of([at(0, 0), do(Command.IMAGE_START_CAPTURE, 0, 4, 0), at(0, 80, param1=31.0), HOME])
    work = cut(mission, [pad("barn", -60, 20)], options(1.0), FAMILIES[:1]).problem.work
    at_its_end = [one for one in work.pictures if one.step == 2 and one.share == 1.0]
    assert len(at_its_end) == 8  # 10 s of way, then 31 s: at 12, 16, … 40 s


def test_nothing_is_left_while_pictures_are_stopped_that_an_order_lets_go_on():
    legs = [at(0, 600), at(700, 600), at(700, 0), at(0, 0)]
    stop, go = do(Command.DO_TRIGGER_CONTROL), do(Command.DO_TRIGGER_CONTROL, 1)
    begin = do(Command.DO_SET_CAM_TRIGG_DIST, 30)
    mission = mission_of([at(0, 0), begin, *legs, stop, *legs, go, *legs, stop, *legs, HOME])
    found = cut(mission, [pad("barn", -60, 20), pad("shed", 500, 600)], options(0.4), FAMILIES[:1])
    compare(mission, found)
    left = {found.problem.work.steps[found.problem.work.points[one.point].step].item for one in found.cuts}
    assert left
    assert not left & {8, 9, 10, 11}


def test_flights_that_lose_a_picture_are_refused():
    found = cut(mission_of(survey()), [pad("west", -100, 450), pad("east", 600, 500)])
    assert kept_pictures(found).after == len(found.problem.work.pictures)
    without = {name: flights[:-1] for name, flights in found.flights.items()}
    with pytest.raises(InputError, match="pictures, and these flights would take"):
        kept_pictures(replace(found, flights=without))


def test_jumps_are_unrolled_and_counted_over_the_cuts():
    items = [at(0, 400), at(700, 400), do(Command.DO_JUMP, 1, 5), at(0, 0, Command.NAV_LAND, 0.0)]
    mission = mission_of(items)
    found = cut(mission, [pad("a", 300, 500)])
    assert len(found.plan.stops) >= 1
    assert not any(one.command == Command.DO_JUMP for flight in found.told for one in flight.document.mission.items)
    compare(mission, found)
    patrol = mission_of([at(0, 400), at(700, 400), do(Command.DO_JUMP, 1, -1), at(0, 0, Command.NAV_LAND, 0.0)])
    often = cut(patrol, [pad("a", 300, 500)], options(laps=7))
    assert "item 3 jumps back without end: flown 8 times" in often.notes
    compare(patrol, often, laps=7)


def test_a_region_of_interest_as_mission_planner_writes_it_holds_behind_a_cut():
    """With a place and no mode: ArduPilot looks there, whatever the first parameter says."""
    region = at(300, 300, Command.DO_SET_ROI, 10.0)
    mission = mission_of(
        [at(0, 400), region, at(700, 400), at(700, 0), at(0, 0), do(Command.DO_SET_ROI), at(50, 0), HOME]
    )
    found = cut(mission, [pad("a", 300, 500)], options(0.17))
    assert found.plan.stops
    kept = [one for one in found.flights["ardupilot"][1].document.mission.items if one.command == Command.DO_SET_ROI]
    assert [(one.x, one.y) for one in kept][:1] == [(region.x, region.y)]


@pytest.mark.parametrize("used", [(0.5, 0.6), (0.7, 0.62)])
def test_simulated_flights_teach_each_run_what_flights_teach_the_supervisor(used):
    chosen = options()
    belief = begun = chosen.conditions.drone.energy_belief
    taught = Taught(chosen)
    for one in used:
        belief = belief.learnt(one, 0.6)
        taught.learn(np.array([one, 0.6]), np.full(2, 0.6))
    sigmas = begun.sigmas(1.0 - chosen.epsilon)
    more = belief.mean_ratio + sigmas * belief.leg_sd - (begun.mean_ratio + sigmas * begun.leg_sd)
    assert taught.more(0.0)[0] == pytest.approx(more, abs=1e-12)


def test_a_flight_of_many_turns_has_charge_for_what_is_not_known_of_turns():
    places = [at(60.0 * (number % 8), 40.0 * (number // 8), param1=0.5) for number in range(48)]
    found = cut(mission_of([*places, HOME]), [pad("barn", -50, 0), pad("shed", 300, 200)], options(0.2), FAMILIES[:1])
    assert found.plan.stops
    told = simulated(found, runs=20_000)
    assert min(told.each_p_reserve) >= 0.998
    assert all(flight.report.legs[-1].p_reserve >= 0.999 - 1e-9 for flight in found.told)


def made_up(seed):
    """Places, and orders between them that hold, happen once, or take pictures; pads; and a share of a battery."""
    rng = np.random.default_rng(seed)
    items = []
    for_both = rng.random() < 0.7
    for _ in range(int(rng.integers(4, 12))):
        items.append(
            at(*rng.uniform(-600, 900, 2), height=float(rng.integers(30, 90)), param1=float(rng.integers(0, 3)))
        )
        for _ in range(int(rng.integers(0, 4))):
            roi = at(*rng.uniform(-500, 500, 2), Command.DO_SET_ROI_LOCATION, 5.0)
            items.append(
                [
                    do(Command.DO_CHANGE_SPEED, 1, float(rng.integers(4, 12)), -1),
                    do(Command.DO_SET_SERVO, float(rng.integers(5, 8)), float(rng.integers(1000, 2000))),
                    do(Command.DO_MOUNT_CONTROL, float(rng.integers(-90, 0))),
                    do(Command.DO_SET_CAM_TRIGG_DIST, float(rng.choice([0, 0, 20, 35])), 0, float(rng.integers(2))),
                    do(Command.DO_GRIPPER, 1, float(rng.integers(2))),
                    do(Command.DO_DIGICAM_CONTROL),
                    do(Command.DO_SET_ROI_NONE),
                    roi,
                    do(Command.IMAGE_START_CAPTURE, 0, float(rng.integers(3, 7)), 0),
                    do(Command.IMAGE_STOP_CAPTURE),
                    do(Command.VIDEO_START_CAPTURE, 0, 0, 1),
                    do(Command.DO_SET_RELAY, 1, float(rng.integers(2))),
                    do(Command.DO_TRIGGER_CONTROL, float(rng.integers(2))),
                    do(Command.DO_SET_CAM_TRIGG_INTERVAL, 1000.0 * float(rng.integers(3, 7))),
                ][int(rng.choice(12 if for_both else 14))]
            )
    if rng.random() < 0.4:
        items.append(do(Command.DO_JUMP, float(rng.integers(1, 4)), float(rng.integers(1, 3))))
    last = rng.random() < 0.5
    items.append(at(0, 0, Command.NAV_LAND, 0.0) if last else do(Command.NAV_RETURN_TO_LAUNCH))
    pads = [
        pad(f"p{number}", *rng.uniform(-500, 700, 2), float(rng.integers(380, 420)))
        for number in range(int(rng.integers(1, 4)))
    ]
    return mission_of(items), pads, float(rng.uniform(0.1, 0.25))


@settings(max_examples=4)
@given(st.integers(0, 10**6))
@example(558468)  # a picture by the clock while it stays
def test_any_mission_does_the_same_work_before_and_after(seed):
    mission, pads, share = made_up(seed)
    try:
        found = cut(mission, pads, options(share))
    except InputError as error:
        if "reach" in str(error) or "cannot be cut" in str(error) or "no missions for" in str(error):
            return
        raise
    compare(mission, found)


@pytest.mark.slow
@settings(max_examples=300)
@given(st.integers(0, 10**6))
def test_so_do_many(seed):
    test_any_mission_does_the_same_work_before_and_after.hypothesis.inner_test(seed)


def test_every_command_has_one_role():
    named = [name for names in roles().values() for name in names]
    assert len(named) == len(set(named))
    for role, names in roles().items():
        for name in names:
            item = MissionItem(Command[name], Frame.MISSION, param3=1.0)
            assert role_of(item) == role, name


def test_what_is_never_reached_is_told_and_tags_are_unrolled_for_both():
    legs = [do(Command.JUMP_TAG, 7), at(0, 600), at(700, 600), at(0, 0), do(Command.DO_JUMP_TAG, 7, 2)]
    mission = mission_of([*legs, HOME, at(0, 300), at(300, 300)])
    found = cut(mission, [pad("barn", -60, 20), pad("shed", 500, 600)], options(0.3))
    assert set(found.flights) == {"px4", "ardupilot"}
    assert found.plan.stops
    assert [note for note in found.notes if "never reached" in note] == [
        "item 7: 2 items with a position are never reached, and were not checked"
    ]


def told(mission, pads, chosen=None):
    with pytest.raises(InputError) as caught:
        cut(mission, pads, chosen)
    lines = str(caught.value).splitlines()
    assert len(lines) <= 2, lines
    return lines[0]


def test_what_cannot_be_cut_is_told_in_one_line():
    far = mission_of([at(0, 9000), do(Command.NAV_RETURN_TO_LAUNCH)])
    line = told(far, [pad("barn", -50, 0)])
    assert "no pad in reach: on the way to item 1 the battery lacks" in line
    assert "barn" in line
    assert "home is unknown" in told(replace(far, home=None), [pad("barn", -50, 0)])
    assert "there are no pads" in told(far, [replace(pad("barn", -50, 0), pads=0)])
    assert "ground height of pad barn is unknown" in told(far, [replace(pad("barn", -50, 0), elevation_m=None)])
    flat = replace(far, home=Home(far.home.point, None))
    assert "height of the mission's home above sea level is unknown" in told(flat, [pad("barn", -50, 0)])
    landing = [at(0, 300), do(Command.DO_LAND_START), at(0, 2000), at(0, 100), at(0, 0, Command.NAV_LAND, 0.0)]
    assert "item 2 (DO_LAND_START) cannot be cut" in told(
        mission_of(landing), [pad("a", 0, 500), pad("b", 0, 2000)], options(0.25)
    )
    vtol = [at(0, 300), do(Command.DO_VTOL_TRANSITION, 4), at(0, 2000), at(0, 100), at(0, 0, Command.NAV_LAND, 0.0)]
    line = told(mission_of(vtol), [pad("a", 0, 500), pad("b", 0, 2000)], options(0.25))
    assert "DO_VTOL_TRANSITION" in line
    to_itself = [at(0, 300), do(Command.DO_JUMP, 2, 5), HOME]
    assert "no missions for px4 and ardupilot: item 2: jumps to itself" in told(mission_of(to_itself), [pad("a", 0, 5)])
    often = [at(0, 300), at(300, 300), do(Command.DO_JUMP, 1, 30_000), HOME]
    assert "repeat too often" in told(mission_of(often), [pad("a", 0, 500)])
    plane = [at(0, 9000, Command.NAV_VTOL_TAKEOFF), at(0, 100), at(0, 0, Command.NAV_VTOL_LAND, 0.0)]
    line = told(replace(far, items=tuple(plane)), [pad("a", 0, 500)])
    assert "item 0 (NAV_VTOL_TAKEOFF) cannot be cut" in line


def longest(found_with):
    """Cut a real mission with the smallest drone that flies it with a stop."""
    shares = np.geomspace(0.02, 3.0, 40).tolist()
    for number, share in enumerate(shares):
        try:
            found = found_with(share)
        except InputError:
            continue
        if found.plan.stops:
            return found
        for between in np.linspace(shares[max(number - 1, 0)], share, 12)[
            1:-1
        ].tolist():  # a little less may do with a stop
            try:
                return found_with(between)
            except InputError:
                continue
        return None
    return None


REAL = [
    "ardupilot__cmac-foamy-mission-ccw.txt",
    "ardupilot__sonoma-copter.txt",
    "canberrauav__mission-heli.txt",
    "canberrauav__scrutineering-2014.txt",
    "cubepilot__MissionPlanner.waypoints.txt",
    "cubepilot__SectionTest.plan",
    "droneicarus__test2-Petite_mission_necssitant_une_recharge.plan",
    "droneicarus__test2-Petite_mission_necssitant_une_recharge-generated.plan",
    "harry169__copter_AVC2013_mission.txt",
    "harry169__copter_spline_mission.txt",
    "kasperg3__uas_center_autonomous_flight.plan",
    "luk8426__Mission1_Manching_2X.plan",
    "luk8426__Mission31.plan",
    "luk8426__V8_Gewicht_Absetzen.plan",
    "mavlink__example-mission.plan",
    "mavlink__qgroundcontrol_sample.plan",
    "mavlink__qgroundcontrol_sample_with_survey.plan",
    "xidian-uav__mission_px4.txt",
]


def real(shared_data, name):
    """A real mission, the pads that are put about it, and the speed that it begins with."""
    document = read(shared_data / "missions" / name)
    mission = document.mission
    steps = route_of(mission).steps
    home = mission.home or Home(steps[0].point)
    mission = replace(mission, home=replace(home, altitude_m=400.0 if home.altitude_m is None else home.altitude_m))
    places = [home.point, *(steps[len(steps) * part // 4].point for part in (1, 2, 3))]
    pads = [Station(f"p{number}", "", one.lat, one.lon, pads=2) for number, one in enumerate(places)]
    return replace(document, mission=mission), pads


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_missions_do_the_same_work_before_and_after(shared_data, name):
    document, pads = real(shared_data, name)

    def found_with(share):
        chosen = RechargeOptions(FlightConditions(small(share), weather=WIND), TransitRules(10.0), level_ground=True)
        return recharged(document, pads, FAMILIES, chosen)

    found = longest(found_with)
    assert found is not None, name
    assert found.plan.stops, name
    mission = found.problem.work.mission  # completed, as it was told
    print(
        f"{name}: {len(found.plan.stops)} stops, for {', '.join(found.flights)}, {len(found.problem.work.pictures)} pictures"
    )
    for family, flights in found.flights.items():
        assert_same_work(
            mission,
            [flight.document.mission for flight in flights],
            [0.0] * len(flights),
            speed=mission.hover_speed_mps or 5.0,
            ardupilot=family == "ardupilot" and (mission.firmware == 3 or len(found.flights) == 1),
        )


@pytest.mark.slow
def test_the_planner_that_lands_on_lakes_takes_no_less_time_than_we_do(shared_data):
    """Their settings: 20 minutes in the air, an hour to charge, 30 km/h, the order kept; their pad: the lake that they chose."""
    name = "droneicarus__test2-Petite_mission_necssitant_une_recharge"
    ours = read(shared_data / f"missions/{name}.plan").mission
    theirs = read(shared_data / f"missions/{name}-generated.plan").mission
    lake = next(item for item in theirs.items if item.command == Command.NAV_LAND).point
    drone = replace(
        small(1.0), endurance_empty_s=1200.0, endurance_full_s=1200.0, recharge_full_s=3600.0, energy_belief=EXACT
    )
    speed = 30.0 / 3.6
    ours = replace(ours, hover_speed_mps=speed)
    conditions = FlightConditions(drone, reserve_soc=0.0, climb_rate_mps=5.0, descent_rate_mps=5.0)
    options = RechargeOptions(conditions, TransitRules(speed), level_ground=True)
    found = recharged(MissionDocument(ours), [Station("lake", "", lake.lat, lake.lon)], FAMILIES[:1], options)
    # theirs as it is flown, their heights (degrees of latitude) left out: ground distance at 30 km/h, their delay, and our own climbs
    flown = route_of(replace(theirs, hover_speed_mps=speed)).steps
    places = [ours.home.point, *(step.point for step in flown)]
    metres = sum(geodesy.distance_m(a.lat, a.lon, b.lat, b.lon) for a, b in pairwise(places))
    delay = sum(item.param1 for item in theirs.items if item.command == Command.NAV_DELAY)
    print(
        f"ours {found.plan.end_s:.0f} s with {len(found.plan.stops)} stops, theirs {metres / speed + delay:.0f} s, {metres:.0f} m"
    )
    assert found.plan.end_s <= metres / speed + delay


def test_few_batteries_are_waited_for_and_the_simulated_flights_wait_too():
    legs = [at(400.0 * (number % 2), 60.0 * number) for number in range(12)]
    mission = mission_of([*legs, at(0, 0, Command.NAV_LAND, 0.0)])
    pads = [pad("barn", -50, 0), pad("shed", 400, 300)]
    ends = []
    for packs, chargers in ((1, 1), (2, 1), (None, 1)):
        chosen = options(share=0.14, swap_s=30.0, packs=packs, chargers=chargers)
        found = cut(mission, pads, chosen)
        sure = replace(chosen.conditions.drone, energy_belief=EXACT)
        exact = replace(chosen, conditions=replace(chosen.conditions, drone=sure))
        told = simulated(cut(mission, pads, exact), runs=4, times=time_belief.EXACT)
        assert told.end_s == pytest.approx(cut(mission, pads, exact).plan.end_s, rel=0.02)
        assert all(flight.soc_start == 1.0 for flight in found.told)
        ends.append(found.plan.end_s)
        waited = any("total wait for full ones" in note for note in found.notes)
        assert waited == (packs is not None and len(found.plan.stops) > 0)
    assert len(found.plan.stops) >= 2
    assert ends[0] > ends[1] >= ends[2] - 1e-3
