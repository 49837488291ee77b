"""What the planner decided is what the vehicle flies, leg by leg or whole."""

from dataclasses import replace
from datetime import timedelta
from itertools import pairwise

import pytest

from skyway.missions import (
    FlightConditions,
    MissionOptions,
    armed_mission,
    check,
    family_named,
    leg_mission,
    whole_mission,
)
from skyway.missions.autopilots.registry import FAMILIES
from skyway.missions.items.commands import Command
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.composition.composition import WayBack
from skyway.models.composition.service import Place, Stop
from skyway.models.drones.drone import M200_V2
from skyway.models.network.station import Station

PX4, ARDUPILOT = family_named("px4"), family_named("ardupilot")
BOTH = pytest.mark.parametrize("autopilot", list(FAMILIES.values()), ids=list(FAMILIES))


def names(document):
    return [item.name.removeprefix("NAV_").removeprefix("DO_") for item in document.mission.items]


def only(export):
    assert len(export.documents) == 1
    return export.documents[0]


def heights(document):
    return [item.z for item in document.mission.items if item.is_flown_to]


@BOTH
def test_a_leg_takes_off_climbs_sets_its_speed_flies_and_lands(two_legs, autopilot):
    document = only(leg_mission(two_legs, 0, autopilot))
    assert names(document) == ["TAKEOFF", "WAYPOINT", "CHANGE_SPEED", "WAYPOINT", "WAYPOINT", "LAND"]
    assert document.mission.items[2].params[:2] == (1.0, 15.0)
    assert not check(document, dialect=autopilot).findings


def test_the_last_leg_lands_releases_and_disarms(two_legs):
    assert names(only(leg_mission(two_legs, 1, PX4)))[-3:] == ["LAND", "GRIPPER", "COMPONENT_ARM_DISARM"]
    ardupilot = leg_mission(two_legs, 1, ARDUPILOT)
    assert names(only(ardupilot))[-2:] == ["LAND", "GRIPPER"]  # the end of its mission on the ground disarms
    assert {p.name for p in ardupilot.parameters} >= {"MIS_OPTIONS", "DISARM_DELAY", "GRIP_ENABLE"}
    assert only(ardupilot).mission.items[-1].params[:2] == (1.0, 0.0)


def test_where_a_person_releases_the_vehicle_is_disarmed_before(two_legs):
    by_hand = MissionOptions(release="hand")
    export = leg_mission(two_legs, 1, PX4, by_hand)
    assert names(only(export))[-2:] == ["LAND", "COMPONENT_ARM_DISARM"]
    assert "confirm it in skyway" in export.warnings[0]
    ardupilot = leg_mission(two_legs, 1, ARDUPILOT, by_hand)
    assert names(only(ardupilot))[-1] == "LAND"
    assert "MIS_OPTIONS" not in {p.name for p in ardupilot.parameters}


def test_heights_of_a_leg_count_from_the_ground_it_leaves(two_legs):
    # hill 120 m, harbour 2 m, mast 30 m, cruise 60 m above the higher end of each segment
    assert heights(only(leg_mission(two_legs, 0, PX4))) == [60.0, 60.0, 60.0, -30.0, -90.0]
    assert only(leg_mission(two_legs, 0, PX4)).mission.home.altitude_m == 120.0
    # mast 30 m, park 45 m
    assert heights(only(leg_mission(two_legs, 1, PX4))) == [75.0, 75.0, 75.0, 15.0]


def test_whole_on_px4_disarms_on_the_pad_and_goes_straight_up_from_a_new_home(two_legs):
    document = only(whole_mission(two_legs, PX4))
    assert names(document) == [
        *("TAKEOFF", "WAYPOINT", "CHANGE_SPEED", "WAYPOINT", "WAYPOINT", "LAND"),
        *("COMPONENT_ARM_DISARM", "WAYPOINT", "CHANGE_SPEED", "WAYPOINT", "LAND"),
        *("GRIPPER", "COMPONENT_ARM_DISARM"),
    ]
    land, _, above = document.mission.items[5:8]
    assert above.point == land.point
    assert heights(document) == [60.0, 60.0, 60.0, -30.0, -90.0, 75.0, 75.0, 15.0]
    assert check(document, dialect=PX4).ok


