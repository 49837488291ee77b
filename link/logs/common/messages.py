"""MAVLink messages as telemetry quantities, for logs (arrays) and live links (numbers).

Special cases handled here: WIND gives where the wind comes FROM, WIND_COV where the air goes; both are 0 until they are valid;
0 V, -1 A and -1 % mean unknown; a position of exactly 0, 0 is not a fix; VFR_HUD has
indicated airspeed, which is converted to true airspeed by the standard density at its height; a heartbeat of a ground station, radio or
camera is not the vehicle's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.trust import estimate_ok, receiver_ok
from skyway.link.logs.common.vehicle_kind import MAV_KINDS
from skyway.missions.autopilots.registry import FAMILIES
from skyway.models.drones.atmosphere import density_ratio
from skyway.models.drones.telemetry import NEITHER
from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

Columns = dict[str, "NDArray[np.float64]"]

GROUND_TYPES = (5, 6, 18, 26, 27, 30)
"""MAV_TYPE of an antenna tracker, a ground station, an on-board controller, a gimbal, ADSB, a camera."""
ROTOR_TYPES, VTOL_TYPES, OTHER_TYPES = (
    tuple(number for number, kind in MAV_KINDS.items() if kind in kinds)
    for kinds in (("multirotor",), ("VTOL",), ("helicopter", "rover", "boat", "submarine", "airship"))
)
PLANE_TYPES = (1,)
EKF_GLITCH, ESTIMATOR_GLITCH, EKF_UNINITIALISED = 1 << 15, 1 << 10, 1 << 10
PITOT_BIT = 0x10
"""Of the sensors in SYS_STATUS: present, enabled, healthy."""
ARMED_FLAG = 128
_REPEATED_MPS = 1e-3
"""An airspeed this close to the ground speed is a copy of it: a bridge without a sensor."""


def _numbers(values: Any) -> Any:
    """Numbers for computation: those of a log as an array; those of a live message, which are frequent, unconverted."""
    return values if isinstance(values, int | float) else np.asarray(values, dtype=np.float64)


def _whole(values: Any) -> Any:
    """Whole numbers with bits."""
    return values if isinstance(values, int) else np.asarray(values).astype(np.int64)


def _among(values: Any, wanted: tuple[int, ...]) -> Any:
    """Whether each value is one of some."""
    return values in wanted if isinstance(values, int | float) else np.isin(values, wanted)


def _real(values: Any, unknown: Any, scale: float = 1.0) -> Any:
    """Scaled numbers, NaN if `unknown` holds."""
    if isinstance(values, int | float):
        return math.nan if unknown else values * scale
    return np.where(unknown, np.nan, np.asarray(values, dtype=np.float64) * scale)


def _attitude(fields: Any) -> Columns:
    return {
        "roll_rad": _numbers(fields["roll"]),
        "pitch_rad": _numbers(fields["pitch"]),
        "yaw_rad": _numbers(fields["yaw"]),
    }


def euler(w: Any, x: Any, y: Any, z: Any) -> Columns:
    """Roll, pitch and yaw of a quaternion that turns the body (forward, right, down) into north-east-down."""
    w, x, y, z = (np.asarray(value, dtype=np.float64) for value in (w, x, y, z))
    sine = np.clip(2.0 * (w * y - z * x), -1.0, 1.0)
    return {
        "roll_rad": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "pitch_rad": np.arcsin(sine),
        "yaw_rad": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


def _position(fields: Any) -> Columns:
    nowhere = (_numbers(fields["lat"]) == 0) & (_numbers(fields["lon"]) == 0)
    return {
        "lat_deg": _real(fields["lat"], nowhere, 1e-7),
        "lon_deg": _real(fields["lon"], nowhere, 1e-7),
        "alt_msl_m": _real(fields["alt"], nowhere, 1e-3),
        "height_m": _numbers(fields["relative_alt"]) * 1e-3,
        "vel_north_mps": _real(fields["vx"], nowhere, 1e-2),
        "vel_east_mps": _real(fields["vy"], nowhere, 1e-2),
        "vel_down_mps": _real(fields["vz"], nowhere, 1e-2),
    }


def _hud(fields: Any) -> Columns:
    airspeed = np.asarray(fields["airspeed"], dtype=np.float64)
    repeated = np.abs(airspeed - np.asarray(fields["groundspeed"], dtype=np.float64)) < _REPEATED_MPS
    unknown = (airspeed == 0.0) | ~np.isfinite(airspeed) | repeated
    height = np.clip(np.nan_to_num(np.asarray(fields["alt"], dtype=np.float64)), -500.0, 9000.0)
    return {
        "airspeed_mps": _real(airspeed, unknown) / np.sqrt(density_ratio(height)),
        "throttle": np.asarray(fields["throttle"], dtype=np.float64) / 100.0,
    }


def wind(north: Any, east: Any) -> Columns:
    """Wind of an estimator, which reports 0 until it starts."""
    towards = np.asarray(north, dtype=np.float64), np.asarray(east, dtype=np.float64)
    alive = np.isfinite(towards[0]) & np.isfinite(towards[1]) & ((towards[0] != 0.0) | (towards[1] != 0.0))
    return {
        f"wind_{name}_mps": np.where(alive, one, np.nan) for name, one in zip(("north", "east"), towards, strict=True)
    }


def _wind(fields: Any) -> Columns:
    return wind(*vector(np.asarray(fields["speed"], dtype=np.float64), fields["direction"]))


def _status(fields: Any) -> Columns:
    volts, amperes, percent = (
        _numbers(fields[name]) for name in ("voltage_battery", "current_battery", "battery_remaining")
    )
    present, enabled, health = (
        _whole(fields[f"onboard_control_sensors_{name}"]) for name in ("present", "enabled", "health")
    )
    return {
        "voltage_v": _real(volts, (volts == 0) | (volts == 65535), 1e-3),
        "current_a": _real(amperes, amperes < 0, 1e-2),
        "soc": _real(percent, (percent < 0) | (percent > 100), 1e-2),
        "airspeed_ok": _numbers((present & enabled & health & PITOT_BIT) // PITOT_BIT),
    }


def _receiver(fields: Any) -> Columns:
    eph, satellites = (np.asarray(fields[name], dtype=np.float64) for name in ("eph", "satellites_visible"))
    hdop = np.where(eph >= 65535.0, np.nan, eph / 100.0)
    error = np.asarray(fields["vel_acc"] if "vel_acc" in _names(fields) else 0.0, dtype=np.float64) / 1000.0
    return {"gps_ok": receiver_ok(fields["fix_type"], np.where(satellites == 255.0, np.nan, satellites), hdop, error)}


def _names(fields: Any) -> Any:
    """Names of the fields of a message, live or of a log."""
    return fields.dtype.names if isinstance(fields, np.ndarray) else fields


def _ekf_status(fields: Any) -> Columns:
    return {
        "ekf_ok": estimate_ok(
            fields["velocity_variance"], fields["pos_horiz_variance"], fields["flags"], EKF_GLITCH | EKF_UNINITIALISED
        )
    }


def _estimator_status(fields: Any) -> Columns:
    return {"ekf_ok": estimate_ok(fields["vel_ratio"], fields["pos_horiz_ratio"], fields["flags"], ESTIMATOR_GLITCH)}


def _battery(fields: Any) -> Columns:
    percent = np.asarray(fields["battery_remaining"])
    unknown = (percent < 0) | (percent > 100) | (np.asarray(fields["id"]) != 0)
    return {} if np.all(unknown) else {"soc": _real(percent, unknown, 1e-2)}


def on_rotors(autopilot: Any, custom_mode: Any) -> tuple[Any, Any]:
    """Whether the modes of each MAV_AUTOPILOT show that a plane hovers on its rotors, and whether it does; arrays or numbers."""
    tells: Any = False
    stands: Any = False
    for family in FAMILIES.values():
        modes = family.modes.on_rotors
        if modes:
            mine = autopilot == family.firmware
            tells = tells | mine
            stands = stands | mine & (
                custom_mode in modes if isinstance(custom_mode, int) else np.isin(custom_mode, modes)
            )
    return tells, stands


def _heartbeat(fields: Any) -> Columns:
    kind = fields["type"]
    nobody = _among(kind, GROUND_TYPES) | (_numbers(fields["autopilot"]) == 8)
    if np.all(nobody):
        return {}
    armed = (np.asarray(fields["base_mode"]) & ARMED_FLAG) != 0
    columns = {"armed": _real(armed, nobody), "mode": _real(fields["custom_mode"], nobody)}
    autopilot, mode = (_numbers(fields[name]) for name in ("autopilot", "custom_mode"))
    tells, stands = on_rotors(autopilot, mode)
    by_mode = _among(kind, PLANE_TYPES + VTOL_TYPES) & tells
    wings = _among(kind, PLANE_TYPES) | by_mode
    hover = by_mode & stands
    known = _among(kind, PLANE_TYPES + ROTOR_TYPES + OTHER_TYPES) | by_mode
    if np.any(known):
        hangs = np.where(wings & np.logical_not(hover), 1.0, np.where(_among(kind, OTHER_TYPES), NEITHER, 0.0))
        columns["fixed_wing"] = np.where(np.logical_not(known) | nobody, np.nan, hangs)
    return columns


def _extended(fields: Any) -> Columns:
    state, vtol = np.asarray(fields["landed_state"]), np.asarray(fields["vtol_state"])
    columns = {"landed": _real(state == 1, state == 0)}
    if np.any(vtol > 0):
        columns["fixed_wing"] = np.select([vtol == 0, vtol == 3, vtol == 4], [np.nan, 0.0, 1.0], NEITHER)
    return columns


SPOKEN: Mapping[str, Callable[[Any], Columns]] = {
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": lambda fields: euler(fields["q1"], fields["q2"], fields["q3"], fields["q4"]),
    "GLOBAL_POSITION_INT": _position,
    "VFR_HUD": _hud,
    "WIND": _wind,
    "WIND_COV": lambda fields: wind(fields["wind_x"], fields["wind_y"]),
    "SYS_STATUS": _status,
    "BATTERY_STATUS": _battery,
    "GPS_RAW_INT": _receiver,
    "EKF_STATUS_REPORT": _ekf_status,
    "ESTIMATOR_STATUS": _estimator_status,
    "HEARTBEAT": _heartbeat,
    "EXTENDED_SYS_STATE": _extended,
    "MISSION_CURRENT": lambda fields: {"mission_item": _numbers(fields["seq"])},
    "MISSION_ITEM_REACHED": lambda fields: {"mission_reached": _numbers(fields["seq"])},
}
"""Messages that telemetry is made of, and the quantities in each, by the names of `models.drones.telemetry`; empty if it has none
of the vehicle. Its fields come as MAVLink sends them, in its units: a mapping of numbers or arrays, or a structured array."""
