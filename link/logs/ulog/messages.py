"""PX4 topics as telemetry quantities, over all generations of their fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.messages import euler, wind
from skyway.link.logs.common.trust import estimate_ok, receiver_ok
from skyway.models.base import geodesy
from skyway.models.drones.telemetry import NEITHER

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Columns = dict[str, "NDArray[np.float64]"]
ARMED = 2.0
"""``vehicle_status.arming_state``."""
FIXED_WING = 2.0
"""``vehicle_status.vehicle_type``."""
GLITCH_BIT = 1 << 10
"""Of ``estimator_status.solution_status_flags``."""
MAX_HORIZONTAL_MPS = 2.0
"""Standard deviation of the velocity according to PX4's filter."""


def _numbers(data: dict[str, Any], key: str, default: float = np.nan) -> NDArray[np.float64]:
    return np.asarray(data[key], dtype=np.float64) if key in data else np.full(len(data["timestamp"]), default)


def _local(data: dict[str, Any]) -> Columns:
    good = _numbers(data, "v_xy_valid", 1.0) > 0.0
    trusted = good & (_numbers(data, "dead_reckoning", 0.0) == 0.0) & ~(_numbers(data, "evh") > MAX_HORIZONTAL_MPS)
    columns = {
        "vel_north_mps": np.where(good, data["vx"], np.nan),
        "vel_east_mps": np.where(good, data["vy"], np.nan),
        "vel_down_mps": np.where(good, data["vz"], np.nan),
        "height_m": -_numbers(data, "z"),
        "position_ok": trusted.astype(np.float64),
    }
    lat, lon = _numbers(data, "ref_lat"), _numbers(data, "ref_lon")
    placed = np.isfinite(lat) & (np.abs(lat) < 90.0) & (np.abs(lon) <= 180.0) & (lat != 0.0)
    placed &= _numbers(data, "xy_global", 1.0) > 0.0
    if placed.any():
        here = float(lat[placed][0]), float(lon[placed][0])
        per_lat = geodesy.distance_m(here[0] - 0.005, here[1], here[0] + 0.005, here[1]) * 100
        per_lon = geodesy.distance_m(here[0], here[1] - 0.005, here[0], here[1] + 0.005) * 100
        columns["lat_deg"] = np.where(placed, lat + _numbers(data, "x") / per_lat, np.nan)
        columns["lon_deg"] = np.where(placed, lon + _numbers(data, "y") / max(per_lon, 1.0), np.nan)
        columns["alt_msl_m"] = np.where(placed, _numbers(data, "ref_alt") - _numbers(data, "z"), np.nan)
    return columns


def _receiver(data: dict[str, Any]) -> Columns:
    speed = _numbers(data, "s_variance_m_s")
    satellites = _numbers(data, "satellites_used")
    good = receiver_ok(data["fix_type"], satellites, _numbers(data, "hdop"), speed)
    spoofed = _numbers(data, "spoofing_state", 0.0) >= 2.0
    invalid = _numbers(data, "vel_ned_valid", 1.0) == 0.0
    return {"gps_ok": np.where(spoofed | invalid, 0.0, good)}


def _estimator(data: dict[str, Any]) -> Columns:
    velocity, position = _numbers(data, "vel_test_ratio", 0.0), _numbers(data, "pos_test_ratio", 0.0)
    status = data.get("solution_status_flags", np.full(len(velocity), 1 << 1))
    return {"ekf_ok": estimate_ok(velocity, position, status, GLITCH_BIT)}


def _battery(data: dict[str, Any]) -> Columns:
    volts = _numbers(data, "voltage_v")
    amperes, remaining = _numbers(data, "current_a"), _numbers(data, "remaining")
    return {
        "voltage_v": np.where(volts > 0.0, volts, np.nan),
        "current_a": np.where(amperes >= 0.0, amperes, np.nan),
        "soc": np.where((remaining >= 0.0) & (remaining <= 1.0), remaining, np.nan),
    }


def _status(data: dict[str, Any]) -> Columns:
    columns = {"mode": _numbers(data, "nav_state")}
    if "arming_state" in data:
        columns["armed"] = (_numbers(data, "arming_state") == ARMED).astype(np.float64)
    if "condition_landed" in data:
        columns["landed"] = _numbers(data, "condition_landed")
    kind, rotary = _numbers(data, "vehicle_type"), _numbers(data, "is_rotary_wing")
    wings = np.where(np.isfinite(kind), kind == FIXED_WING, rotary == 0.0).astype(np.float64)
    known = np.isfinite(kind) | np.isfinite(rotary)
    turn_back = _numbers(data, "in_transition_mode", 0.0) > 0.0
    other = np.isfinite(kind) & (kind != FIXED_WING) & (kind != 1.0)
    columns["fixed_wing"] = np.where(known, np.where(turn_back | other, NEITHER, wings), np.nan)
    return columns


def _vtol(data: dict[str, Any]) -> Columns:
    if "vehicle_vtol_state" in data:
        state = _numbers(data, "vehicle_vtol_state")
        return {"fixed_wing": np.select([state == 3.0, state == 4.0], [0.0, 1.0], NEITHER)}
    turn_back = _numbers(data, "vtol_in_trans_mode") > 0.0
    hovers = (_numbers(data, "vtol_in_rw_mode") > 0.0).astype(np.float64)
    return {"fixed_wing": np.where(turn_back, NEITHER, 1.0 - hovers)}


def _wind(data: dict[str, Any]) -> Columns:
    return wind(_numbers(data, "windspeed_north"), _numbers(data, "windspeed_east"))


def _airspeed(data: dict[str, Any]) -> Columns:
    """Airspeed of a sensor: PX4 publishes an invented one if the sensor fails, or there is none."""
    speed = _numbers(data, "true_airspeed_m_s")
    source = _numbers(data, "airspeed_source", _DEFAULT_SOURCE)
    chosen = _numbers(data, "selected_airspeed_index", _DEFAULT_SOURCE)
    real = (source >= 1.0) & (source <= 3.0) & (chosen >= 1.0) & (chosen <= 3.0)
    good = real & (_numbers(data, "airspeed_sensor_measurement_valid", 1.0) > 0.0)
    return {"airspeed_mps": np.where(speed > 0.0, speed, np.nan), "airspeed_ok": good.astype(np.float64)}


_DEFAULT_SOURCE = 1.0
"""The topic ``airspeed`` is that of a sensor."""


SPOKEN: dict[str, Callable[[dict[str, Any]], Columns]] = {
    "vehicle_attitude": lambda data: euler(
        *(np.asarray(data[f"q[{number}]"], dtype=np.float64) for number in range(4))
    ),
    "vehicle_local_position": _local,
    "vehicle_gps_position": _receiver,
    "sensor_gps": _receiver,
    "estimator_status": _estimator,
    "battery_status": _battery,
    "vehicle_land_detected": lambda data: {"landed": _numbers(data, "landed")},
    "vehicle_status": _status,
    "vtol_vehicle_status": _vtol,
    "wind": _wind,
    "wind_estimate": _wind,
    "airspeed_validated": _airspeed,
    "airspeed": _airspeed,
    "mission_result": lambda data: {"mission_item": _numbers(data, "seq_current")},
}
"""Topics that telemetry is made of, and the quantities in each."""
REPLACED = {"airspeed": "airspeed_validated", "wind_estimate": "wind", "sensor_gps": "vehicle_gps_position"}
"""Topics that are omitted if a better one is present."""
