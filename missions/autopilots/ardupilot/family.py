"""ArduPilot: missions as Copter 4.6 accepts them, and its differences from others.

This module is based on flights (software in the loop), or on ``AP_Mission.cpp``.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.autopilots.ardupilot.calibrations import CALIBRATIONS
from skyway.missions.autopilots.ardupilot.failsafes import FAILSAFES
from skyway.missions.autopilots.ardupilot.modes import MODES
from skyway.missions.autopilots.ardupilot.settings import FIRMWARES, RELEASED, SETTINGS
from skyway.missions.autopilots.family import Family
from skyway.missions.autopilots.wire import from_wire, no_such_command, to_wire
from skyway.missions.items.altitude_frames import Frame, frame_name
from skyway.missions.items.commands import (
    INDEX_COMMANDS,
    LAND_COMMANDS,
    LOCATED_COMMANDS,
    TAKEOFF_COMMANDS,
    YAW_COMMANDS,
    Command,
    kept_params,
)
from skyway.missions.items.coordinates import Point
from skyway.missions.items.finding import Finding
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.base.formatting import duration
from skyway.models.composition.release import WINCH_MPS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from skyway.missions.autopilots.family import Meaning
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.parameters import FlightNeeds, Parameter

MAX_SPEED_MPS = 20.0
"""Greatest speed of missions (WPNAV_SPEED, WP_SPD)."""
MAX_ITEMS = 700
"""Items that the usual storage holds (about 15 bytes each)."""
CONTINUE_AFTER_LAND = 4
"""Bit 2 of MIS_OPTIONS."""
_POLYGONS = 4
"""FENCE_TYPE of areas alone, without the circle around home and the ceiling."""

_KEPT_PARAMS = kept_params(
    {
        (): (
            "NAV_RETURN_TO_LAUNCH DO_LAND_START DO_RETURN_PATH_START DO_GO_AROUND DO_SET_ROI_LOCATION DO_SET_ROI_NONE "
            "NAV_VTOL_TAKEOFF NAV_VTOL_LAND"
        ),
        (1,): (
            "NAV_WAYPOINT NAV_SPLINE_WAYPOINT NAV_LOITER_TIME NAV_LAND NAV_TAKEOFF NAV_CONTINUE_AND_CHANGE_ALT "
            "NAV_GUIDED_ENABLE NAV_PAYLOAD_PLACE CONDITION_DELAY CONDITION_DISTANCE DO_SET_HOME DO_SET_ROI "
            "DO_SET_CAM_TRIGG_DIST DO_FENCE_ENABLE DO_PARACHUTE DO_INVERTED_FLIGHT DO_AUTOTUNE_ENABLE "
            "DO_VTOL_TRANSITION DO_SET_REVERSE DO_SET_RESUME_REPEAT_DIST DO_SPRAYER JUMP_TAG IMAGE_STOP_CAPTURE "
            "VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE"
        ),
        (2,): "NAV_LOITER_TO_ALT",
        (3,): "NAV_LOITER_UNLIM",
        (1, 2): (
            "DO_JUMP DO_SET_RELAY DO_SET_SERVO DO_GRIPPER DO_AUX_FUNCTION DO_JUMP_TAG SET_CAMERA_ZOOM SET_CAMERA_FOCUS"
        ),
        (1, 3): "NAV_LOITER_TURNS",
        (1, 2, 3): (
            "DO_CHANGE_SPEED DO_REPEAT_RELAY DO_MOUNT_CONTROL NAV_ALTITUDE_WAIT DO_ENGINE_CONTROL NAV_SET_YAW_SPEED "
            "SET_CAMERA_SOURCE"
        ),
        (1, 2, 3, 4): (
            "NAV_DELAY CONDITION_YAW DO_REPEAT_SERVO DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_GUIDED_LIMITS DO_WINCH "
            "DO_SEND_SCRIPT_MESSAGE DO_GIMBAL_MANAGER_PITCHYAW IMAGE_START_CAPTURE NAV_SCRIPT_TIME NAV_ATTITUDE_TIME"
        ),
    }
)
"""Commands that ArduPilot stores, and which of parameters 1 to 4 it keeps; anything else is refused at upload."""

_NEWEST = frozenset({Command.NAV_ARC_WAYPOINT})
"""Commands that ArduPilot's development version flies in its own tests, and released ones refuse."""

