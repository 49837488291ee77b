"""Our table of commands and our waypoint files, against pymavlink as an independent reader."""

import pytest

from skyway.missions import family_named, whole_mission
from skyway.missions.files import mission_file
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import LOCATED_COMMANDS, Command

mavutil = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
mavwp = pytest.importorskip("pymavlink.mavwp")


def test_commands_have_the_numbers_and_names_of_the_message_definitions():
    theirs = mavutil.enums["MAV_CMD"]
    assert {c.name for c in Command} == {theirs[c].name.removeprefix("MAV_CMD_") for c in Command}
    assert all(theirs[c].name == f"MAV_CMD_{c.name}" for c in Command)


def test_the_same_commands_have_a_place():
    theirs = mavutil.enums["MAV_CMD"]
    located = {c for c in Command if theirs[c].has_location and "LOCAL" not in c.name}
    assert located == set(LOCATED_COMMANDS)


def test_frames_have_the_numbers_of_the_message_definitions():
    theirs = {entry.name: number for number, entry in mavutil.enums["MAV_FRAME"].items()}
    assert all(theirs[f"MAV_FRAME_{frame.name}"] == frame for frame in Frame)


def test_pymavlink_reads_the_waypoint_files_that_we_write(two_legs, tmp_path):
    document = whole_mission(two_legs, family_named("ardupilot")).documents[0]
    mission_file.write(document, tmp_path / "leg.waypoints")
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(tmp_path / "leg.waypoints")) == len(document.mission.items) + 1
    for number, item in enumerate(document.mission.items, start=1):
        theirs = loader.wp(number)
        assert (theirs.seq, theirs.command, theirs.frame) == (number, item.command, item.frame)
        assert (theirs.x, theirs.y, theirs.z) == (item.param5, item.param6, item.z)


def test_we_and_pymavlink_read_the_same_real_files_alike(shared_data):
    for path in sorted((shared_data / "missions").glob("*.txt")):
        loader = mavwp.MAVWPLoader()
        try:
            count = loader.load(str(path))
        except mavwp.MAVWPError:
            continue
        document = mission_file.read(path)
        if document.fence or len(document.rally):
            continue
        first = count - len(document.mission.items)
        assert first in (0, 1)
        for number, item in enumerate(document.mission.items):
            theirs = loader.wp(number + first)
            assert (theirs.command, theirs.frame) == (item.command, item.frame)
            assert theirs.x == pytest.approx(item.param5, abs=1e-7)
            assert theirs.z == item.z


def test_exports_for_ardupilot_have_no_nan_at_all(two_legs):
    documents = whole_mission(two_legs, family_named("ardupilot")).documents
    values = [value for d in documents for item in d.mission.items for value in (*item.params, item.z)]
    assert all(value == value for value in values)  # noqa: PLR0124
