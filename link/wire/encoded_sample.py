"""Telemetry samples encoded as MAVLink messages."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.models.drones.telemetry import TelemetrySample

UNKNOWN_HEADING = 65535
_INT32, _INT16 = 2**31 - 1, 32767


def encode(sample: TelemetrySample, zero_s: float) -> bytes:
    """Make HEARTBEAT, ATTITUDE, VFR_HUD, SYS_STATUS and, where the place is known, GLOBAL_POSITION_INT of a sample.

    Parameters
    ----------
    sample : TelemetrySample
    zero_s : float
        Time that counts as the start of the vehicle.
    """
    from pymavlink.dialects.v20 import common

    link = common.MAVLink(io.BytesIO(), srcSystem=sample.system, srcComponent=1)
    boot_ms = int(max(sample.time_s - zero_s, 0.0) * 1000.0) & 0xFFFFFFFF
    attitude = (_real(value) for value in (sample.roll_rad, sample.pitch_rad, sample.yaw_rad))
    messages: list[Any] = [
        _heartbeat(common, sample),
        common.MAVLink_attitude_message(boot_ms, *attitude, 0.0, 0.0, 0.0),
        common.MAVLink_vfr_hud_message(
            _real(sample.airspeed_mps),
            _real(sample.ground_speed_mps),
            0,
            0,
            _real(sample.alt_msl_m),
            -_real(sample.vel_down_mps),
        ),
        _status(common, sample),
    ]
    if math.isfinite(sample.lat_deg):
        messages.append(_position(common, sample, boot_ms))
    return b"".join(bytes(message.pack(link)) for message in messages)


def _whole(value: float, scale: float, unknown: int, most: int) -> int:
    return min(max(round(value * scale), -most), most) if math.isfinite(value) else unknown


def _real(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _heartbeat(common: Any, sample: TelemetrySample) -> Any:
    armed = common.MAV_MODE_FLAG_SAFETY_ARMED if sample.armed == 1.0 else 0
    kind = common.MAV_TYPE_FIXED_WING if sample.fixed_wing == 1.0 else common.MAV_TYPE_QUADROTOR
    return common.MAVLink_heartbeat_message(kind, common.MAV_AUTOPILOT_GENERIC, armed, 0, common.MAV_STATE_ACTIVE, 3)


def _status(common: Any, sample: TelemetrySample) -> Any:
    volts, amperes = _whole(sample.voltage_v, 1000.0, 65535, 65534), _whole(sample.current_a, 100.0, -1, _INT16)
    charge = _whole(sample.soc, 100.0, -1, 100)
    return common.MAVLink_sys_status_message(0, 0, 0, 0, volts, amperes, charge, 0, 0, 0, 0, 0, 0)


def _position(common: Any, sample: TelemetrySample, boot_ms: int) -> Any:
    place = (_whole(value, 1e7, 0, _INT32) for value in (sample.lat_deg, sample.lon_deg))
    heights = (_whole(value, 1e3, 0, _INT32) for value in (sample.alt_msl_m, sample.height_m))
    speeds = (
        _whole(value, 100.0, 0, _INT16) for value in (sample.vel_north_mps, sample.vel_east_mps, sample.vel_down_mps)
    )
    return common.MAVLink_global_position_int_message(boot_ms, *place, *heights, *speeds, UNKNOWN_HEADING)
