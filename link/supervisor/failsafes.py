"""What a vehicle does by itself when nobody speaks with it any more, told from the parameters it has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from link.vehicle import Vehicle

READ = {
    "px4": (
        "data-link-exceptions", "data-link-action", "data-link-timeout", "low-battery-action", "critical-battery",
        "emergency-battery",
    ),
    "ardupilot": (
        "ground-station-failsafe", "ground-station-timeout", "failsafe-options", "low-battery-action", "low-battery",
        "critical-battery-action", "critical-battery", "battery-capacity",
    ),
}  # fmt: skip
"""Settings that decide it (`missions.settings`), by autopilot."""
_PX4_ACTIONS = {
    0: "goes on as it is",
    1: "holds",
    2: "returns",
    3: "lands",
    5: "stops its motors",
    6: "stops its motors",
}
_PX4_BATTERY = {
    0: "only warns",
    2: "lands",
    3: "returns (from 1.18 on as soon as it only just suffices for that), and lands when it gets worse",
    5: "returns, and lands when it gets worse",
}
_ARDUPILOT_GCS = {
    0: "goes on as it is", 1: "returns", 3: "returns", 4: "returns or lands", 5: "lands", 6: "lands by its landing sequence",
    7: "stops",
}  # fmt: skip
_ARDUPILOT_BATTERY = {0: "only warns", 1: "lands", 2: "returns", 3: "returns", 4: "returns", 5: "stops its motors"}
_CONTINUES_IN_AUTO, _CONTINUES_LANDING = 2, 8


def read_failsafes(vehicle: Vehicle) -> dict[str, float]:
    """Read the settings that decide it; one that its firmware does not have is left out."""
    return vehicle.read_settings(READ[vehicle.family.name])


def when_left(family: str, values: Mapping[str, float]) -> str:
    """Say in one sentence what a vehicle in its mission does when our program ends, and with it its heartbeat."""
    if not values:
        return "what it does then is not known: its failsafe parameters could not be read"
    return _px4(values) if family == "px4" else _ardupilot(values)


def _px4(values: Mapping[str, float]) -> str:
    action = int(values.get("data-link-action", -1))
    battery = _PX4_BATTERY.get(int(values.get("low-battery-action", 0)), "does what COM_LOW_BAT_ACT says")
    low = f"at critical battery ({100 * values.get('critical-battery', 0):.0f} %) it {battery}"
    if finishes_alone("px4", values):
        why = "COM_DLL_EXCEPT" if int(values.get("data-link-exceptions", 0)) & 1 else "NAV_DLL_ACT 0"
        return f"it finishes its mission, lands and disarms there ({why}); {low}"
    after = f"{values.get('data-link-timeout', 10):.0f} s without us"
    return f"after {after} it {_PX4_ACTIONS.get(action, 'does what NAV_DLL_ACT says')} (NAV_DLL_ACT); {low}"


def _ardupilot(values: Mapping[str, float]) -> str:
    enabled = int(values.get("ground-station-failsafe", 0))
    battery = _ARDUPILOT_BATTERY.get(int(values.get("low-battery-action", 0)), "does what BATT_FS_LOW_ACT says")
    share = values.get("low-battery", 0.0) / max(values.get("battery-capacity", 1.0), 1.0)
    low = f"at low battery ({100 * share:.0f} %) it {battery}" if share > 0.0 else "it has no threshold of low battery"
    if enabled == 0 or int(values.get("failsafe-options", 0)) & _CONTINUES_IN_AUTO:
        why = "FS_GCS_ENABLE 0" if enabled == 0 else "FS_OPTIONS"
        return f"it finishes its mission, lands and disarms there ({why}); {low}"
    action = _ARDUPILOT_GCS.get(enabled, "does what FS_GCS_ENABLE says")
    return f"after {values.get('ground-station-timeout', 5):.0f} s without us it {action} (FS_GCS_ENABLE); {low}"


def finishes_alone(family: str, values: Mapping[str, float]) -> bool | None:
    """Tell whether it finishes its leg and lands without us; None where that cannot be told."""
    if family == "px4":
        return _continues(values, "data-link-action", "data-link-exceptions", 1)
    return _continues(values, "ground-station-failsafe", "failsafe-options", _CONTINUES_IN_AUTO)


def _continues(values: Mapping[str, float], action: str, exceptions: str, mission: int) -> bool | None:
    """It goes on where it does nothing, or nothing in a mission; without an exception, only the former is known to."""
    if int(values.get(action, -1)) == 0 or int(values.get(exceptions, 0)) & mission:
        return True
    return False if action in values or exceptions in values else None
