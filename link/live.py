"""Live telemetry: messages of one vehicle become samples, and what is doubtful about them is said.

It means the same as `link.logs.assembly`, which does whole logs at once; this does one message in microseconds.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from link.timebase import VehicleClock
from models.telemetry import TelemetrySample

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from link.frames import Message

FRESH_S, SLOW_FRESH_S = 2.0, 15.0
_TICK_GAP_S = 0.5
_SLOW = frozenset(("soc", "armed", "landed", "fixed_wing", "mission_item", "mode", "wind_north_mps", "wind_east_mps"))
_JUMP_MPS, _SOC_JUMP, _STUCK_S, _STUCK_W = 150.0, 0.08, 180.0, 100.0
_PLANE, _VTOL_PLANE = 1, 4
RATES_HZ: Mapping[int, float] = {30: 10.0, 33: 5.0, 74: 2.0, 1: 1.0, 147: 1.0, 245: 1.0, 42: 1.0, 2: 1.0, 168: 1.0}
"""Messages that telemetry is made of, and how often they are asked for: attitude, position, …, wind."""
WIND, WIND_COV = 168, 231
Reports = dict[str, float]
_NAN = math.nan


def _attitude(f: dict[str, Any]) -> Reports:
    return {"roll_rad": f["roll"], "pitch_rad": f["pitch"], "yaw_rad": f["yaw"]}


def _position(f: dict[str, Any]) -> Reports:
    nowhere = f["lat"] == 0 and f["lon"] == 0
    reports = {"height_m": f["relative_alt"] * 1e-3}
    scaled = (("lat_deg", "lat", 1e-7), ("lon_deg", "lon", 1e-7), ("alt_msl_m", "alt", 1e-3))
    speeds = (("vel_north_mps", "vx", 1e-2), ("vel_east_mps", "vy", 1e-2), ("vel_down_mps", "vz", 1e-2))
    for ours, theirs, scale in scaled + speeds:
        reports[ours] = _NAN if nowhere else f[theirs] * scale
    return reports


def _hud(f: dict[str, Any]) -> Reports:
    airspeed = f["airspeed"]
    repeated = abs(airspeed - f["groundspeed"]) < 1e-3  # a bridge without a sensor
    unknown = airspeed == 0.0 or not math.isfinite(airspeed) or repeated
    return {"airspeed_mps": _NAN if unknown else airspeed, "throttle": f["throttle"] / 100.0}


def _wind(f: dict[str, Any]) -> Reports:
    speed, towards = f["speed"], math.radians(f["direction"] + 180.0)
    if speed == 0.0 or not math.isfinite(speed):
        return {"wind_north_mps": _NAN, "wind_east_mps": _NAN}
    return {"wind_north_mps": speed * math.cos(towards), "wind_east_mps": speed * math.sin(towards)}


def _wind_cov(f: dict[str, Any]) -> Reports:
    north, east = f["wind_x"], f["wind_y"]
    dead = (north == 0.0 and east == 0.0) or not (math.isfinite(north) and math.isfinite(east))
    return {"wind_north_mps": _NAN if dead else north, "wind_east_mps": _NAN if dead else east}


def _percent(value: int) -> float:
    return value / 100.0 if 0 <= value <= 100 else _NAN


def _status(f: dict[str, Any]) -> Reports:
    volts, amperes = f["voltage_battery"], f["current_battery"]
    return {
        "voltage_v": _NAN if volts in (0, 65535) else volts * 1e-3,
        "current_a": _NAN if amperes < 0 else amperes * 1e-2,
        "soc": _percent(f["battery_remaining"]),
    }


def _battery(f: dict[str, Any]) -> Reports:
    return {"soc": _percent(f["battery_remaining"])} if f["id"] == 0 else {}


def _heartbeat(f: dict[str, Any]) -> Reports:
    reports = {"armed": float(f["base_mode"] >> 7 & 1), "mode": float(f["custom_mode"])}
    return reports | {"fixed_wing": float(f["type"] == _PLANE)}


def _extended(f: dict[str, Any]) -> Reports:
    reports = {} if f["landed_state"] == 0 else {"landed": float(f["landed_state"] == 1)}
    return reports | ({"fixed_wing": float(f["vtol_state"] == _VTOL_PLANE)} if f["vtol_state"] else {})


_SPOKEN: dict[str, Callable[[dict[str, Any]], Reports]] = {
    "ATTITUDE": _attitude,
    "GLOBAL_POSITION_INT": _position,
    "VFR_HUD": _hud,
    "WIND": _wind,
    "WIND_COV": _wind_cov,
    "SYS_STATUS": _status,
    "BATTERY_STATUS": _battery,
    "HEARTBEAT": _heartbeat,
    "EXTENDED_SYS_STATE": _extended,
    "MISSION_CURRENT": lambda f: {"mission_item": float(f["seq"])},
    "SYSTEM_TIME": lambda _: {},
}


class LiveTelemetry:
    """The telemetry of one vehicle.

    Parameters
    ----------
    system : int
        Whose.

    Attributes
    ----------
    sample : TelemetrySample or None
        The newest.
    reached : list of int
        Items reached, in the autopilot's numbering, each once (PX4 says so ten times).
    doubts : dict
        What is doubtful about a quantity, in words, by its name.
    """

    def __init__(self, system: int) -> None:
        self.system = system
        self.clock = VehicleClock()
        self.sample: TelemetrySample | None = None
        self.reached: list[int] = []
        self.doubts: dict[str, str] = {}
        self._known: dict[str, tuple[float, float]] = {}
        self._tick_s = self._attitude_s = -math.inf
        self._changed_soc_s = -math.inf

    def hear(self, message: Message, posix_s: float) -> TelemetrySample | None:
        """Take a message; returns a sample where it completes one."""
        name = message.name
        if name == "MISSION_ITEM_REACHED":
            if not self.reached or self.reached[-1] != message["seq"]:
                self.reached.append(message["seq"])
            return None
        speak = _SPOKEN.get(name)
        if speak is None:
            return None
        reboots = self.clock.reboots
        time_s = self.clock.hear(message, posix_s)
        if self.clock.reboots != reboots:
            self._known.clear()
            self.reached.clear()
            self._tick_s = self._attitude_s = -math.inf
        reports = speak(message.fields)
        self._doubt(reports, time_s)
        for quantity, value in reports.items():
            self._known[quantity] = (value, time_s)
        if name == "ATTITUDE":
            self._attitude_s = time_s
        elif name != "GLOBAL_POSITION_INT" or time_s - self._attitude_s <= _TICK_GAP_S:
            return None
        return self._complete(time_s)

    def _complete(self, time_s: float) -> TelemetrySample | None:
        if time_s <= self._tick_s:
            return None
        self._tick_s = time_s
        fresh = {
            quantity: value
            for quantity, (value, at) in self._known.items()
            if time_s - at <= (SLOW_FRESH_S if quantity in _SLOW else FRESH_S)
        }
        if "voltage_v" in fresh and "current_a" in fresh:
            fresh["power_w"] = fresh["voltage_v"] * fresh["current_a"]
        self.sample = TelemetrySample(time_s=time_s, system=self.system, **fresh)
        return self.sample

    def latest(self, quantity: str) -> float:
        """Newest report of a quantity, however old; NaN before the first."""
        return self._known.get(quantity, (_NAN, 0.0))[0]

    def _doubt(self, reports: Reports, time_s: float) -> None:
        """Flag what jumps, and what stays where it cannot."""
        if "soc" in reports:
            self._doubt_soc(reports["soc"], time_s)
        if "lat_deg" in reports and "lat_deg" in self._known:
            lat, at = self._known["lat_deg"]
            north_m = abs(reports["lat_deg"] - lat) * 111_045.0
            east = abs(reports["lon_deg"] - self.latest("lon_deg")) * math.cos(math.radians(lat)) * 111_045.0
            if math.hypot(north_m, east) > _JUMP_MPS * max(time_s - at, 0.2):
                self.doubts["position"] = f"jumped by {math.hypot(north_m, east):.0f} m"

    def _doubt_soc(self, soc: float, time_s: float) -> None:
        before, _ = self._known.get("soc", (_NAN, 0.0))
        if math.isnan(soc):
            self.doubts["soc"] = "the vehicle does not know it"
        elif abs(soc - before) > _SOC_JUMP:
            self.doubts["soc"] = f"jumped from {100 * before:.0f} to {100 * soc:.0f} %"
        elif self.doubts.get("soc", "").startswith("the vehicle"):
            del self.doubts["soc"]
        power_w = self.latest("voltage_v") * self.latest("current_a")
        if soc != before or not power_w > _STUCK_W:
            self._changed_soc_s = time_s
        elif time_s - self._changed_soc_s > _STUCK_S:
            self.doubts["soc"] = f"stuck at {100 * soc:.0f} % while {power_w:.0f} W are drawn"
