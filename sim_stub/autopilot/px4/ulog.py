"""PX4's log: ULog, with topics as in its messages (``msg/*.msg``, 1.15 to main), as far as the simulator fills them."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, ClassVar

from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.autopilot.parameters import REAL32

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

_PACKED = {"uint64_t": "Q", "double": "d", "float": "f", "int32_t": "i", "uint16_t": "H", "uint8_t": "B", "bool": "B"}
_TOPICS = {
    "vehicle_attitude": "uint64_t timestamp;float[4] q;",
    "vehicle_local_position": (
        "uint64_t timestamp;double ref_lat;double ref_lon;float x;float y;float z;float vx;float vy;float vz;float ref_alt;"
        "float eph;float epv;float evh;float evv;bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;bool xy_global;bool z_global;"
    ),
    "sensor_gps": (
        "uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;uint64_t time_utc_usec;"
        "float s_variance_m_s;float eph;float epv;float hdop;float vdop;float vel_m_s;float cog_rad;"
        "uint8_t fix_type;bool vel_ned_valid;uint8_t satellites_used;"
    ),
    "battery_status": (
        "uint64_t timestamp;float voltage_v;float current_a;float discharged_mah;float remaining;float temperature;"
        "uint8_t cell_count;bool connected;uint8_t warning;"
    ),
    "estimator_status": "uint64_t timestamp;float vel_test_ratio;float pos_test_ratio;uint16_t solution_status_flags;",
    "vehicle_land_detected": "uint64_t timestamp;bool landed;",
    "vehicle_status": (
        "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;uint8_t vehicle_type;uint8_t system_type;uint8_t system_id;"
        "bool failsafe;bool is_vtol;bool in_transition_mode;"
    ),
}  # fmt: skip
"""Fields of each topic, larger ones first, as PX4 orders them; numbered in this order."""
_NUMBERS = {name: number for number, name in enumerate(_TOPICS)}
_NAV_STATES = {
    Mode.ALTITUDE: 1, Mode.POSITION: 2, Mode.MISSION: 3, Mode.HOLD: 4, Mode.BRAKE: 4, Mode.RTL: 5, Mode.OFFBOARD: 14,
    Mode.STABILIZE: 15, Mode.TAKEOFF: 17, Mode.LAND: 18, Mode.GUIDED: 4,
}  # fmt: skip
_ARMED, _DISARMED = 2, 1
_SOUND, _WITHOUT_PLACE = 0x33F, 0x0A7
_TEXT_LEVELS = b"01234567"


def _struct(fields: str) -> struct.Struct:
    letters = []
    for field in fields.rstrip(";").split(";"):
        kind = field.split(" ")[0]
        name, _, count = kind.partition("[")
        letters.append(_PACKED[name] * int(count.rstrip("]") or 1))
    return struct.Struct("<H" + "".join(letters))


_STRUCTS = {name: _struct(fields) for name, fields in _TOPICS.items()}


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _data(name: str, *values: float) -> bytes:
    return _message("D", _STRUCTS[name].pack(_NUMBERS[name], *values))


def _keyed(key: str, value: bytes) -> bytes:
    return bytes([len(key)]) + key.encode() + value


class ULog:
    """How PX4 writes its log: from arming to disarming (``SDLOG_MODE`` 0)."""

    LOG_FOR_EACH_ARMING: ClassVar[bool] = True

    def head(self, v: Vehicle) -> bytes:
        """Name and version, formats, parameters, and the numbers of the topics."""
        version = v.config.version_number
        parts = [
            b"ULog\x01\x12\x35\x01" + struct.pack("<Q", v.boot_us),
            _message("B", bytes(40)),
            _message("I", _keyed("char[3] sys_name", b"PX4")),
            _message("I", _keyed("uint32_t ver_sw_release", struct.pack("<I", version))),
        ]
        parts += [_message("F", f"{name}:{fields}".encode()) for name, fields in _TOPICS.items()]
        for one in v.autopilot.parameters:
            real = one.kind == REAL32
            value = struct.pack("<f", one.value) if real else struct.pack("<i", int(one.value))
            parts.append(_message("P", _keyed(f"{'float' if real else 'int32_t'} {one.name}", value)))
        for name, number in _NUMBERS.items():
            parts.append(_message("A", struct.pack("<BH", 0, number) + name.encode()))
        return b"".join(parts)

    def arming(self, v: Vehicle) -> bytes:
        """vehicle_status, and whether it has landed."""
        return self._status(v)

    def fast(self, v: Vehicle) -> bytes:
        """Attitude and local position."""
        b, us = v.body, v.boot_us
        half = [0.5 * angle for angle in (b.roll, b.pitch, b.yaw)]
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in half)
        attitude = (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
        sound = v.autopilot.ready
        return _data("vehicle_attitude", us, *attitude) + _data(
            "vehicle_local_position", us, *v.origin[:2], *v.local_ned(), b.north_mps, b.east_mps, -b.up_mps, v.origin[2],
            0.4, 0.6, 0.2, 0.3, *([sound] * 6),
        )  # fmt: skip

    def slow(self, v: Vehicle) -> bytes:
        """Receiver, battery, filter and status."""
        b, us, fixed = v.body, v.boot_us, v.faults.positioning
        lat, lon = v.position.fix
        place = (lat, lon, b.alt_m) if fixed else (0.0, 0.0, 0.0)
        percent = v.autopilot.reported_percent()
        remaining = percent / 100.0 if percent >= 0 else -1.0
        receiver = (3, 1, 14) if fixed else (1, 0, 0)
        return (
            _data(
                "sensor_gps", us, *place, int(v.posix_s * 1e6), 0.2, 0.9, 1.4, 0.9, 1.2, b.ground_speed_mps,
                math.atan2(b.east_mps, b.north_mps), *receiver,
            )
            + _data(
                "battery_status", us, v.battery.voltage_v, v.battery.current_a, v.counted_mah, remaining, 25.0, 6, 1,
                v.autopilot.failsafes.battery_level,
            )
            + _data("estimator_status", us, 0.05, 0.05, _SOUND if v.autopilot.ready else _WITHOUT_PLACE)
            + self._status(v)
        )  # fmt: skip

    def text(self, v: Vehicle, severity: int, text: str) -> bytes:
        """Logged string."""
        level = _TEXT_LEVELS[min(max(severity, 0), 7)]
        return _message("L", struct.pack("<BQ", level, v.boot_us) + text.encode())

    @staticmethod
    def _status(v: Vehicle) -> bytes:
        pilot = v.autopilot
        state, mode = _ARMED if pilot.armed else _DISARMED, _NAV_STATES[pilot.mode]
        failing = int(bool(pilot.failsafes.active))
        return _data("vehicle_land_detected", v.boot_us, pilot.landed) + _data(
            "vehicle_status", v.boot_us, state, mode, 1, 2, v.config.system, failing, 0, 0
        )
