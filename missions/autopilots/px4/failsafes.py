"""PX4's failsafes: lost links, and three battery thresholds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.missions.autopilots.failsafes import Failsafes, LinkLoss
from skyway.missions.autopilots.px4.settings import SETTINGS
from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from collections.abc import Mapping

_KEYS = (
    "data-link-exceptions", "data-link-action", "data-link-timeout", "remote-control-exceptions", "remote-control-action",
    "low-battery-action", "low-battery", "critical-battery", "emergency-battery",
)  # fmt: skip
_ACTIONS = {
    0: "continues",
    1: "holds",
    2: "returns",
    3: "lands",
    5: "stops its motors",
    6: "stops its motors",
}
_BATTERY = {
    0: "only warns",
    2: "lands",
    3: "returns (from 1.18 on as soon as it only just suffices for that), and lands when it gets worse",
    5: "returns, and lands when it gets worse",
}


class Px4Failsafes(Failsafes):
    """PX4's failsafes."""

    def battery(self, values: Mapping[str, float]) -> list[str]:
        """Return its action at each threshold."""
        low, critical, emergency = (
            self._percent(values, f"{stage}-battery") for stage in ("low", "critical", "emergency")
        )
        action = self.action("low-battery-action", _BATTERY | {3: "returns", 5: "returns"}, values)
        returns = values.get("low-battery-action") in (3, 5)
        return [
            f"battery low ({low}): it only warns",
            f"battery critical ({critical}): it {action}",
            f"battery emergency ({emergency}): it {'lands (COM_LOW_BAT_ACT)' if returns else action}",
        ]

    def battery_first(self, values: Mapping[str, float]) -> str:
        """Return its action at critical battery: at low battery it only warns."""
        action = self.action("low-battery-action", _BATTERY, values)
        return f"at critical battery ({self._percent(values, 'critical-battery')}) it {action}"

    def _percent(self, values: Mapping[str, float], key: str) -> str:
        return percent(values[key]) if key in values else f"{self.name(key)}, not read"


FAILSAFES = Px4Failsafes(
    SETTINGS,
    _KEYS,
    LinkLoss("data-link-action", "data-link-exceptions", 1, _ACTIONS, "data-link-timeout"),
    LinkLoss("remote-control-action", "remote-control-exceptions", 1, _ACTIONS),
)
