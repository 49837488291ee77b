"""Any mission survives both formats and both wires."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.missions import diff
from skyway.missions.autopilots.registry import FAMILIES
from skyway.missions.files import mission_file, plan_writer, waypoints_file
from skyway.missions.items import fence_items
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import INDEX_COMMANDS, LOCATED_COMMANDS, Command, command_of
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints

latitudes, longitudes = st.integers(-900_000_000, 900_000_000), st.integers(-1_800_000_000, 1_800_000_000)
numbers = st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: v + 0.0)
parameters = numbers | st.just(math.nan)
points = st.builds(Point, latitudes, longitudes)
flags = st.booleans()
outside_mission = fence_items.COMMANDS
commands = st.sampled_from([c for c in Command if c not in outside_mission]) | st.integers(1, 65535).map(command_of)
frames = st.sampled_from([0, 2, 3, 5, 6, 10, 11]).map(Frame)


@st.composite
def items(draw):
    command, frame = draw(commands.filter(lambda c: c not in outside_mission)), draw(frames)
    x, y = draw(latitudes | st.none()), draw(longitudes | st.none())
    param1 = draw(parameters)
    if command in INDEX_COMMANDS:
        param1 = float(draw(st.integers(0, 20)))
    elif command not in LOCATED_COMMANDS:
        x, y = draw(st.integers(-(10**15), 10**15)), draw(st.integers(-(10**15), 10**15))
    rest = [draw(parameters) for _ in range(3)]
    return MissionItem(command, frame, param1, *rest, x, y, draw(parameters), draw(flags))


homes = st.none() | st.builds(Home, points.filter(lambda p: p != (0, 0)), st.none() | numbers)
speeds = st.none() | st.floats(0.1, 30)
missions = st.builds(
    Mission,
    st.lists(items(), max_size=12).map(tuple),
    homes,
    speeds,
    speeds,
    st.sampled_from([None, 3, 12]),
    st.sampled_from([None, 1, 2]),
)
polygons = st.builds(FencePolygon, st.lists(points, min_size=3, max_size=9).map(tuple), flags)
circles = st.builds(FenceCircle, points, st.floats(0.5, 1e5), flags)
fences = st.builds(
    Geofence, st.lists(polygons, max_size=3).map(tuple), st.lists(circles, max_size=3).map(tuple), st.none() | points
)
rallies = st.builds(RallyPoints, st.lists(st.builds(RallyPoint, points, numbers), max_size=4).map(tuple))
documents = st.builds(MissionDocument, missions, fences, rallies)


def in_range(mission):
    """Jumps that lead nowhere are kept as such, but may get another number."""
    return all(item.jump_target is None or 0 <= item.jump_target < len(mission) for item in mission.items)


@settings(max_examples=300)
@given(documents.filter(lambda document: in_range(document.mission)))
def test_a_plan_file_loses_nothing(document):
    assert mission_file.loads(plan_writer.dumps(document).encode()) == document


@settings(max_examples=300)
@given(documents.filter(lambda document: in_range(document.mission)))
def test_waypoint_files_lose_nothing_that_they_can_hold(document):
    mission = mission_file.loads(waypoints_file.dumps_mission(document).encode()).mission
    assert (mission.items, mission.home) == (document.mission.items, document.mission.home)
    assert mission_file.loads(waypoints_file.dumps_fence(document).encode()).fence == document.fence
    assert mission_file.loads(waypoints_file.dumps_rally(document).encode()).rally == document.rally


@settings(max_examples=100)
@given(documents)
def test_jumps_that_lead_nowhere_still_lead_nowhere(document):
    for text in (plan_writer.dumps(document), waypoints_file.dumps_mission(document)):
        again = mission_file.loads(text.encode()).mission
        ours = [item.jump_target for item in document.mission.items]
        theirs = [item.jump_target for item in again.items]
        size = len(document.mission)
        for mine, other in zip(ours, theirs, strict=True):
            if mine is not None and 0 <= mine < size:
                assert other == mine
            elif mine is not None:
                assert not 0 <= other < size


storable = st.builds(
    MissionItem,
    st.sampled_from([Command.NAV_WAYPOINT, Command.NAV_TAKEOFF, Command.NAV_LAND]),
    st.sampled_from([Frame.GLOBAL, Frame.GLOBAL_RELATIVE_ALT]),
    st.integers(0, 600).map(float),
    param4=st.just(math.nan),
    x=latitudes,
    y=longitudes,
    z=st.integers(-10_000, 100_000).map(lambda cm: cm / 100),
)


@settings(max_examples=200)
@given(st.lists(storable, max_size=10), homes)
def test_a_mission_over_the_wire_has_no_difference(storables, home):
    mission = Mission(tuple(storables), home)
    for name, dialect in FAMILIES.items():
        assert diff(mission, dialect.from_wire(dialect.to_wire(mission)), name) == ()
