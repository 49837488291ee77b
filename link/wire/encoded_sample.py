"""Telemetry samples encoded as MAVLink messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.link.wire.frames import FrameWriter

if TYPE_CHECKING:
    from skyway.models.drones.telemetry import TelemetrySample

UNKNOWN_HEADING = 65535
_INT32, _INT16 = 2**31 - 1, 32767
_PLANE, _QUADROTOR = 1, 2
"""MAV_TYPE."""
_ARMED, _ACTIVE = 128, 4
"""Of MAV_MODE_FLAG; MAV_STATE."""


def encode(sample: TelemetrySample, zero_s: float) -> bytes:
    """Make HEARTBEAT, ATTITUDE, VFR_HUD, SYS_STATUS and, if the place is known, GLOBAL_POSITION_INT of a sample.

    `zero_s` is the time of the vehicle's start.
    """
    s, boot_ms = sample, int(max(sample.time_s - zero_s, 0.0) * 1000.0) & 0xFFFFFFFF
    kind, armed = _PLANE if s.fixed_wing == 1.0 else _QUADROTOR, _ARMED if s.armed == 1.0 else 0
    angles = {"roll": _real(s.roll_rad), "pitch": _real(s.pitch_rad), "yaw": _real(s.yaw_rad)}
    speeds = {"airspeed": _real(s.airspeed_mps), "groundspeed": _real(s.ground_speed_mps)}
    messages: dict[str, dict[str, Any]] = {
        "HEARTBEAT": {"type": kind, "base_mode": armed, "system_status": _ACTIVE, "mavlink_version": 3},
        "ATTITUDE": {"time_boot_ms": boot_ms, **angles},
        "VFR_HUD": {**speeds, "alt": _real(s.alt_msl_m), "climb": -_real(s.vel_down_mps)},
        "SYS_STATUS": {
            "voltage_battery": _whole(s.voltage_v, 1000.0, 65535, 65534),
            "current_battery": _whole(s.current_a, 100.0, -1, _INT16),
            "battery_remaining": _whole(s.soc, 100.0, -1, 100),
        },
    }
    if math.isfinite(s.lat_deg):
        messages["GLOBAL_POSITION_INT"] = {
            "time_boot_ms": boot_ms,
            **{name: _whole(value, 1e7, 0, _INT32) for name, value in (("lat", s.lat_deg), ("lon", s.lon_deg))},
            **{name: _whole(v, 1e3, 0, _INT32) for name, v in (("alt", s.alt_msl_m), ("relative_alt", s.height_m))},
            "vx": _whole(s.vel_north_mps, 100.0, 0, _INT16),
            "vy": _whole(s.vel_east_mps, 100.0, 0, _INT16),
            "vz": _whole(s.vel_down_mps, 100.0, 0, _INT16),
            "hdg": UNKNOWN_HEADING,
        }
    writer = FrameWriter(s.system, 1)
    return b"".join(writer.frame(name, fields) for name, fields in messages.items())


def _whole(value: float, scale: float, unknown: int, most: int) -> int:
    return min(max(round(value * scale), -most), most) if math.isfinite(value) else unknown


def _real(value: float) -> float:
    return value if math.isfinite(value) else 0.0
