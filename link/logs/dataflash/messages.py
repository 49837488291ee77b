"""DataFlash messages as telemetry quantities, and the meaning of its events.

Sources: ArduPilot's ``LogStructure.h`` and ``LogEvent``, ``LogErrorSubsystem``, ``LogErrorCode`` of ``AP_Logger.h``; numbers are
never reused there, so those of all generations are in one table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.messages import wind
from skyway.link.logs.common.trust import MAX_SPEED_ERROR_MPS, estimate_ok, receiver_ok
from skyway.missions.autopilots.ardupilot.modes import MODES

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import Kind

Fields = dict[str, "NDArray[Any]"]
Columns = dict[str, "NDArray[np.float64]"]

GLITCH_BIT = 1 << 14
"""Of the solution status ``SS`` (nav_filter_status)."""
ARMED, DISARMED, LANDED, FLYING = 10, 11, 18, 28
EVENTS = {
    ARMED: "armed",
    DISARMED: "disarmed",
    LANDED: "landed",
    FLYING: "has left the ground",
    19: "GPS lost",
    21: "flip begun",
    22: "flip over",
    25: "home set",
    41: "fence enabled",
    42: "fence disabled",
    46: "gripper closed",
    47: "gripper opened",
    49: "parachute disabled",
    50: "parachute enabled",
    51: "parachute released",
    52: "landing gear down",
    53: "landing gear up",
    54: "motors stopped in emergency",
    55: "emergency stop cleared",
    56: "motor interlock disabled",
    57: "motor interlock enabled",
    58: "rotor at full speed",
    59: "rotor below critical speed",
    60: "EKF height reset",
    61: "landing cancelled by the pilot",
    62: "EKF yaw reset",
    63: "ADS-B avoidance enabled",
    64: "ADS-B avoidance disabled",
    65: "proximity avoidance enabled",
    66: "proximity avoidance disabled",
    67: "primary GPS changed",
    80: "fence floor enabled",
    81: "fence floor disabled",
    163: "at the surface",
    164: "below the surface",
    165: "on the bottom",
    166: "off the bottom",
}
"""``EV.Id``; omitted events (tuning and training) are irrelevant to a flight."""
CRASH_CHECK, EKF_CHECK, EKF_FAILSAFE, GPS = 12, 16, 17, 11
_SUBSYSTEMS = {
    1: "main loop",
    2: "radio",
    3: "compass",
    4: "optical flow",
    5: "radio failsafe",
    6: "battery failsafe",
    7: "GPS failsafe",
    8: "ground station failsafe",
    9: "fence failsafe",
    10: "flight mode",
    GPS: "GPS",
    CRASH_CHECK: "crash check",
    13: "flip",
    14: "autotune",
    15: "parachute",
    EKF_CHECK: "EKF check",
    EKF_FAILSAFE: "EKF failsafe",
    18: "barometer",
    19: "processor",
    20: "ADS-B failsafe",
    21: "terrain data",
    22: "navigation",
    23: "terrain failsafe",
    24: "EKF primary",
    25: "thrust loss",
    26: "sensor failsafe",
    27: "leak failsafe",
    28: "pilot input failsafe",
    29: "vibration failsafe",
    30: "internal error",
    31: "dead reckoning failsafe",
}
_CODES = {
    (CRASH_CHECK, 1): "crash detected",
    (CRASH_CHECK, 2): "crash detected: loss of control",
    (EKF_CHECK, 2): "EKF check: bad variance",
    (EKF_CHECK, 0): "EKF check: variance cleared",
    (GPS, 2): "GPS glitch",
    (GPS, 0): "GPS glitch cleared",
    (1, 1): "main loop: delayed by the inertial sensors",
    (2, 2): "radio: late frame",
    (9, 1): "fence failsafe: breach of the height limit",
    (9, 2): "fence failsafe: breach of the circle",
    (9, 3): "fence failsafe: breach of height limit and circle",
    (9, 4): "fence failsafe: breach of the polygon",
    (18, 2): "barometer: glitch",
    (13, 2): "flip: abandoned",
    (15, 2): "parachute: not released, too low",
    (15, 3): "parachute: not released, landed",
    (21, 2): "terrain data: missing",
    (22, 2): "navigation: destination not set",
    (22, 3): "navigation: return restarted",
    (22, 4): "navigation: circle not begun",
    (22, 5): "navigation: destination outside the fence",
    (25, 1): "thrust loss: potential",
    (29, 1): "vibration failsafe: begun",
}
_FAILSAFES = (5, 6, 7, 8, 9, 17, 20, 23, 26, 27, 28, 29, 31)


def error_text(kind: Kind, subsystem: int, code: int) -> str:
    """Meaning of a message ERR."""
    name = _SUBSYSTEMS.get(subsystem, f"subsystem {subsystem}")
    known = _CODES.get((subsystem, code))
    if known is not None:
        return known
    if subsystem == 10:
        return f"flight mode: change to {MODES.log_name(kind, code)} refused"
    if subsystem == 24:
        return f"EKF primary: changed to core {code}"
    if code == 0:
        return f"{name}: resolved"
    if subsystem in _FAILSAFES:
        return f"{name}: triggered"
    meaning = {1: "failed to initialise", 4: "unhealthy"}.get(code, f"code {code}")
    return f"{name}: {meaning}"


def doubt_of(subsystem: int, code: int) -> bool | None:
    """Whether an ERR begins (True) or ends (False) a doubt of position and velocity; None: neither."""
    if subsystem in (GPS, EKF_CHECK, EKF_FAILSAFE, 7, 31):
        return code != 0
    return None


def _numbers(fields: Fields, key: str, default: float = np.nan) -> NDArray[np.float64]:
    some = next(iter(fields.values()))
    return np.asarray(fields[key], dtype=np.float64) if key in fields else np.full(len(some), default)


def _first(fields: Fields) -> NDArray[np.bool_]:
    """Messages of the first sensor, core or battery, which is the one that is used."""
    numbers = [_numbers(fields, key, 0.0) for key in ("I", "C", "Inst", "Instance")]
    return np.asarray(np.all(np.stack(numbers) == 0.0, axis=0))


def _attitude(fields: Fields) -> Columns:
    return {
        "roll_rad": np.radians(fields["Roll"]),
        "pitch_rad": np.radians(fields["Pitch"]),
        "yaw_rad": np.radians(fields["Yaw"]),
    }


def _gps(fields: Fields) -> Columns:
    fixed = np.asarray(fields["Status"]) >= 3
    course = np.radians(fields["GCrs"])
    columns = {
        "lat_deg": fields["Lat"],
        "lon_deg": fields["Lng"],
        "alt_msl_m": fields["Alt"],
        "vel_north_mps": fields["Spd"] * np.cos(course),
        "vel_east_mps": fields["Spd"] * np.sin(course),
        "vel_down_mps": _numbers(fields, "VZ"),
    }
    if "RelAlt" in fields:
        columns["height_m"] = fields["RelAlt"]
    found = {name: np.where(fixed, values, np.nan) for name, values in columns.items()}
    found["gps_ok"] = receiver_ok(fields["Status"], _numbers(fields, "NSats"), _numbers(fields, "HDop"))
    return found


def _receiver(fields: Fields) -> NDArray[np.bool_]:
    return _first(fields) if "U" not in fields else np.asarray(_numbers(fields, "U") > 0.0)


def _accuracy(fields: Fields) -> Columns:
    """A receiver that reports the accuracy of its velocity."""
    bad = _numbers(fields, "SAcc") > MAX_SPEED_ERROR_MPS
    return {"gps_ok": np.where(bad, 0.0, 1.0)}


def doubting(
    receiver: tuple[NDArray[np.float64], Columns], accuracy: tuple[NDArray[np.float64], Columns]
) -> tuple[NDArray[np.float64], Columns]:
    """Return the quantities of messages GPS, distrusted according to the GPA that belongs to them."""
    (times, columns), (when, said) = receiver, accuracy
    if not len(when):
        return receiver
    nearest = np.minimum(np.searchsorted(when, times), len(when) - 1)
    return times, columns | {"gps_ok": np.minimum(columns["gps_ok"], said["gps_ok"][nearest])}


def _position(fields: Fields) -> Columns:
    columns = {"lat_deg": fields["Lat"], "lon_deg": fields["Lng"], "alt_msl_m": fields["Alt"]}
    if "RelHomeAlt" in fields:
        columns["height_m"] = fields["RelHomeAlt"]
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}


def _estimate(fields: Fields) -> Columns:
    return {f"vel_{name}_mps": fields[key] for name, key in (("north", "VN"), ("east", "VE"), ("down", "VD"))}


def _estimate_status(fields: Fields) -> Columns:
    status = fields["SS"] if "SS" in fields else np.full(len(fields["SV"]), 1 << 1)
    return {"ekf_ok": estimate_ok(fields["SV"], fields["SP"], status, GLITCH_BIT)}


def _wind(fields: Fields) -> Columns:
    return wind(fields["VWN"], fields["VWE"])


def _battery(fields: Fields) -> Columns:
    volts, amperes = (np.asarray(fields[key], dtype=np.float64) for key in ("Volt", "Curr"))
    if "Vcc" in fields:  # the CURR message of old logs is in hundredths
        volts, amperes = volts * 0.01, amperes * 0.01
    columns = {"voltage_v": volts, "current_a": amperes}
    connected = bool((volts > 1.0).any()) and bool((amperes != 0.0).any())
    soc = {"soc": np.asarray(fields["RemPct"], dtype=np.float64) / 100.0} if "RemPct" in fields else {}
    return (
        {name: np.where(volts > 1.0, values, np.nan) for name, values in (columns | soc).items()} if connected else {}
    )


def _airspeed(fields: Fields) -> Columns:
    speed = np.asarray(fields["Airspeed"], dtype=np.float64)
    used = _numbers(fields, "U", 1.0) > 0.0
    healthy = _numbers(fields, "H", 1.0) * _numbers(fields, "Health", 1.0) > 0.0
    return {
        "airspeed_mps": np.where(speed > 0.0, speed, np.nan),
        "airspeed_ok": np.where(used & healthy, 1.0, 0.0),
    }


def _event(fields: Fields) -> Columns:
    number = _numbers(fields, "Id")
    return {
        "armed": np.select([number == ARMED, number == DISARMED], [1.0, 0.0], np.nan),
        "landed": np.select([number == LANDED, number == FLYING], [1.0, 0.0], np.nan),
    }


def _error(fields: Fields) -> Columns:
    crashed = (_numbers(fields, "Subsys") == CRASH_CHECK) & np.isin(_numbers(fields, "ECode"), (1, 2))
    return {"landed": np.where(crashed, 1.0, np.nan)}


def _status(fields: Fields) -> Columns:
    columns = {"landed": (_numbers(fields, "isFlying") == 0.0).astype(np.float64)}
    if "Armed" in fields:
        columns["armed"] = (_numbers(fields, "Armed") > 0.0).astype(np.float64)
    return columns


def mode_numbers(fields: Fields) -> NDArray[np.float64]:
    """Mode of each message MODE, in old logs and in new ones."""
    return _numbers(fields, "ModeNum") if "ModeNum" in fields else _numbers(fields, "Mode")


def hovering(mode: NDArray[np.float64]) -> NDArray[np.float64]:
    """`models.drones.telemetry` ``fixed_wing`` of a VTOL by its mode."""
    hover = np.isin(mode, MODES.on_rotors)
    return np.where(np.isnan(mode), np.nan, np.where(hover, 0.0, 1.0))


ESTIMATES = ("EKF1", "NKF1", "XKF1")
"""Messages with a better velocity than the receiver's."""
SPOKEN: dict[str, tuple[Callable[[Fields], Columns], Callable[[Fields], NDArray[np.bool_]] | None]] = {
    "ATT": (_attitude, None),
    "GPS": (_gps, _receiver),
    "GPA": (_accuracy, _first),
    "POS": (_position, None),
    "EKF1": (_estimate, None),
    "NKF1": (_estimate, _first),
    "XKF1": (_estimate, _first),
    "EKF2": (_wind, None),
    "NKF2": (_wind, _first),
    "XKF2": (_wind, _first),
    "EKF4": (_estimate_status, None),
    "NKF4": (_estimate_status, _first),
    "XKF4": (_estimate_status, _first),
    "CURR": (_battery, None),
    "BAT": (_battery, _first),
    "ARSP": (_airspeed, _first),
    "ARM": (lambda fields: {"armed": (_numbers(fields, "ArmState") > 0.0).astype(np.float64)}, None),
    "EV": (_event, None),
    "ERR": (_error, None),
    "STAT": (_status, None),
    "MODE": (lambda fields: {"mode": mode_numbers(fields)}, None),
}
"""Messages that telemetry is made of, the quantities in each, and which of them are used."""
_PARTIAL = ("EV", "ERR")
"""Messages that each contain one quantity, and none of the others."""


def quantities(name: str, fields: Fields, times: NDArray[np.float64]) -> dict[str, tuple[NDArray[np.float64], Columns]]:
    """Return the series in messages of one type: times and columns, by name.

    Messages of another sensor, or another core of the filter, than the one in use are omitted.
    """
    speak, choose = SPOKEN[name]
    columns = speak(fields)
    if not columns:
        return {}
    chosen = np.ones(len(times), dtype=np.bool_) if choose is None else choose(fields)
    if name not in _PARTIAL:
        return {name: (times[chosen], {key: np.asarray(values)[chosen] for key, values in columns.items()})}
    found = {}
    for key, values in columns.items():
        said = chosen & np.isfinite(values)
        found[f"{name} {key}"] = times[said], {key: values[said]}
    return found
