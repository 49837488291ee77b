"""PX4: missions as multirotors under PX4 1.16 and 1.17 accept them, and the reports of its vehicles.

This module is based on flights (software in the loop), or on ``mavlink_mission.cpp`` and
``FeasibilityChecker.cpp``.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.autopilots.family import Family
from skyway.missions.autopilots.px4.calibrations import CALIBRATIONS
from skyway.missions.autopilots.px4.failsafes import FAILSAFES
from skyway.missions.autopilots.px4.modes import MODES
from skyway.missions.autopilots.px4.settings import FIRMWARES, RELEASED, SETTINGS
from skyway.missions.autopilots.wire import from_wire, no_such_command, to_wire
from skyway.missions.items.altitude_frames import TERRAIN_FRAMES, Frame, frame_name
from skyway.missions.items.commands import FLOWN_COMMANDS, LOCATED_COMMANDS, TAKEOFF_COMMANDS, Command, kept_params
from skyway.missions.items.finding import Finding
from skyway.missions.items.mission import Mission, MissionItem

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from skyway.missions.autopilots.family import Meaning
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.parameters import FlightNeeds, Parameter

MAX_SPEED_MPS = 20.0
"""MPC_XY_VEL_MAX is the upper limit."""

_KEPT_PARAMS = kept_params(
    {
        (): "NAV_RETURN_TO_LAUNCH",
        (1,): "COMPONENT_ARM_DISARM",
        (4,): "NAV_TAKEOFF NAV_VTOL_TAKEOFF NAV_VTOL_LAND",
        (1, 2): "DO_JUMP DO_GRIPPER",
        (2, 4): "NAV_LAND",
        (3, 4): "NAV_LOITER_UNLIM",
        (1, 2, 3): "DO_CHANGE_SPEED",
        (1, 2, 4): "NAV_WAYPOINT NAV_LOITER_TO_ALT",
        (1, 2, 3, 4): "NAV_LOITER_TIME NAV_DELAY DO_WINCH",
    }
)
"""Which of parameters 1 to 4 PX4 keeps of commands whose others are a place, or unused."""

_KEPT_WHOLE = kept_params(
    {
        (1, 2, 3, 4): (
            "NAV_ROI CONDITION_DELAY CONDITION_DISTANCE DO_SET_HOME DO_SET_SERVO DO_SET_ACTUATOR DO_LAND_START "
            "DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE DO_CONTROL_VIDEO DO_SET_ROI "
            "DO_DIGICAM_CONTROL DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL DO_SET_CAM_TRIGG_DIST DO_AUTOTUNE_ENABLE "
            "DO_SET_CAM_TRIGG_INTERVAL OBLIQUE_SURVEY SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS "
            "SET_CAMERA_SOURCE DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE IMAGE_START_CAPTURE "
            "IMAGE_STOP_CAPTURE DO_TRIGGER_CONTROL VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE DO_VTOL_TRANSITION "
            "CONDITION_GATE"
        )
    }
)
"""The other commands that PX4 takes in missions: it keeps all their parameters."""

_PLACELESS_FRAME = frozenset({Command.DO_SET_HOME, Command.DO_LAND_START, Command.DO_SET_ROI, Command.NAV_ROI})
"""Located commands that PX4 also accepts without a place."""


_REFUSING = re.compile(
    r"mission reject|infeasible|not feasible|too far|geofence violat|no valid mission|mission (is )?invalid",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"\b(?:WP|waypoint|item|at) #?(\d+)", re.IGNORECASE)


class Px4(Family):
    """PX4's handling of missions: items from 0, without home."""

    name = "px4"
    firmware = 12
    system_id_names = ("MAV_SYS_ID",)
    calibrations = CALIBRATIONS
    filter_tests = ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")
    vibration_fields = ("vibration_z",)  # the other two are of the gyro (streams/VIBRATION.hpp)
    vibration_mps2 = (4.905, 9.81)  # as Flight Review draws its bands
    log_folders = ("/fs/microsd/log", "/log")  # a board's card; the working folder of its simulator
    kind_remedy = "set its parameter MAV_TYPE"
    log_endings = (".ulg", ".px4log")
    stays_in_mission_after_landing = True
    zero_means_as_it_is = False
    open_yaw_deg = math.nan
    settings = SETTINGS
    firmwares = FIRMWARES
    released = RELEASED
    modes = MODES
    failsafes = FAILSAFES
    pauses_in_mission = False
    heeds_frames = False
    """PX4-Autopilot issues 10246 and 28257."""
    bytewise_parameters = True
    takes_uploads_whole = True
    judges_missions = True
    """After it has accepted one; by texts, and in newer versions in MISSION_CURRENT.mission_state."""
    lean_limits = ("lean-limit",)
    wind_message = 231
    crash_texts = re.compile(r"\bcrash|attitude failure", re.IGNORECASE)
    """It refuses to arm with ``Attitude failure (roll)``."""

    def to_wire(self, mission: Mission, *, current: int = 0) -> tuple[WireItem, ...]:
        """Return the items to upload: those without a place in frame MISSION, otherwise PX4 refuses them."""
        return tuple(
            to_wire(_in_frame(item), number, current=int(number == current))
            for number, item in enumerate(mission.items)
        )

    def from_wire(self, items: Sequence[WireItem]) -> Mission:
        """Return the mission of downloaded items."""
        return Mission(tuple(from_wire(item) for item in items), firmware=self.firmware)

    def meaning(self, item: MissionItem) -> Meaning:
        """Return the fields that PX4 keeps: not ``current``, not LAND's abort altitude, NaN and 0 as one yaw on reading back."""
        item = _in_frame(item)
        meaning: Meaning = {"command": item.name, "autocontinue": float(item.autocontinue)}
        kept = _KEPT_PARAMS.get(item.command, (1, 2, 3, 4))
        for number in kept:
            value = item.params[number - 1]
            meaning[f"param{number}"] = None if math.isnan(value) else value
        if item.is_located:
            meaning["altitude reference"] = frame_name(item.frame)
            meaning["x"], meaning["y"], meaning["z"] = item.x, item.y, item.z
        elif item.command not in _KEPT_PARAMS:
            meaning["param5"], meaning["param6"] = round(item.param5_or_zero), round(item.param6_or_zero)
            meaning["param7"] = None if math.isnan(item.z) else item.z
        return meaning

    def disarm(self) -> tuple[MissionItem, ...]:
        """Return COMPONENT_ARM_DISARM 0: the mission waits on the pad, and a plain ARM resumes it."""
        return (MissionItem(Command.COMPONENT_ARM_DISARM, Frame.MISSION, 0.0),)

    def leave_armed_hold(self, above: MissionItem) -> tuple[MissionItem, ...]:
        """Return the waypoint straight above: a second TAKEOFF would make the mission infeasible."""
        return (above,)

    def cannot_fly(self, document: MissionDocument) -> Iterator[Finding]:
        """Return the items that PX4 refuses at upload, or accepts but then denies to start."""
        placed = False
        for number, item in enumerate(document.mission.items):
            yield from _refusals(number, item)
            if item.command in TAKEOFF_COMMANDS and placed:
                message = "PX4 accepts a TAKEOFF that is not the first position and then denies to start the mission"
                yield Finding(
                    "error", number, "px4-takeoff-not-first", message, "replace it by a WAYPOINT straight above the pad"
                )
            placed = placed or item.command in FLOWN_COMMANDS or item.command == Command.CONDITION_GATE
            if item.command == Command.NAV_LAND and number == 0:
                yield Finding("error", 0, "px4-land-first", "PX4 rejects a mission that starts with LAND")
        yield from _sideways_departures(document.mission)

    def parameters(self, needs: FlightNeeds) -> tuple[Parameter, ...]:
        """Return the parameters that PX4 requires for such a mission, by their names in each version."""
        of, speed = SETTINGS, min(needs.ground_speed_mps, MAX_SPEED_MPS)
        without_exceptions = of["data-link-action"].need("equal", 0, "a mission continues when the data link is lost")
        found = [
            of["speed-limit"].need("at-least", speed, "clips every planned ground speed (12 m/s by default)"),
            of["mission-speed"].need("equal", speed, "the speed missions are flown at without a speed item"),
            of["climb-rate"].need("equal", needs.climb_rate_mps, "planned climb rate"),
            of["descent-rate"].need("equal", needs.descent_rate_mps, "planned descent rate"),
            of["return-height"].need("at-least", needs.return_height_m, "a return must clear the ground"),
            of["data-link-exceptions"].need(
                "bits", 1, "a mission continues when the data link is lost", without_exceptions
            ),
            of["remote-control-exceptions"].need("bits", 1, "a mission continues when the remote control is lost"),
            of["low-battery-action"].need("read", None, "what the vehicle does at low battery"),
            of["critical-battery"].need("read", None, "when it does so; must lie below the planned reserve"),
            of["data-link-action"].need("read", None, "what it does without a data link outside missions"),
        ]
        if needs.fenced:
            found += [
                of["fence-action"].need("equal", 3, "a breach returns to a rally point instead of hovering"),
                of["fence-radius"].need("equal", 0, "no circle around home besides the corridor"),
                of["fence-ceiling"].need("equal", 0, "no ceiling above home besides the corridor"),
            ]
        if needs.has_rally_points:
            returns = of["return-type"]
            near = returns.need("equal", 0, "a return goes to the closest rally point or home")
            safe = returns.need(
                "equal", 5, "a return goes to a rally point, never home", near, paired="NAV_LTR_LAST_DL"
            )
            found.append(safe)
        if needs.stays_armed:
            found.append(of["disarm-delay"].need("equal", -1, "would disarm during an armed hold"))
        if needs.uses_gripper:
            kind = of["gripper-kind"].need("at-least", 0, "the release is a gripper")
            found.append(of["gripper"].need("equal", 1, "the release is a gripper", kind))
        return tuple(found)

    def relies_on_fence(self, values: Mapping[str, float]) -> bool:
        """Whether it acts at a breach, without a circle or a ceiling around home."""
        around_home = any(values.get(key, 0.0) > 0.0 for key in ("fence-radius", "fence-ceiling"))
        return values.get("fence-action", 0.0) > 0.0 and not around_home

    def refusals(self, texts: Sequence[str]) -> list[str]:
        """The texts of a vehicle that refuse the mission that it has accepted."""
        return [text for text in texts if _REFUSING.search(text)]

    def items_refused(self, texts: Sequence[str]) -> tuple[int, ...]:
        """Numbers of the items concerned by such texts, from 0: in texts PX4 counts from 1."""
        found = (_NUMBER.search(text) for text in texts)
        return tuple(sorted({int(hit[1]) - 1 for hit in found if hit is not None and int(hit[1]) > 0}))


