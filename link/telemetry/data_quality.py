"""Data quality of telemetry: impossible jumps, and values that are stuck."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.formatting import distance_text, duration, height_text, percent

if TYPE_CHECKING:
    from collections.abc import Mapping

JUMP_MPS, CLIMB_MPS = 150.0, 60.0
"""No vehicle of ours flies, or climbs, faster than this."""
SOC_JUMP = 0.08
STUCK_SOC_S, STUCK_SOC_W = 180.0, 100.0
"""A percentage that is constant for this long while this charge is drawn is not a measurement."""
STUCK_S = 5.0
"""The same for attitude and position in flight."""
KEPT_S = 60.0
"""How long a jump is reported."""
_MOVING_MPS = 1.0
_M_PER_DEG = 111_045.0
_MIN_STEP_S = 0.2
_MOTIONS = {"attitude": ("roll_rad", "pitch_rad", "yaw_rad"), "position": ("lat_deg", "lon_deg", "alt_msl_m")}


class DataQuality:
    """Data quality of one vehicle."""

    def __init__(self) -> None:
        self.words: dict[str, str] = {}
        """Doubts about a quantity, by its name."""
        self._known: dict[str, tuple[float, float]] = {}
        self._until_s: dict[str, float] = {}
        self._still: dict[str, tuple[tuple[float, ...], float]] = {}
        self._soc_changed_s = -math.inf

    def forget(self) -> None:
        """Start again, as after a restart of the vehicle."""
        for part in (self.words, self._known, self._until_s, self._still):
            part.clear()
        self._soc_changed_s = -math.inf

    def _latest(self, quantity: str) -> float:
        return self._known.get(quantity, (math.nan, 0.0))[0]

    def hear(self, reports: Mapping[str, float], time_s: float) -> None:
        """Check one message."""
        if self._until_s:
            for name in [name for name, until in self._until_s.items() if time_s > until]:
                del self._until_s[name]
                self.words.pop(name, None)
        if "soc" in reports:
            self._charge(reports["soc"], time_s)
        if "lat_deg" in reports:
            self._place(reports, time_s)
        for name, quantities in _MOTIONS.items():
            if quantities[0] in reports:
                self._motion(name, tuple(reports[quantity] for quantity in quantities), time_s)
        for quantity, value in reports.items():
            self._known[quantity] = (value, time_s)

    def _jumped(self, name: str, words: str, time_s: float) -> None:
        self.words[name] = f"jumped {words}"
        self._until_s[name] = time_s + KEPT_S

    def _place(self, reports: Mapping[str, float], time_s: float) -> None:
        if "lat_deg" not in self._known:
            return
        before, at = self._known["lat_deg"]
        step_s = max(time_s - at, _MIN_STEP_S)
        north = (reports["lat_deg"] - before) * _M_PER_DEG
        turn = (reports["lon_deg"] - self._latest("lon_deg") + 180.0) % 360.0 - 180.0
        moved = math.hypot(north, turn * math.cos(math.radians(before)) * _M_PER_DEG)
        if moved > JUMP_MPS * step_s:
            self._jumped("position", f"by {distance_text(moved)}", time_s)
        climbed = abs(reports["alt_msl_m"] - self._latest("alt_msl_m"))
        if climbed > CLIMB_MPS * step_s:
            self._jumped("height", f"by {height_text(climbed)}", time_s)

    def _motion(self, name: str, values: tuple[float, ...], time_s: float) -> None:
        """In the air no value is constant to the last digit; a position may be, as long as the vehicle does not move."""
        before, since = self._still.get(name, ((), time_s))
        if values != before:
            self._still[name] = (values, time_s)
            if name not in self._until_s:
                self.words.pop(name, None)
            return
        in_air = self._latest("landed") == 0.0 and self._latest("armed") == 1.0
        speed = math.hypot(self._latest("vel_north_mps"), self._latest("vel_east_mps"))
        if in_air and time_s - since > STUCK_S and (name == "attitude" or speed > _MOVING_MPS):
            self._until_s.pop(name, None)
            self.words[name] = f"has not moved for {duration(time_s - since)} in flight"

    def _charge(self, soc: float, time_s: float) -> None:
        before = self._latest("soc")
        if math.isnan(soc):
            self.words["soc"] = "unknown to the drone, check its battery monitor"
            self._until_s.pop("soc", None)
            return
        power_w = self._latest("voltage_v") * self._latest("current_a")
        if abs(soc - before) > SOC_JUMP:
            self._jumped("soc", f"from {percent(before)} to {percent(soc)}", time_s)
        elif soc != before and "soc" not in self._until_s:
            self.words.pop("soc", None)
        if soc != before or not power_w > STUCK_SOC_W:
            self._soc_changed_s = time_s
        elif time_s - self._soc_changed_s > STUCK_SOC_S:
            self.words["soc"] = f"stuck at {percent(soc)} while {power_w:.0f} W are drawn"
            self._until_s.pop("soc", None)