_WHOLE_SECONDS = frozenset({Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TIME})
_WHOLE_PARAM1 = _WHOLE_SECONDS | {Command.NAV_LAND, Command.NAV_TAKEOFF}
"""Commands whose first parameter is stored as a whole number of 16 bits."""


class ArduPilot(Family):
    """ArduPilot's handling of missions: item 0 is home, in uploads too, so its numbers are ours plus one."""

    name = "ardupilot"
    places_payloads = True
    firmware = 3
    system_id_names = ("MAV_SYSID", "SYSID_THISMAV")
    calibrations = CALIBRATIONS
    filter_message = ("EKF_STATUS_REPORT", 193)
    filter_tests = ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance")
    filter_limit = 0.8  # default of FS_EKF_THRESH
    log_folders = ("/APM/LOGS", "/logs", "/var/APM/logs")  # a board's card; its simulator; Linux boards
    log_endings = (".bin",)
    home_items = 1
    refuses_open_parameters = True
    within_every_inclusion_area = True
    stays_in_mission_after_landing = False
    zero_means_as_it_is = True
    open_yaw_deg = 0.0
    """Copter keeps no yaw of items; every ground station can show 0."""
    settings = SETTINGS
    firmwares = FIRMWARES
    released = RELEASED
    modes = MODES
    failsafes = FAILSAFES
    arms_in = "guided"
    pauses_in_mission = True
    bytewise_parameters = False
    takes_uploads_whole = False
    ground_station_settings = ("ground-station", "ground-station-last")
    """From 4.7 on a range of systems is accepted; before, one."""
    lean_limits = ("lean-limit", "position-lean-limit")
    taken_text = "Flight plan received"
    kind_remedy = "set its parameter FRAME_CLASS"
    crash_texts = re.compile(r"\bcrash|\bleaning\b", re.IGNORECASE)
    """The text is ``Crash: Disarming``, and a refusal to arm contains ``Leaning``."""

    def to_wire(self, mission: Mission, *, current: int = 0) -> tuple[WireItem, ...]:
        """Return the items to upload: a placeholder for home first, otherwise the first item would be lost."""
        wire = [to_wire(_home_item(mission.home), 0)]
        for number, item in enumerate(mission.items):
            wire.append(to_wire(_storable(item), number, shift=1, current=int(number == current)))
        return tuple(wire)

    def from_wire(self, items: Sequence[WireItem]) -> Mission:
        """Return the mission of downloaded items, home taken out and jumps in our numbers."""
        if not items:
            return Mission(firmware=self.firmware)
        first = items[0]
        home = Home(Point(first.x, first.y), first.z) if first.x or first.y else None
        return Mission(tuple(_shift(from_wire(item), -1) for item in items[1:]), home, firmware=self.firmware)

    def meaning(self, item: MissionItem) -> Meaning:
        """Return the fields that ArduPilot stores: no yaw, no radius, whole seconds, altitudes in centimetres, no autocontinue."""
        meaning: Meaning = {"command": item.name}
        for number in _KEPT_PARAMS.get(item.command, (1, 2, 3, 4)):
            value = item.params[number - 1]
            value = 0.0 if math.isnan(value) else value
            whole = number == 1 and item.command in _WHOLE_PARAM1
            meaning[f"param{number}"] = float(math.trunc(value)) if whole else value
        if item.command == Command.NAV_LOITER_TIME:
            meaning["direction"] = "left" if item.param3 < 0 else "right"
        if item.command in LOCATED_COMMANDS:
            meaning["altitude reference"] = "sea level" if item.frame == Frame.MISSION else frame_name(item.frame)
            meaning["x"], meaning["y"] = item.x or 0, item.y or 0
            meaning["z"] = round(item.z, 2) if math.isfinite(item.z) else None
        elif item.command in (Command.DO_DIGICAM_CONFIGURE, Command.DO_DIGICAM_CONTROL):
            meaning["param5"], meaning["param6"] = round(item.param5_or_zero), round(item.param6_or_zero)
        return meaning

    def disarm(self) -> tuple[MissionItem, ...]:
        """Return nothing: LAND disarms, and with ContinueAfterLand so does the end of the mission on the ground."""
        return ()

    def leave_armed_hold(self, above: MissionItem) -> tuple[MissionItem, ...]:
        """Return a TAKEOFF to the height of the waypoint above: after a landing ArduPilot requires one."""
        takeoff = replace(above, command=Command.NAV_TAKEOFF)
        return (takeoff, above)

    def cannot_fly(self, document: MissionDocument) -> Iterator[Finding]:
        """Return the items that ArduPilot refuses at upload, forgets, or flies only with parameters set."""
        items = document.mission.items
        for number, item in enumerate(items):
            yield from _refusals(number, item)
        if len(items) > MAX_ITEMS:
            message = f"{len(items)} items: the usual storage has space for about {MAX_ITEMS}"
            yield Finding("warning", None, "ardupilot-many-items", message, "split the mission")
        yield from _after_landing(document.mission)
        inclusions = sum(area.inclusion for area in document.fence.areas)
        if inclusions > 1:
            message = f"{inclusions} inclusion areas: ArduPilot requires the vehicle to be inside all of them at once"
            yield Finding(
                "warning",
                None,
                "ardupilot-inclusion-areas",
                message,
                "set bit 1 of FENCE_OPTIONS (2), or keep one area",
            )

    def relies_on_fence(self, values: Mapping[str, float]) -> bool:
        """Whether it acts on polygons alone."""
        return values.get("fence", 1.0) > 0.0 and values.get("fence-kinds", 0.0) == _POLYGONS

    def parameters(self, needs: FlightNeeds) -> tuple[Parameter, ...]:
        """Return the parameters that ArduPilot requires for such a mission, under the names of each version."""
        of, speed = SETTINGS, min(needs.ground_speed_mps, MAX_SPEED_MPS)
        found = [
            of["mission-speed"].need("at-least", speed, "missions start at it (10 m/s by default)"),
            of["climb-rate"].need("equal", needs.climb_rate_mps, "planned climb rate"),
            of["descent-rate"].need("equal", needs.descent_rate_mps, "planned descent rate"),
            of["return-height"].need("at-least", needs.return_height_m, "a return must clear the ground"),
            of["failsafe-options"].need(
                "bits", 1 + 2 + 8, "AUTO and landings continue when RC or ground station are lost"
            ),
            of["ground-station"].need("read", None, "only this system's heartbeats count as the ground station"),
            of["low-battery-action"].need("read", None, "what the vehicle does at low battery"),
            of["low-battery"].need("read", None, "when it does so; must lie below the planned reserve"),
        ]
        if needs.fenced:
            found += [
                of["fence"].need("equal", 1, "else the corridor is only stored"),
                of["fence-kinds"].need(
                    "equal", _POLYGONS, "polygons only: the default 7 also breaches 300 m from home"
                ),
                of["fence-action"].need("equal", 1, "a breach returns to a rally point, or lands"),
            ]
        if needs.has_rally_points:
            limit = "else a vehicle farther than 0.3 km from a rally point goes home instead"
            found.append(of["rally-limit"].need("equal", 0, limit))
        if needs.continues_after_landing:
            found += [
                of["mission-options"].need("bits", CONTINUE_AFTER_LAND, "else LAND disarms and resets the mission"),
                of["disarm-delay"].need("equal", 0, "else the vehicle disarms on the pad in mid-mission"),
            ]
        if needs.uses_gripper:
            found.append(of["gripper"].need("equal", 1, "the release is a gripper"))
        if needs.uses_winch:
            found.append(of["winch"].need("at-least", 1, "the release is a winch"))
            found.append(
                of["winch-rate"].need("at-least", WINCH_MPS, "the line must be out before it is taken in again")
            )
        return tuple(found)