def test_whole_on_ardupilot_is_a_mission_per_leg_because_a_landing_resets_it(two_legs):
    export = whole_mission(two_legs, ARDUPILOT)
    assert [document.mission.home.altitude_m for document in export.documents] == [120.0, 30.0]
    assert export.documents == tuple(only(leg_mission(two_legs, i, ARDUPILOT)) for i in (0, 1))
    assert len({p.name for p in export.parameters}) == len(export.parameters)


def test_an_armed_hold_waits_for_wait_and_recharge_and_says_what_that_means(two_legs):
    export = armed_mission(two_legs, PX4)
    document = only(export)
    assert names(document)[5:9] == ["LAND", "DELAY", "WAYPOINT", "CHANGE_SPEED"]
    assert document.mission.items[6].param1 == 1500.0
    assert "ARMED at mast" in export.warnings[0]
    assert "clock" in export.warnings[0]
    assert "COM_DISARM_LAND" in {p.name for p in export.parameters}
    assert check(document, dialect=PX4).ok


def test_an_armed_hold_on_ardupilot_takes_off_again_with_its_options(two_legs):
    export = armed_mission(two_legs, ARDUPILOT)
    assert names(only(export))[5:9] == ["LAND", "DELAY", "TAKEOFF", "WAYPOINT"]
    needed = {p.name: p.value for p in export.parameters}
    assert (needed["MIS_OPTIONS"], needed["DISARM_DELAY"]) == (4, 0)
    assert check(only(export), dialect=ARDUPILOT).ok


@BOTH
def test_heights_of_an_armed_mission_count_from_its_first_home(two_legs, autopilot):
    land_heights = [i.z for i in only(armed_mission(two_legs, autopilot)).mission.items if i.command == 21]
    assert land_heights == [-90.0, -75.0]


@BOTH
@pytest.mark.parametrize("export", [whole_mission, armed_mission])
def test_places_of_the_plan_are_flown_hold_by_hold(two_legs, autopilot, export):
    documents = export(two_legs, autopilot).documents
    landed = [item.point for document in documents for item in document.mission.items if item.command == 21]
    assert [(p.lat, p.lon) for p in landed] == [(40.74, -73.92), (40.76, -73.88)]


def test_a_long_segment_is_split_on_the_geodesic_with_its_height_changing_evenly(small):
    stations = {"a": Place(60.0, 8.0, 100.0), "b": Place(60.0, 9.0, 100.0), "c": Place(60.0, 9.1, 400.0)}
    leg = small.service(0, "a", "c", via=("b",), depart=small.NOON, stations=stations)
    document = only(leg_mission(small.compose((leg,), (), stations), 0, PX4))
    way = [item for item in document.mission.items if item.command == Command.NAV_WAYPOINT][:-1]
    assert len(way) >= 4
    for one, other in pairwise(way):
        done = geodesy.distance_m(60.0, 8.0, other.point.lat, other.point.lon)
        step = geodesy.distance_m(one.point.lat, one.point.lon, other.point.lat, other.point.lon)
        assert (other.z - one.z) / step == pytest.approx(300.0 / 55_800, rel=0.01)
        assert other.z == pytest.approx(60.0 + 300.0 * done / geodesy.distance_m(60, 8, 60, 9), abs=0.1)
    assert way[-1].z == 360.0


def test_divert_stations_are_rally_points_as_high_as_the_leg_flies(two_legs):
    rally = only(leg_mission(two_legs, 1, PX4)).rally
    assert [(p.point.lat, p.altitude_m) for p in rally.points] == [(40.71, 75.0)]  # 45 + 60 - 30
    whole = only(whole_mission(two_legs, PX4)).rally  # 120 + 60 from the lowest home, the mast
    assert [(p.point.lat, p.altitude_m) for p in whole.points] == [(40.72, 150.0), (40.71, 150.0)]


@BOTH
def test_the_corridor_holds_the_route_and_the_diverts_in_every_form(two_legs, autopilot):
    exports = [
        leg_mission(two_legs, 0, autopilot),
        whole_mission(two_legs, autopilot),
        armed_mission(two_legs, autopilot),
    ]
    for document in (document for export in exports for document in export.documents):
        assert len(document.fence.areas) == 1
        codes = {finding.code for finding in check(document, dialect=autopilot).findings}
        assert not codes & {"outside-fence", "rally-outside-fence", "divert-outside-fence", "fence-crosses-itself"}