def _in_frame(item: MissionItem) -> MissionItem:
    """Put an item without a place into frame MISSION."""
    if item.command in LOCATED_COMMANDS and not (item.command in _PLACELESS_FRAME and item.point is None):
        return item
    return item if item.frame == Frame.MISSION else replace(item, frame=Frame.MISSION)


def _refusals(number: int, item: MissionItem) -> Iterator[Finding]:
    if item.command not in _KEPT_PARAMS and item.command not in _KEPT_WHOLE:
        message = f"PX4 refuses the upload: {no_such_command(item)} in missions"
        yield Finding("error", number, "px4-unsupported-command", message, "remove it, or replace it by waypoints")
    elif item.is_located and item.frame in TERRAIN_FRAMES:
        message = f"PX4 refuses the upload: {item.name} has its altitude above terrain"
        yield Finding("error", number, "px4-unsupported-frame", message, "give it above home or above sea level")
    if item.is_flown_to and item.point is None and item.command != Command.NAV_TAKEOFF:
        message = f"{item.name} has no position: ArduPilot takes 0, 0 as here, PX4 as a place in the Atlantic"
        yield Finding("error", number, "px4-no-position", message, "give it a position")


def _sideways_departures(mission: Mission) -> Iterator[Finding]:
    """After a landing in mid-mission PX4 leaves sideways at low height unless it is first sent straight up."""
    landed_at: MissionItem | None = None
    for number, item in enumerate(mission.items):
        if item.command == Command.NAV_LAND:
            landed_at = item
        elif item.is_flown_to and item.point is not None and landed_at is not None:
            pad = landed_at.point
            aside = pad is not None and max(abs(item.point[0] - pad[0]), abs(item.point[1] - pad[1])) > 500
            if aside and item.command not in TAKEOFF_COMMANDS:
                message = "after LAND the next position is not above the pad: PX4 leaves the pad sideways at low height"
                yield Finding(
                    "error",
                    number,
                    "px4-sideways-after-land",
                    message,
                    "put a WAYPOINT straight above the pad before it",
                )
            landed_at = None
