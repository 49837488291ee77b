"""Plausibility of telemetry: values and jumps beyond physics are rejected.

Withheld values are unknown, not wrong: nothing is decided by them, and the flight continues. A place is compared with the one extrapolated by
velocity from the last accepted one; a different place that persists is accepted after `PLACE_AGAIN_S`, longer than any burst of bad packets
lasts. A time since boot that jumps is accepted if no other is received any more, as after a restart.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median

FASTEST_MPS, MIN_ALT_M, MAX_ALT_M = 60.0, -500.0, 12_000.0
PLACE_OFF_M, PLACE_OFF_SHARE, CLIMB_OFF_M = 40.0, 0.3, 20.0
"""Tolerance of a place about its expected position, and as a share of the distance flown since; likewise of a height."""
PLACE_AGAIN_S, SPEED_AGAIN_S, POWER_AGAIN_S = 60.0, 30.0, 120.0
STEP_MPS, ACCELERATION_MPS2 = 5.0, 15.0
SHARE_OF_VOLTS, TIMES_AMPERES, MIN_AMPERES = 0.35, 4.0, 20.0
STRANGE_BOOTS, STRANGE_OFFSETS = 8, 120
"""Number of consecutive messages, none of which fits the known time since boot; the same for the vehicle's UTC, once a second."""
_SPEEDUP, _LATE_S, _BACK_S, _ALIKE_S = 20.0, 3.0, 1.0, 30.0
_OFFSET_S = 2.0
_M_PER_DEG = 111_045.0
_PLACE = ("lat_deg", "lon_deg", "alt_msl_m", "height_m")
_SPEED = ("vel_north_mps", "vel_east_mps", "vel_down_mps")
_ANGLES = ("roll_rad", "pitch_rad", "yaw_rad")
_WIND = ("wind_north_mps", "wind_east_mps")
_KEPT = 30