def test_the_width_of_the_corridor_can_be_chosen_or_left_out(two_legs):
    assert not only(leg_mission(two_legs, 0, PX4, MissionOptions(corridor_width_m=None))).fence
    narrow = only(leg_mission(two_legs, 0, PX4, MissionOptions(corridor_width_m=60.0))).fence
    wide = only(leg_mission(two_legs, 0, PX4, MissionOptions(corridor_width_m=900.0))).fence
    assert narrow != wide


def test_height_speed_and_climb_can_be_chosen(two_legs):
    options = MissionOptions(cruise_height_m=90.0, climb_rate_mps=2.0, max_ground_speed_mps=10.0)
    export = leg_mission(two_legs, 1, PX4, options)
    assert heights(only(export)) == [105.0, 105.0, 105.0, 15.0]
    assert only(export).mission.items[2].param2 == 10.0
    assert "commanded at 10.0 m/s: it takes longer" in export.warnings[0]
    assert {p.name: p.value for p in export.parameters}["MPC_Z_V_AUTO_UP"] == 2.0


def test_no_leg_is_commanded_faster_than_autopilots_accept(two_legs):
    fast = replace(two_legs, max_ground_speed_mps=30.0)
    fast = replace(fast, services=tuple(replace(s, ground_speed_mps=25.0) for s in fast.services))
    assert only(leg_mission(fast, 0, PX4)).mission.items[2].param2 == 20.0


@pytest.mark.parametrize(
    "wrong",
    [{"cruise_height_m": 1.0}, {"climb_rate_mps": 0.0}, {"max_ground_speed_mps": 30.0}, {"descent_rate_mps": 99.0}],
)
def test_impossible_options_are_refused(wrong):
    with pytest.raises(InputError, match="is not between"):
        MissionOptions(**wrong)


def test_an_unknown_ground_height_is_refused_by_name_with_every_other_one(two_legs):
    flat = {key: replace(place, elevation_m=None) for key, place in two_legs.stations.items()}
    with pytest.raises(InputError, match=r"stations\[harbour\].elevation_m") as caught:
        leg_mission(replace(two_legs, stations=flat), 0, PX4)
    assert len(caught.value.faults) == 4  # hill, harbour, mast and the school to divert to
    assert "--elevation harbour=METRES" in str(caught.value)
    given = MissionOptions(elevation_m={"hill": 120.0, "harbour": 2.0, "mast": 30.0, "school": 10.0})
    assert (
        leg_mission(replace(two_legs, stations=flat), 0, PX4, given).documents
        == leg_mission(two_legs, 0, PX4).documents
    )


def test_a_leg_that_the_plan_does_not_have_is_refused(two_legs):
    with pytest.raises(InputError, match=r"no such leg .got '2'.; an index from 0 to 1"):
        leg_mission(two_legs, 2, PX4)


def test_a_return_clears_the_highest_ground_of_the_leg(two_legs):
    needed = {p.name: p.value for p in leg_mission(two_legs, 0, PX4).parameters}
    assert needed["RTL_RETURN_ALT"] == 120 - 2 + 60


@BOTH
def test_a_stop_without_a_stay_is_no_delay_of_zero(two_legs, autopilot):
    stop = replace(two_legs.stops[0], wait_s=0.0, recharge_s=0.0)
    onward = replace(two_legs.services[1], depart=two_legs.services[0].arrive)
    hurried = replace(two_legs, stops=(stop,), services=(two_legs.services[0], onward))
    items = only(armed_mission(hurried, autopilot)).mission.items
    assert [item.param1 for item in items if item.command == Command.NAV_DELAY] == [1.0]


@BOTH
def test_a_disarmed_hold_tells_the_operator_how_long_and_how_much_to_charge(two_legs, autopilot):
    note = "at mast: wait 5 min for a pad, charge 20 min to 90 %, then arm for leg 2 with at least 90 %"
    assert whole_mission(two_legs, autopilot).notes == (note,)
    assert leg_mission(two_legs, 1, autopilot).notes == (note,)
    assert leg_mission(two_legs, 0, autopilot).notes == ()
    assert armed_mission(two_legs, autopilot).notes == ()


