"""What a mission is: typed, frozen, comparable, numbered from 0 without home."""

import dataclasses
import math

import pytest

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command, command_name, command_of
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home, Mission, MissionItem


def test_items_with_yaw_left_open_are_equal():
    one = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, param4=float("nan"), x=1, y=2, z=3.0)
    other = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, param4=-float("nan"), x=1, y=2, z=3.0)
    assert one == other
    assert hash(one) == hash(other)
    assert Mission((one,)) == Mission((other,))


@pytest.mark.parametrize("change", [{"x": 2}, {"param1": 1.0}, {"z": 4.0}, {"frame": 0}, {"autocontinue": False}])
def test_any_other_field_makes_another_item(change):
    item = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, x=1, y=2, z=3.0)
    assert dataclasses.replace(item, **change) != item


def test_what_a_file_said_besides_is_not_compared():
    assert MissionItem(16, extra={"comment": "north gate"}) == MissionItem(16)


def test_missions_cannot_be_changed():
    mission = Mission((MissionItem(Command.NAV_LAND),), Home(Point(1, 2)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        mission.home = None
    with pytest.raises(dataclasses.FrozenInstanceError):
        mission.items[0].x = 3


def test_commands_have_names_where_we_know_them():
    assert command_of(21) is Command.NAV_LAND
    assert MissionItem(command_of(21)).name == "NAV_LAND"
    assert command_name(43003) == "MAV_CMD 43003"
    assert MissionItem(43003).command == 43003


def test_zero_zero_means_here_and_not_the_gulf_of_guinea():
    assert MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, z=20.0).point is None
    assert MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, x=10_000_000, y=-5).point == Point(10_000_000, -5)


def test_an_item_without_a_place_has_no_point():
    assert MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1, 15).point is None
    assert math.isnan(MissionItem(Command.NAV_LAND, x=None).param5)


def test_importing_missions_is_cheap():
    import subprocess
    import sys

    code = "import sys, skyway.missions.items.mission; print('numpy' in sys.modules, 'pymavlink' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "False"]


def test_every_name_of_the_package_can_be_had():
    from skyway import missions

    for name in missions.__all__:
        assert callable(getattr(missions, name)) or name in ("Dialect", "Family")
    with pytest.raises(AttributeError, match="no attribute 'nothing_such'"):
        _ = missions.nothing_such


def test_missions_can_be_copied_pickled_and_taken_apart():
    import copy
    import pickle

    mission = Mission((MissionItem(Command.NAV_LAND, x=1, y=2),), Home(Point(1, 2)))
    assert pickle.loads(pickle.dumps(mission)) == copy.deepcopy(mission) == mission
    assert dataclasses.asdict(mission)["items"][0]["x"] == 1
