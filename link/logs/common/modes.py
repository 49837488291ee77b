"""Names of flight modes, as the autopilots' own ground stations write them, and which of them stand on rotors."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.link.logs.common.vehicle_kind import Kind

PX4_NAV_STATES = {
    0: "manual",
    1: "altitude",
    2: "position",
    3: "mission",
    4: "hold",
    5: "return",
    6: "position slow",
    8: "altitude cruise",
    9: "landing after GPS failure",
    10: "acro",
    11: "land",
    12: "descend",
    13: "termination",
    14: "offboard",
    15: "stabilized",
    17: "takeoff",
    18: "land",
    19: "follow",
    20: "precision land",
    21: "orbit",
    22: "VTOL takeoff",
    **{number: f"external {number - 22}" for number in range(23, 31)},
}
"""``vehicle_status.nav_state``."""
_PX4_MAIN = {
    1: "manual",
    2: "altitude",
    3: "position",
    5: "acro",
    6: "offboard",
    7: "stabilized",
    8: "rattitude",
    10: "termination",
    11: "altitude cruise",
}
_PX4_AUTO = {
    1: "ready",
    2: "takeoff",
    3: "hold",
    4: "mission",
    5: "return",
    6: "land",
    8: "follow",
    9: "precision land",
    10: "VTOL takeoff",
}
HOVER_MODES = frozenset((17, 18, 19, 20, 21, 22, 23))
"""ArduPlane's modes that stand on rotors: QSTABILIZE to QACRO."""
ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT."""


@cache
def _ardupilot(kind: Kind) -> dict[int, str]:
    from pymavlink import mavutil

    names = {
        "multirotor": mavutil.mode_mapping_acm,
        "helicopter": mavutil.mode_mapping_acm,
        "fixed wing": mavutil.mode_mapping_apm,
        "VTOL": mavutil.mode_mapping_apm,
        "rover": mavutil.mode_mapping_rover,
        "boat": mavutil.mode_mapping_rover,
        "submarine": mavutil.mode_mapping_sub,
        "airship": mavutil.mode_mapping_blimp,
    }
    return dict(names.get(kind, {}))


def ardupilot_mode(kind: Kind, number: int) -> str:
    """Name of a mode of ArduPilot, which counts them for each firmware anew."""
    return _ardupilot(kind).get(number, f"number {number}")


def mavlink_mode(autopilot: int, kind: Kind, custom_mode: int) -> str:
    """Name of ``HEARTBEAT.custom_mode``."""
    if autopilot == ARDUPILOT:
        return ardupilot_mode(kind, custom_mode)
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        named = _PX4_AUTO.get(sub) if main == 4 else _PX4_MAIN.get(main)
        return named or f"number {custom_mode}"
    return f"number {custom_mode}"
