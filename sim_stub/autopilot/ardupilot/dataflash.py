"""ArduPilot's log: DataFlash, with messages as in Copter 4.6 (``LogStructure.h`` of AP_Logger, AP_NavEKF3, AP_GPS)."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

_PACKED = {
    "Q": "Q", "B": "B", "b": "b", "M": "B", "H": "H", "I": "I", "f": "f", "c": "h", "C": "H", "L": "i", "e": "i",
    "N": "16s", "Z": "64s", "n": "4s",
}  # fmt: skip
_KINDS = {
    "FMT": (0x80, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (32, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (33, "QZ", "TimeUS,Message"),
    "ARM": (34, "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
    "EV": (35, "QB", "TimeUS,Id"),
    "MODE": (36, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ATT": (37, "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF"),
    "POS": (38, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "XKF1": (39, "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "XKF4": (40, "QBcccccfffHBIHb", "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI"),
    "GPS": (41, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "BAT": (42, "QBfffffcfBBB", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH"),
}
"""Number, letters and columns of each type of message."""
_STRUCTS = {
    name: struct.Struct("<" + "".join(_PACKED[letter] for letter in letters))
    for name, (_, letters, _) in _KINDS.items()
}
_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315_964_800.0, 18.0, 604_800.0
_ARMED, _DISARMED = 10, 11
"""``EV.Id``."""
_SOUND, _WITHOUT_PLACE = 0x33F, 0x0A7
"""Solution status of the filter (nav_filter_status)."""


def _packed(name: str, *values: float | bytes) -> bytes:
    return b"\xa3\x95" + bytes([_KINDS[name][0]]) + _STRUCTS[name].pack(*values)


class DataFlash:
    """How ArduPilot writes its log: one for each time that it is switched on (``LOG_FILE_DSRMROT`` 0)."""

    LOG_FOR_EACH_ARMING: ClassVar[bool] = False

    def __init__(self) -> None:
        self._mode = -1

    def head(self, v: Vehicle) -> bytes:
        """Formats, parameters, and which version of which firmware it is."""
        self._mode = -1
        parts = [
            _packed("FMT", number, 3 + _STRUCTS[name].size, name.encode(), letters.encode(), columns.encode())
            for name, (number, letters, columns) in _KINDS.items()
        ]
        parts += [_packed("PARM", v.boot_us, p.name.encode(), p.value, p.value) for p in v.autopilot.parameters]
        major, minor = v.config.version
        parts.append(_packed("MSG", v.boot_us, f"ArduCopter V{major}.{minor}.0 (5a170000)".encode()))
        return b"".join(parts)

    def arming(self, v: Vehicle) -> bytes:
        """ARM, and the event."""
        armed = v.autopilot.armed
        event = _packed("EV", v.boot_us, _ARMED if armed else _DISARMED)
        return _packed("ARM", v.boot_us, int(armed), 0, 0, 0) + event

    def fast(self, v: Vehicle) -> bytes:
        """ATT, POS, XKF1."""
        b, us = v.body, v.boot_us
        roll, pitch, yaw = (math.degrees(angle) for angle in (b.roll, b.pitch, b.yaw))
        yaw %= 360.0
        north, east, down = v.local_ned()
        lat, lon = round(v.position.lat * 1e7), round(v.position.lon * 1e7)
        above_home = b.alt_m - v.autopilot.home_alt_m
        hundredths = (round(100.0 * roll), round(100.0 * pitch), round(100.0 * yaw))
        return (
            _packed("ATT", us, roll, roll, pitch, pitch, yaw, yaw, 3)
            + _packed("POS", us, lat, lon, b.alt_m, above_home, -down)
            + _packed(
                "XKF1",
                us,
                0,
                *hundredths,
                b.north_mps,
                b.east_mps,
                -b.up_mps,
                -b.up_mps,
                north,
                east,
                down,
                0,
                0,
                0,
                round(100.0 * v.origin[2]),
            )
        )

    def slow(self, v: Vehicle) -> bytes:
        """GPS, XKF4, BAT, and MODE where it has changed."""
        b, us = v.body, v.boot_us
        fixed = v.faults.positioning
        week, second = divmod(v.posix_s - _GPS_EPOCH_S + _LEAP_S, _WEEK_S)
        lat, lon = v.position.fix
        course = math.degrees(math.atan2(b.east_mps, b.north_mps)) % 360.0
        place = (round(lat * 1e7), round(lon * 1e7), round(100.0 * b.alt_m)) if fixed else (0, 0, 0)
        volts, amperes = v.battery.voltage_v, v.battery.current_a
        drawn = v.counted_mah
        percent = max(v.autopilot.reported_percent(), 0)
        parts = [
            _packed(
                "GPS", us, 0, 3 if fixed else 1, int(second * 1e3), int(week), 14 if fixed else 0, 90, *place,
                b.ground_speed_mps, course, -b.up_mps, 0.0, 1,
            ),
            _packed(
                "XKF4", us, 0, 5, 5, 5, 2, 0, 0.0, 0.0, 0.0, 0, 0, _SOUND if v.autopilot.ready else _WITHOUT_PLACE, 0, 0
            ),
            _packed("BAT", us, 0, volts, volts, amperes, drawn, drawn * 0.0228, 2500, 0.025, percent, 1, 100),
        ]  # fmt: skip
        mode = v.autopilot.custom_mode()
        if mode != self._mode:
            self._mode = mode
            parts.append(_packed("MODE", us, mode, mode, 1))
        return b"".join(parts)

    def text(self, v: Vehicle, severity: int, text: str) -> bytes:  # noqa: ARG002  MSG has no severity
        """MSG."""
        return _packed("MSG", v.boot_us, text.encode("ascii", "replace")[:64])