def test_a_stop_at_the_origin_is_charged_before_the_first_leg(two_legs, small):
    charging = Stop("hill", small.NOON - timedelta(minutes=10), 0.0, 600.0, 0.0, 0.5, 0.7)
    plan = replace(two_legs, stops=(charging, *two_legs.stops))
    assert whole_mission(plan, PX4).notes[0].startswith("at hill: charge 10 min to 70 %, then arm for leg 1")
    assert [i.param1 for i in only(armed_mission(plan, PX4)).mission.items if i.command == 93] == [1500.0]


@pytest.fixture
def there_and_back(two_legs):
    """The drone waits 2 minutes at the target, which has no pads, and goes back over the stations it came by."""
    last = two_legs.services[-1]
    target = replace(two_legs.stations[last.destination], pads=0)
    stations = {**two_legs.stations, last.destination: target}
    off = last.arrive + timedelta(seconds=120)
    flight = replace(
        last, origin=last.destination, destination=last.origin, via=tuple(reversed(last.via)), depart=off,
        arrive=off + (last.arrive - last.depart), soc_depart=last.soc_arrive, soc_arrive=0.3, diverts=(), segments=(),
    )  # fmt: skip
    back = replace(
        two_legs, origin=last.destination, destination=last.origin, services=(flight,), stops=(), payload_kg=0.0,
        depart=off, stations=stations,
    )  # fmt: skip
    way = WayBack("nearest-pad", back.destination, 120.0, back)
    return replace(two_legs, stations=stations, way_back=way)


@BOTH
def test_from_the_target_the_mission_goes_on_with_the_way_back(there_and_back, autopilot):
    whole = whole_mission(there_and_back, autopilot)
    first = whole.documents[0].mission.items[0]
    if autopilot.stays_in_mission_after_landing:
        found = names(only(whole))
        released = found.index("GRIPPER")
        assert found[released - 1 : released + 3] == ["LAND", "GRIPPER", "COMPONENT_ARM_DISARM", "WAYPOINT"]
        above, landed = (only(whole).mission.items[released + step] for step in (2, -1))
        assert (above.x, above.y) == (landed.x, landed.y)  # straight up from the street
        assert found[-2:] == ["LAND", "COMPONENT_ARM_DISARM"]
        assert (only(whole).mission.items[-2].x, first.x) != (landed.x, landed.x)
    else:
        assert len(whole.documents) == 3
        assert ["GRIPPER" in names(one) for one in whole.documents] == [False, True, False]
        assert names(whole.documents[2])[0] == "TAKEOFF"
    assert any("stay 2 min, then arm for leg 3" in note for note in whole.notes)
    for document in whole.documents:
        assert not [one for one in check(document, dialect=autopilot).findings if one.severity == "error"]
    assert names(only(leg_mission(there_and_back, 2, autopilot)))[-1] == "LAND"
    with pytest.raises(InputError, match="no such leg"):
        leg_mission(there_and_back, 3, autopilot)


@BOTH
def test_armed_at_the_target_the_time_there_is_a_delay_and_people_are_warned(there_and_back, autopilot):
    export = armed_mission(there_and_back, autopilot)
    found = names(only(export))
    released = found.index("GRIPPER")
    assert found[released + 1] == "DELAY"
    assert only(export).mission.items[released + 1].param1 == 120.0
    assert there_and_back.destination in export.warnings[0]


def test_after_the_release_the_package_weighs_nothing(there_and_back):
    document = only(whole_mission(there_and_back, PX4))
    stations = tuple(
        Station(key, place.name or key, place.lat, place.lon, place.elevation_m, place.pads, 0)
        for key, place in there_and_back.stations.items()
    )
    conditions = FlightConditions(M200_V2, payload_kg=1.2, stations=stations)
    _, out, back = check(document, conditions=conditions, dialect=PX4).legs
    assert out.distance_m == pytest.approx(back.distance_m, rel=0.02)
    assert back.energy_wh < 0.8 * out.energy_wh
    used = back.energy_wh * 3600.0 / M200_V2.battery_j
    assert back.soc_end == pytest.approx(out.soc_end - used)  # nothing is charged in the street
    unknown = check(document, conditions=replace(conditions, stations=()), dialect=PX4)
    assert "charge-at-target-assumed" in {one.code for one in unknown.findings}
