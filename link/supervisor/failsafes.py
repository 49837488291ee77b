"""What a vehicle does by itself when nobody speaks with it any more, told from the parameters it has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.errors import LinkError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from link.vehicle import Vehicle

READ = {
    "px4": ("COM_DLL_EXCEPT", "NAV_DLL_ACT", "COM_DL_LOSS_T", "COM_LOW_BAT_ACT", "BAT_CRIT_THR", "BAT_EMERGEN_THR"),
    "ardupilot": (
        "FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_OPTIONS", "BATT_FS_LOW_ACT", "BATT_LOW_MAH", "BATT_FS_CRT_ACT",
        "BATT_CRT_MAH", "BATT_CAPACITY",
    ),
}  # fmt: skip
"""Parameters that decide it, by autopilot."""
_PX4_ACTIONS = {
    0: "goes on as it is",
    1: "holds",
    2: "returns",
    3: "lands",
    5: "stops its motors",
    6: "stops its motors",
}
_PX4_BATTERY = {0: "only warns", 2: "lands", 3: "returns, and lands when it gets worse"}
_ARDUPILOT_GCS = {
    0: "goes on as it is", 1: "returns", 3: "returns", 4: "returns or lands", 5: "lands", 6: "lands by its landing sequence",
    7: "stops",
}  # fmt: skip
_ARDUPILOT_BATTERY = {0: "only warns", 1: "lands", 2: "returns", 3: "returns", 4: "returns", 5: "stops its motors"}
_CONTINUES_IN_AUTO, _CONTINUES_LANDING = 2, 8


def read_failsafes(vehicle: Vehicle) -> dict[str, float]:
    """Read the parameters that decide it; one that is not told is left out."""
    found = {}
    for name in READ[vehicle.family.name]:
        try:
            found[name] = vehicle.parameter(name).value
        except LinkError:
            continue
    return found


def when_left(family: str, values: Mapping[str, float]) -> str:
    """Say in one sentence what a vehicle in its mission does when our program ends, and with it its heartbeat."""
    if not values:
        return "what it does then is not known: its failsafe parameters could not be read"
    return _px4(values) if family == "px4" else _ardupilot(values)


def _px4(values: Mapping[str, float]) -> str:
    excepted = int(values.get("COM_DLL_EXCEPT", 0)) & 1
    action = _PX4_ACTIONS.get(int(values.get("NAV_DLL_ACT", 0)), "does what NAV_DLL_ACT says")
    battery = _PX4_BATTERY.get(int(values.get("COM_LOW_BAT_ACT", 0)), "does what COM_LOW_BAT_ACT says")
    low = f"at critical battery ({100 * values.get('BAT_CRIT_THR', 0):.0f} %) it {battery}"
    if excepted:
        return f"it finishes its mission, lands and disarms there (COM_DLL_EXCEPT); {low}"
    after = f"{values.get('COM_DL_LOSS_T', 10):.0f} s without us"
    return f"after {after} it {action} (NAV_DLL_ACT); {low}"


def _ardupilot(values: Mapping[str, float]) -> str:
    options = int(values.get("FS_OPTIONS", 0))
    enabled = int(values.get("FS_GCS_ENABLE", 0))
    battery = _ARDUPILOT_BATTERY.get(int(values.get("BATT_FS_LOW_ACT", 0)), "does what BATT_FS_LOW_ACT says")
    share = values.get("BATT_LOW_MAH", 0.0) / max(values.get("BATT_CAPACITY", 1.0), 1.0)
    low = f"at low battery ({100 * share:.0f} %) it {battery}" if share > 0.0 else "it has no threshold of low battery"
    if enabled == 0 or options & _CONTINUES_IN_AUTO:
        why = "FS_GCS_ENABLE 0" if enabled == 0 else "FS_OPTIONS"
        return f"it finishes its mission, lands and disarms there ({why}); {low}"
    action = _ARDUPILOT_GCS.get(enabled, "does what FS_GCS_ENABLE says")
    return f"after {values.get('FS_GCS_TIMEOUT', 5):.0f} s without us it {action} (FS_GCS_ENABLE); {low}"


def finishes_alone(family: str, values: Mapping[str, float]) -> bool | None:
    """Tell whether it finishes its leg and lands without us; None where that cannot be told."""
    if family == "px4":
        return bool(int(values["COM_DLL_EXCEPT"]) & 1) if "COM_DLL_EXCEPT" in values else None
    if "FS_GCS_ENABLE" in values and int(values["FS_GCS_ENABLE"]) == 0:
        return True
    return bool(int(values["FS_OPTIONS"]) & _CONTINUES_IN_AUTO) if "FS_OPTIONS" in values else None
