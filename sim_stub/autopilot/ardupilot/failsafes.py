"""ArduPilot's failsafes by its parameters: battery, links, position, fence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.base import Autopilot
from skyway.sim_stub.autopilot.modes import MANUAL_MODES, Action, Mode
from skyway.sim_stub.plant.physics import offset_m

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

_BATTERY_ACTIONS = {1: Action.LAND, 2: Action.RTL, 3: Action.RTL, 4: Action.LAND, 5: Action.TERMINATE}
_GCS_ACTIONS = {1: Action.RTL, 3: Action.RTL, 4: Action.LAND, 5: Action.LAND, 6: Action.RTL, 7: Action.LAND}
_FENCE_ACTIONS = {0: Action.WARN, 1: Action.RTL, 2: Action.LAND, 3: Action.RTL, 4: Action.LAND, 5: Action.LAND}


class ArduPilotFailsafes(Autopilot):
    """ArduPilot's failsafes."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.low_volt_since: dict[int, float] = {}

    def reported_percent(self) -> int:
        """Rest of BATT_CAPACITY after the use since boot or BATTERY_RESET: it only falls."""
        override = self.vehicle.faults.soc_override(self.vehicle.battery.soc)
        if override is not None:
            return override
        return max(0, min(100, math.floor(100.0 * self.remaining_share())))

    def remaining_share(self) -> float:
        """Share of BATT_CAPACITY that is left by counting."""
        capacity = self.parameters.clamped("BATT_CAPACITY", 1.0, 1e6)
        return 1.0 - self.vehicle.counted_mah / capacity

    def battery_level(self) -> int:
        """BATT_LOW_*, BATT_CRT_*: by charge at once, by voltage after BATT_LOW_TIMER."""
        p = self.parameters
        left_mah = self.remaining_share() * p.clamped("BATT_CAPACITY", 1.0, 1e6)
        level = 0
        for number, name in ((1, "LOW"), (2, "CRT")):
            by_charge = left_mah < max(p[f"BATT_{name}_MAH"], 0.0)
            volts = p[f"BATT_{name}_VOLT"]
            if self.vehicle.battery.voltage_v < max(volts, 0.0):
                since = self.low_volt_since.setdefault(number, self.sim_s)
                by_voltage = self.sim_s - since >= p.clamped("BATT_LOW_TIMER", 0.0, 120.0)
            else:
                self.low_volt_since.pop(number, None)
                by_voltage = False
            if by_charge or by_voltage:
                level = number
        return level

    def battery_action(self, level: int) -> Action:
        """BATT_FS_LOW_ACT, BATT_FS_CRT_ACT."""
        name = "BATT_FS_LOW_ACT" if level == 1 else "BATT_FS_CRT_ACT"
        return self._unless_landing(_BATTERY_ACTIONS.get(int(self.parameters[name]), Action.WARN))

    def battery_warning(self, level: int) -> None:
        """Report it."""
        kind = "low" if level == 1 else "critical"
        used = self.vehicle.counted_mah
        self.say(4, f"Battery 1 is {kind} {self.vehicle.battery.voltage_v:.2f}V used {used:.0f} mAh")

    def ground_heard_s(self) -> float | None:
        """Only the ground station with the id of SYSID_MYGCS counts."""
        return self.vehicle.ground_heard.get(int(self.parameters["SYSID_MYGCS"]))

    def link_action(self) -> Action:
        """FS_GCS_ENABLE, with the exceptions of FS_OPTIONS."""
        options = self.parameters
        excepted = (self.mode == Mode.MISSION and options.bit("FS_OPTIONS", 1)) or (
            self.mode in MANUAL_MODES and options.bit("FS_OPTIONS", 4)
        )
        if excepted:
            return Action.NONE
        return self._unless_landing(_GCS_ACTIONS.get(int(self.parameters["FS_GCS_ENABLE"]), Action.NONE))

    def _unless_landing(self, action: Action) -> Action:
        landing = self.mode == Mode.LAND or self.landed_state == 4
        return Action.NONE if landing and self.parameters.bit("FS_OPTIONS", 3) else action

    def link_warning(self, *, lost: bool) -> None:
        """Report it."""
        if self.parameters["FS_GCS_ENABLE"] != 0.0:
            self.say(4, "GCS Failsafe" if lost else "GCS Failsafe Cleared")

    def remote_control_action(self) -> Action:
        """FS_THR_ENABLE, with the exceptions of FS_OPTIONS."""
        enabled = int(self.parameters["FS_THR_ENABLE"])
        excepted = (self.mode == Mode.MISSION and self.parameters.bit("FS_OPTIONS", 0)) or (
            self.mode == Mode.GUIDED and self.parameters.bit("FS_OPTIONS", 2)
        )
        if enabled == 0 or excepted:
            return Action.NONE
        return self._unless_landing(Action.LAND if enabled in (3, 5) else Action.RTL)

    def fenced_off(self, lat: float, lon: float, alt_m: float) -> bool:
        """By FENCE_ENABLE and FENCE_TYPE: height 1, circle about home 2, areas 4, minimum height 8."""
        p = self.parameters
        if p["FENCE_ENABLE"] != 1.0:
            return False
        kinds = int(p["FENCE_TYPE"])
        height = alt_m - self.home_alt_m
        if kinds & 1 and height > p["FENCE_ALT_MAX"]:
            return True
        if kinds & 8 and not self.landed and height < p["FENCE_ALT_MIN"]:
            return True
        if kinds & 2 and self.home is not None:
            away = math.hypot(*offset_m(self.home.lat, self.home.lon, lat, lon))
            if away > p["FENCE_RADIUS"]:
                return True
        union = self.parameters.bit("FENCE_OPTIONS", 1)
        return bool(kinds & 4) and self.fence.breached(lat, lon, any_inclusion=union)

    def fence_action(self) -> Action:
        """FENCE_ACTION."""
        return _FENCE_ACTIONS.get(int(self.parameters["FENCE_ACTION"]), Action.WARN)

    def failsafe_on_ground(self, name: str) -> None:
        """Disarm."""
        self.disarm(force=True, by=f"{name} failsafe on the ground")
