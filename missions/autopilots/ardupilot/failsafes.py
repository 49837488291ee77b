"""ArduPilot's failsafes: lost links, and two battery stages, by charge or by voltage."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.missions.autopilots.ardupilot.settings import SETTINGS
from skyway.missions.autopilots.failsafes import Failsafes, LinkLoss
from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from collections.abc import Mapping

_KEYS = (
    "ground-station-failsafe", "ground-station-timeout", "failsafe-options", "remote-control-action", "low-battery-action",
    "low-battery", "low-battery-voltage", "critical-battery-action", "critical-battery", "critical-battery-voltage",
    "battery-capacity",
)  # fmt: skip
_STATION = {
    0: "continues", 1: "returns", 3: "returns", 4: "returns or lands", 5: "lands", 6: "lands by its landing sequence",
    7: "stops",
}  # fmt: skip
_PILOT = {
    0: "continues", 1: "returns", 2: "continues", 3: "lands", 4: "returns", 5: "returns or lands",
    6: "lands by its landing sequence", 7: "stops, or lands",
}  # fmt: skip
_BATTERY = {
    0: "only warns", 1: "lands", 2: "returns", 3: "returns", 4: "returns or lands", 5: "stops its motors",
    6: "lands by its landing sequence, or returns", 7: "stops, or lands",
}  # fmt: skip
_PILOT_LOST_IN_AUTO, _STATION_LOST_IN_AUTO = 1, 2
"""Bits of FS_OPTIONS."""


class ArduPilotFailsafes(Failsafes):
    """ArduPilot's failsafes."""

    def battery(self, values: Mapping[str, float]) -> list[str]:
        """Return the action at each stage."""
        return [self._stage(stage, values) for stage in ("low", "critical")]

    def battery_first(self, values: Mapping[str, float]) -> str:
        """Return the action at the first stage."""
        return self._stage("low", values)

    def _stage(self, stage: str, values: Mapping[str, float]) -> str:
        """Return the action at one stage: by charge left, by voltage, or none."""
        charge, volts, capacity = (
            values.get(key) for key in (f"{stage}-battery", f"{stage}-battery-voltage", "battery-capacity")
        )
        at = []
        if charge:
            at.append(percent(charge / capacity) if capacity else f"{charge:g} mAh left")
        if volts:
            at.append(f"{volts:g} V")
        if charge is None or volts is None:
            at.append("not all thresholds could be read")
        if not at:
            names = ", ".join(self.name(key) for key in (f"{stage}-battery", f"{stage}-battery-voltage"))
            return f"battery {stage}: no threshold is set ({names}): it does nothing"
        action = self.action(f"{stage}-battery-action", _BATTERY, values)
        return f"battery {stage} ({' or '.join(at)}): it {action}"


FAILSAFES = ArduPilotFailsafes(
    SETTINGS,
    _KEYS,
    LinkLoss("ground-station-failsafe", "failsafe-options", _STATION_LOST_IN_AUTO, _STATION, "ground-station-timeout"),
    LinkLoss("remote-control-action", "failsafe-options", _PILOT_LOST_IN_AUTO, _PILOT),
)
