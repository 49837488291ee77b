"""The role of each item at a cut: one table.

A mission is cut at a place that it flies through. A command before it has one of these roles:

- *state*: it remains in force until another command replaces it (a speed, a region of interest, a servo). The states at the cut are commanded again
  when the work continues, the latest command of each kind.
- *event*: it happens once (a picture, the opening of a gripper). It stays in its place, and is never commanded twice.
- *condition*: it delays the commands after it. There is no cut before these are done.
- *way*: the vehicle flies there, or stays there.
- *bound*: from there on the mission cannot be cut, because the action that it has started cannot be restarted elsewhere.
- *mark*: a label or a jump; an unrolled mission has none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from skyway.missions.items.commands import FLOWN_COMMANDS, Command, command_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.mission import MissionItem

Role = Literal["state", "event", "condition", "way", "bound", "mark"]

_NAMES: Mapping[Role, str] = {
    "state": (
        "DO_CHANGE_SPEED DO_SET_RELAY DO_SET_SERVO DO_SET_ACTUATOR DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE "
        "DO_SET_ROI_SYSID DO_SET_ROI NAV_ROI DO_CONTROL_VIDEO DO_DIGICAM_CONFIGURE DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL "
        "DO_MOUNT_CONTROL_QUAT DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL DO_TRIGGER_CONTROL DO_FENCE_ENABLE DO_SPRAYER "
        "DO_AUX_FUNCTION DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS "
        "SET_CAMERA_SOURCE IMAGE_STOP_CAPTURE VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE OBLIQUE_SURVEY CONDITION_YAW "
        "DO_SET_RESUME_REPEAT_DIST DO_GUIDED_LIMITS"
    ),
    "event": (
        "DO_REPEAT_RELAY DO_REPEAT_SERVO DO_DIGICAM_CONTROL DO_GRIPPER DO_PARACHUTE DO_SEND_SCRIPT_MESSAGE DO_ENGINE_CONTROL "
        "DO_WINCH IMAGE_START_CAPTURE PANORAMA_CREATE PAYLOAD_PREPARE_DEPLOY PAYLOAD_CONTROL_DEPLOY "
        "DO_AUTOTUNE_ENABLE DO_MOTOR_TEST USER_1 USER_2 USER_3 USER_4 USER_5 SPATIAL_USER_1 SPATIAL_USER_2 SPATIAL_USER_3 "
        "SPATIAL_USER_4 SPATIAL_USER_5 NAV_DELAY"
    ),
    "condition": "CONDITION_DELAY CONDITION_CHANGE_ALT CONDITION_DISTANCE CONDITION_GATE",
    "bound": (
        "COMPONENT_ARM_DISARM DO_LAND_START DO_RETURN_PATH_START DO_VTOL_TRANSITION NAV_VTOL_TAKEOFF NAV_VTOL_LAND DO_SET_HOME DO_SET_MISSION_CURRENT "
        "DO_SET_MODE DO_INVERTED_FLIGHT DO_SET_REVERSE DO_RALLY_LAND DO_GO_AROUND DO_FLIGHTTERMINATION NAV_GUIDED_ENABLE "
        "NAV_SCRIPT_TIME NAV_ATTITUDE_TIME NAV_ALTITUDE_WAIT NAV_FOLLOW DO_FOLLOW DO_ORBIT NAV_PATHPLANNING DO_REPOSITION "
        "DO_PAUSE_CONTINUE NAV_CONTINUE_AND_CHANGE_ALT DO_CHANGE_ALTITUDE NAV_SET_YAW_SPEED NAV_LAND_LOCAL NAV_TAKEOFF_LOCAL"
    ),
    "mark": "DO_JUMP JUMP_TAG DO_JUMP_TAG",
}
_ROLES: Mapping[int, Role] = {Command[name]: role for role, names in _NAMES.items() for name in names.split()}
_OF_EACH = frozenset(
    {Command.DO_SET_RELAY, Command.DO_SET_SERVO, Command.DO_AUX_FUNCTION, Command.DO_MOUNT_CONTROL, Command.DO_SPRAYER}
)
"""Commands whose state belongs to the number in parameter 1."""
_ONE_THING = {
    "region of interest": "DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE DO_SET_ROI_SYSID DO_SET_ROI NAV_ROI",
    "gimbal": "DO_MOUNT_CONTROL DO_MOUNT_CONTROL_QUAT DO_GIMBAL_MANAGER_PITCHYAW",
    "pictures": "DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE OBLIQUE_SURVEY",
    "pictures trigger": "DO_TRIGGER_CONTROL",
    "video": "VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE",
    "speed": "DO_CHANGE_SPEED",
}
_THING: Mapping[int, str] = {Command[name]: thing for thing, names in _ONE_THING.items() for name in names.split()}
PICTURES, VIDEO, SPEED = "pictures", "video", "speed"
"""Kinds of state that a cut treats specially."""


def role_of(item: MissionItem) -> Role:
    """Return the role of an item at a cut; an unknown command happens once."""
    if item.command == Command.IMAGE_START_CAPTURE and item.param3 == 0 and item.param2 > 0:
        return "state"  # pictures without end, every so many seconds
    known = _ROLES.get(item.command)
    if known is not None:
        return known
    return "way" if item.command in FLOWN_COMMANDS or item.command == Command.NAV_RETURN_TO_LAUNCH else "event"


def state_key(item: MissionItem) -> str:
    """Return the state that an item commands: a later command of the same key replaces it."""
    thing = _THING.get(item.command, command_name(item.command))
    if item.command == Command.DO_CHANGE_SPEED:  # up and down are separate from ahead
        return f"{thing} {item.param1:g}" if item.param1 in (2.0, 3.0) else thing
    return f"{thing} {item.param1:g}" if item.command in _OF_EACH and thing not in _ONE_THING else thing


def is_no_region(item: MissionItem) -> bool:
    """Whether an item ends a region of interest without starting one; ArduPilot uses DO_SET_ROI with a place whatever its mode."""
    no_place = item.param1 == 0.0 and item.point is None
    return item.command == Command.DO_SET_ROI_NONE or (item.command == Command.DO_SET_ROI and no_place)


def roles() -> Mapping[Role, tuple[str, ...]]:
    """Return the names of all commands by their role at a cut."""
    found: dict[Role, tuple[str, ...]] = {role: tuple(names.split()) for role, names in _NAMES.items()}
    bound = set(found["bound"])
    ways = sorted(command for command in FLOWN_COMMANDS if command.name not in bound)
    found["way"] = (*(command.name for command in ways), Command.NAV_RETURN_TO_LAUNCH.name)
    return found