class Plausible:
    """Checks the reports of one vehicle, and withholds impossible values."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start again, as after a restart of the vehicle."""
        self._place: tuple[float, ...] = ()
        self._place_s = self._speed_s = math.nan
        self._speed: tuple[float, ...] = ()
        self._off_s: dict[str, float] = {}
        self._kept: dict[str, deque[float]] = {}
        self._highest_v = 0.0
        self._flies = False

    def hear(self, reports: dict[str, float], time_s: float) -> dict[str, float]:
        """Return the reports of one message, NaN for withheld values."""
        if "landed" in reports:
            self._flies = reports["landed"] == 0.0
        for names, most in ((_ANGLES, 2.0 * math.pi), (_WIND, FASTEST_MPS)):
            if names[0] in reports and not all(abs(reports[name]) <= most for name in names):
                reports |= dict.fromkeys(names, math.nan)
        if "vel_north_mps" in reports:
            self._moved(reports, time_s)
        for name in ("voltage_v", "current_a"):
            if name in reports:
                reports[name] = self._electric(name, reports[name], time_s)
        return reports

    def _again(self, name: str, time_s: float, after_s: float) -> bool:
        """Whether a deviation has lasted for so long that it is accepted after all."""
        return time_s - self._off_s.setdefault(name, time_s) >= after_s

    def _moved(self, reports: dict[str, float], time_s: float) -> None:
        speed = tuple(reports[name] for name in _SPEED)
        passed_s = max(time_s - self._speed_s, 0.0)
        known = all(abs(part) <= FASTEST_MPS for part in speed)
        if known and self._speed and math.dist(speed, self._speed) > STEP_MPS + ACCELERATION_MPS2 * passed_s:
            known = self._again("speed", time_s, SPEED_AGAIN_S)
        if known:
            self._off_s.pop("speed", None)
            self._speed, self._speed_s = speed, time_s
        else:
            reports |= dict.fromkeys(_SPEED, math.nan)
        if not self._placed(reports, time_s):
            reports |= dict.fromkeys(_PLACE, math.nan)

    def _placed(self, reports: dict[str, float], time_s: float) -> bool:
        place = tuple(reports[name] for name in _PLACE)
        lat, lon, alt, height = place
        heights = all(MIN_ALT_M <= value <= MAX_ALT_M for value in (alt, height))
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and heights):
            return False
        if self._place and self._strayed(place, time_s) and not self._again("place", time_s, PLACE_AGAIN_S):
            return False
        self._off_s.pop("place", None)
        self._place, self._place_s = place, time_s
        return True

    def _strayed(self, place: tuple[float, ...], time_s: float) -> bool:
        """Whether the vehicle cannot have reached a place."""
        passed_s = max(time_s - self._place_s, 0.0)
        north, east, down = self._speed or (0.0, 0.0, 0.0)
        slope = math.cos(math.radians(self._place[0]))
        turn = (place[1] - self._place[1] + 180.0) % 360.0 - 180.0
        off_north = (place[0] - self._place[0]) * _M_PER_DEG - north * passed_s
        off_east = turn * slope * _M_PER_DEG - east * passed_s
        way = PLACE_OFF_SHARE * passed_s * max(math.hypot(north, east), 1.0)
        if math.hypot(off_north, off_east) > PLACE_OFF_M + way:
            return True
        if not self._flies:
            return False  # if home moves, heights start again
        climbed = max(abs(place[k] - self._place[k] + down * passed_s) for k in (2, 3))
        return climbed > CLIMB_OFF_M + PLACE_OFF_SHARE * passed_s * max(abs(down), 1.0)

    def _electric(self, name: str, value: float, time_s: float) -> float:
        kept = self._kept.setdefault(name, deque(maxlen=_KEPT))
        if len(kept) >= _KEPT // 3:
            usual = median(kept)
            if name == "voltage_v":  # a return to the level before a fall is not a rise
                self._highest_v = max(self._highest_v, usual)
                strange = value < (1.0 - SHARE_OF_VOLTS) * usual or value > (1.0 + SHARE_OF_VOLTS) * self._highest_v
            else:
                strange = value > max(TIMES_AMPERES * max(kept), MIN_AMPERES) and not self._begins(value)
            if strange:
                if not self._again(name, time_s, POWER_AGAIN_S):
                    return math.nan
                kept.clear()  # a lasting value becomes the usual one
        if math.isfinite(value):
            self._off_s.pop(name, None)
            kept.append(value)
        return value

    def _begins(self, amperes: float) -> bool:
        """Whether a current is plausible for motors that have just started."""
        return amperes < 10.0 * MIN_AMPERES and max(self._kept["current_a"]) < MIN_AMPERES


class BootTimes:
    """Accepted times since boot, and accepted UTC."""

    def __init__(self) -> None:
        self._newest: tuple[float, float] | None = None
        self._strange: list[float] = []
        self._offset_s = math.nan
        self._offsets = 0

    def believed(self, boot_ms: float | None, posix_s: float) -> bool:
        """Whether a message with this time since boot is accepted; one without a time is."""
        if boot_ms is None:
            return True
        boot_s = boot_ms * 1e-3
        if self._fits(boot_s, posix_s):
            self._strange.clear()
        else:
            if self._strange and abs(boot_s - self._strange[-1]) > _ALIKE_S:
                self._strange.clear()
            self._strange.append(boot_s)
            if len(self._strange) < STRANGE_BOOTS:
                return False
            self._strange.clear()
            self._offset_s = math.nan
            self._newest = None
        if self._newest is None or boot_s > self._newest[0]:
            self._newest = (boot_s, posix_s)
        return True

    def _fits(self, boot_s: float, posix_s: float) -> bool:
        newest_s, heard_s = self._newest or (boot_s, posix_s)
        return newest_s - _BACK_S <= boot_s <= newest_s + _LATE_S + _SPEEDUP * max(posix_s - heard_s, 0.0)

    def utc_believed(self, utc_s: float, boot_s: float) -> bool:
        """Whether a UTC of the vehicle is accepted: after the first, a different one only once it has been reported for long."""
        offset_s = utc_s - boot_s
        if math.isnan(self._offset_s) or abs(offset_s - self._offset_s) <= _OFFSET_S:
            self._offset_s, self._offsets = offset_s, 0
            return True
        self._offsets += 1
        if self._offsets < STRANGE_OFFSETS:
            return False
        self._offset_s, self._offsets = offset_s, 0
        return True