def _home_item(home: Home | None) -> MissionItem:
    point = Point(0, 0) if home is None else home.point
    altitude = 0.0 if home is None or home.altitude_m is None else home.altitude_m
    return MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, x=point.lat_e7, y=point.lon_e7, z=altitude)


def _storable(item: MissionItem) -> MissionItem:
    """Return the item as ArduPilot accepts it: no NaN but a yaw, and numbers of items counted with home."""
    params = [
        0.0 if math.isnan(value) and not (number == 4 and item.command in YAW_COMMANDS) else value
        for number, value in enumerate(item.params, start=1)
    ]
    clean = replace(item, param1=params[0], param2=params[1], param3=params[2], param4=params[3])
    return _shift(clean, 1)


def _shift(item: MissionItem, by: int) -> MissionItem:
    if item.command not in INDEX_COMMANDS or item.jump_target is None:
        return item
    if item.command == Command.DO_SET_MISSION_CURRENT and item.param1 < 0:
        return item
    return replace(item, param1=item.param1 + by)


def _refusals(number: int, item: MissionItem) -> Iterator[Finding]:
    if item.command in _NEWEST:
        message = f"only the newest ArduPilot (after 4.6) takes {item.name}: older ones refuse the upload"
        yield Finding("warning", number, "ardupilot-new-command", message, "replace it by waypoints")
    elif item.command not in _KEPT_PARAMS:
        message = f"ArduPilot refuses the upload: {no_such_command(item)} in missions"
        yield Finding(
            "error",
            number,
            "ardupilot-unsupported-command",
            message,
            "remove it: ArduPilot disarms by itself" if item.command == Command.COMPONENT_ARM_DISARM else None,
        )
    if item.command in LOCATED_COMMANDS and math.isnan(item.z):
        yield Finding("error", number, "ardupilot-no-altitude", "ArduPilot refuses the upload: no altitude")
    if item.command == Command.NAV_DELAY and not item.param1 > 0 and not any(v > 0 for v in item.params[1:]):
        message = "a delay of 0 s: ArduPilot takes it as a time of day and waits until midnight UTC"
        yield Finding("error", number, "ardupilot-delay-until-midnight", message, "give it at least 1 s")
    seconds = item.param1
    if item.command in _WHOLE_SECONDS and math.isfinite(seconds) and seconds > 65535:
        message = f"a hold of {duration(seconds)} does not fit the 16 bits that ArduPilot has for it"
        yield Finding("error", number, "ardupilot-hold-too-long", message, "use NAV_DELAY, or several holds")


def _after_landing(mission: Mission) -> Iterator[Finding]:
    landed: int | None = None
    for number, item in enumerate(mission.items):
        if item.command in LAND_COMMANDS:
            landed = number
        elif landed is not None:
            message = "ArduPilot disarms at LAND and resets the mission: the items after it are not flown"
            yield Finding(
                "warning",
                landed,
                "ardupilot-land-ends-mission",
                message,
                "one mission per leg, or MIS_OPTIONS with bit 2 (4) and DISARM_DELAY 0",
            )
            break
    yield from _departures_without_takeoff(mission)


def _departures_without_takeoff(mission: Mission) -> Iterator[Finding]:
    landed = False
    for number, item in enumerate(mission.items):
        if item.command in LAND_COMMANDS:
            landed = True
        elif item.command in TAKEOFF_COMMANDS:
            landed = False
        elif landed and item.is_flown_to:
            message = f"{item.name} after a landing without a TAKEOFF: ArduPilot stays on the ground"
            yield Finding("error", number, "ardupilot-no-takeoff", message, "put a TAKEOFF before it")
            landed = False
