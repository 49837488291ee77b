"""PX4's failsafes by its parameters: battery, links, position, fence."""

from __future__ import annotations

import math

from skyway.sim_stub.autopilot.base import Autopilot
from skyway.sim_stub.autopilot.modes import Action, Mode
from skyway.sim_stub.plant.physics import offset_m

_ACTIONS = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.TERMINATE}
_FENCE_ACTIONS = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
_BATTERY_UNKNOWN_S = 2.0


class Px4Failsafes(Autopilot):
    """PX4's failsafes."""

    def reported_percent(self) -> int:
        """PX4 estimates from voltage and current; unknown in the first seconds."""
        override = self.vehicle.faults.soc_override(self.vehicle.battery.soc)
        if override is not None:
            return override
        if self.vehicle.since_boot_s < _BATTERY_UNKNOWN_S:
            return -1
        return max(0, min(100, math.floor(self.vehicle.battery.soc * 100.0 + 0.5)))

    def battery_level(self) -> int:
        """BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""
        percent = self.reported_percent()
        if percent < 0:
            return 0
        soc = self.vehicle.battery.soc if abs(percent - self.vehicle.battery.soc * 100.0) < 1.0 else percent / 100.0
        names = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")
        return sum(soc < self.parameters[name] for name in names)

    def battery_action(self, level: int) -> Action:
        """COM_LOW_BAT_ACT."""
        action = int(self.parameters["COM_LOW_BAT_ACT"])
        if level < 2 or action == 0:
            return Action.WARN
        if action == 2:
            return Action.LAND
        return Action.RTL if level == 2 else Action.LAND

    def battery_warning(self, level: int) -> None:
        """Report it."""
        self.say(4 if level == 1 else 2, ("Low battery", "Critical battery", "Emergency battery")[level - 1])

    def ground_heard_s(self) -> float | None:
        """Any ground station counts."""
        return max(self.vehicle.ground_heard.values(), default=None)

    def link_action(self) -> Action:
        """NAV_DLL_ACT, unless COM_DLL_EXCEPT excepts the present mode."""
        if self._excepted("COM_DLL_EXCEPT"):
            return Action.NONE
        return _ACTIONS.get(int(self.parameters["NAV_DLL_ACT"]), Action.NONE)

    def _excepted(self, name: str) -> bool:
        bits = {Mode.MISSION: 0, Mode.HOLD: 1, Mode.TAKEOFF: 1, Mode.RTL: 1, Mode.LAND: 1, Mode.OFFBOARD: 2}
        bit = bits.get(self.mode)
        return bit is not None and self.parameters.bit(name, bit)

    def link_warning(self, *, lost: bool) -> None:
        """Report it."""
        self.say(6, "Connection to ground control station lost" if lost else "Ground station link regained")

    def remote_control_action(self) -> Action:
        """NAV_RCL_ACT, unless COM_RCL_EXCEPT excepts the present mode or no remote control is wanted."""
        if int(self.parameters["COM_RC_IN_MODE"]) == 4 or self._excepted("COM_RCL_EXCEPT"):
            return Action.NONE
        return _ACTIONS.get(int(self.parameters["NAV_RCL_ACT"]), Action.NONE)

    def position_delay_s(self) -> float:
        """COM_POS_FS_DELAY; from 1.16 on always a second."""
        return self.parameters.clamped("COM_POS_FS_DELAY", 0.0, 60.0) if "COM_POS_FS_DELAY" in self.parameters else 1.0

    def fenced_off(self, lat: float, lon: float, alt_m: float) -> bool:
        """Areas, and the cylinder of GF_MAX_HOR_DIST and GF_MAX_VER_DIST about home."""
        home = self.home
        if home is not None:
            far, high = self.parameters["GF_MAX_HOR_DIST"], self.parameters["GF_MAX_VER_DIST"]
            if far > 0.0 and math.hypot(*offset_m(home.lat, home.lon, lat, lon)) > far:
                return True
            if high > 0.0 and alt_m - home.alt_m > high:
                return True
        return self.fence.breached(lat, lon, any_inclusion=True)

    def fence_action(self) -> Action:
        """GF_ACTION."""
        return _FENCE_ACTIONS.get(int(self.parameters["GF_ACTION"]), Action.NONE)
