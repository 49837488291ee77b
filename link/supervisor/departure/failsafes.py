"""What a vehicle does by itself, told from the settings it has: without us, without its pilot, and with little charge."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.missions.dialects import dialect
from skyway.missions.items.parameters import UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context
    from skyway.link.vehicle.vehicle import Vehicle

READ = {
    "px4": (
        "data-link-exceptions", "data-link-action", "data-link-timeout", "remote-control-exceptions", "remote-control-action",
        "low-battery-action", "low-battery", "critical-battery", "emergency-battery",
    ),
    "ardupilot": (
        "ground-station-failsafe", "ground-station-timeout", "failsafe-options", "remote-control-action", "low-battery-action",
        "low-battery", "low-battery-voltage", "critical-battery-action", "critical-battery", "critical-battery-voltage",
        "battery-capacity",
    ),
}  # fmt: skip
"""Settings that decide it (`missions.dialects.settings`), by autopilot."""
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
_ARDUPILOT_RC = {
    0: "goes on as it is", 1: "returns", 2: "goes on as it is", 3: "lands", 4: "returns", 5: "returns or lands",
    6: "lands by its landing sequence", 7: "stops, or lands",
}  # fmt: skip
_ARDUPILOT_BATTERY = {
    0: "only warns", 1: "lands", 2: "returns", 3: "returns", 4: "returns or lands", 5: "stops its motors",
    6: "lands by its landing sequence, or returns", 7: "stops, or lands",
}  # fmt: skip
_RC_CONTINUES_IN_AUTO, _CONTINUES_IN_AUTO = 1, 2


@dataclass(slots=True)
class Failsafes:
    """The settings of one vehicle that decide what it does by itself.

    Attributes
    ----------
    values : dict
        By key, in our units, as they will be in the flight; one that its firmware does not have is left out.
    """

    values: dict[str, float] = field(default_factory=dict)

    def read(self, vehicle: Vehicle, proposed: Mapping[str, float]) -> None:
        """Read them, those that are to be set (by key, in our units) as they will be."""
        found = vehicle.read_settings(READ[vehicle.family.name])
        self.values = {key: proposed.get(key, value) for key, value in found.items()}


def in_our_units(family: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return parameters, by name and in the autopilot's units, as settings by key and in ours; others are left out."""
    table = dialect(family).settings
    known = ((table.find(name), value) for name, value in values.items())
    return {found[0].key: value / UNITS[found[1].unit] for found, value in known if found is not None}


def when_left(family: str, values: Mapping[str, float]) -> str:
    """Say in one sentence what a vehicle in its mission does when our program ends, and with it its heartbeat."""
    if not values:
        return "what it does then is not known: its failsafe parameters could not be read"
    low = _px4_low(values) if family == "px4" else _ardupilot_stage("low", values)
    return f"{without_us(family, values)}; {low}"


def left_words(ctx: Context) -> str:
    """Say what the vehicle does when it is left to itself now."""
    if ctx.on_ground:
        return "it stands disarmed on the ground"
    if ctx.vehicle.mode != "mission":
        return f"it is in mode {ctx.vehicle.mode} and stays in it until its battery failsafe, or a pilot, ends it"
    return when_left(ctx.vehicle.family.name, ctx.failsafes.values)


def by_itself(family: str, values: Mapping[str, float]) -> list[str]:
    """Say what the vehicle does by itself in a mission, a line for each cause: what an operator reads before a take-off."""
    if not values:
        return ["what it does by itself is not known: its failsafe parameters could not be read"]
    stages = [_ardupilot_stage(stage, values) for stage in ("low", "critical")]
    return [
        f"link to us lost: {without_us(family, values)}",
        f"remote control lost: {_without_pilot(family, values)}",
        *(_px4_battery(values) if family == "px4" else stages),
    ]


def without_us(family: str, values: Mapping[str, float]) -> str:
    """Say what it does in its mission without our heartbeat."""
    px4 = family == "px4"
    action, exceptions = ("data-link-action", "data-link-exceptions") if px4 else (
        "ground-station-failsafe", "failsafe-options",
    )  # fmt: skip
    alone = finishes_alone(family, values)
    if alone is None:
        return "not known: the parameters that decide it were not told"
    if alone:
        excepted = int(values.get(exceptions, 0)) & (1 if px4 else _CONTINUES_IN_AUTO)
        why = _name(family, exceptions) if excepted else f"{_name(family, action)} 0"
        return f"it finishes its mission, lands and disarms there ({why})"
    wait = values.get("data-link-timeout" if px4 else "ground-station-timeout")
    after = "some time" if wait is None else f"{wait:.0f} s"
    return f"after {after} without us it {_action(family, action, _PX4_ACTIONS if px4 else _ARDUPILOT_GCS, values)}"


def _without_pilot(family: str, values: Mapping[str, float]) -> str:
    """Say what it does in its mission without its remote control."""
    px4 = family == "px4"
    exceptions, bit = ("remote-control-exceptions", 1) if px4 else ("failsafe-options", _RC_CONTINUES_IN_AUTO)
    if int(values.get(exceptions, 0)) & bit:
        return f"it goes on with its mission ({_name(family, exceptions)})"
    action = "remote-control-action"
    if action not in values or (exceptions not in values and values[action] != 0):
        return "not known: the parameters that decide it were not told"
    if values[action] == 0:
        return f"it goes on with its mission ({_name(family, action)} 0)"
    return f"it {_action(family, action, _PX4_ACTIONS if px4 else _ARDUPILOT_RC, values)}"


def _name(family: str, key: str) -> str:
    return dialect(family).settings[key].names[0].name


def _action(family: str, key: str, words: Mapping[int, str], values: Mapping[str, float]) -> str:
    """What a setting makes it do, with the name of its parameter."""
    name = _name(family, key)
    if key not in values:
        return f"does what {name} says, which was not told"
    value = int(values[key])
    return f"{words[value]} ({name})" if value in words else f"does what {name} {value} says"


def _percent(values: Mapping[str, float], key: str) -> str:
    return f"{100 * values[key]:.0f} %" if key in values else f"{_name('px4', key)}, not told"


def _px4_low(values: Mapping[str, float]) -> str:
    action = _action("px4", "low-battery-action", _PX4_BATTERY, values)
    return f"at critical battery ({_percent(values, 'critical-battery')}) it {action}"


def _px4_battery(values: Mapping[str, float]) -> list[str]:
    """Say what PX4 does at each threshold: one parameter decides for all three."""
    low, critical, emergency = (_percent(values, f"{stage}-battery") for stage in ("low", "critical", "emergency"))
    action = _action("px4", "low-battery-action", _PX4_BATTERY | {3: "returns", 5: "returns"}, values)
    returns = values.get("low-battery-action") in (3, 5)
    return [
        f"battery low ({low}): it only warns",
        f"battery critical ({critical}): it {action}",
        f"battery emergency ({emergency}): it {'lands (COM_LOW_BAT_ACT)' if returns else action}",
    ]


def _ardupilot_stage(stage: str, values: Mapping[str, float]) -> str:
    """Say what ArduPilot does at one of its two stages: by charge left, by voltage, or not at all."""
    charge, volts, capacity = (
        values.get(key) for key in (f"{stage}-battery", f"{stage}-battery-voltage", "battery-capacity")
    )
    at = []
    if charge:
        at.append(f"{100 * charge / capacity:.0f} %" if capacity else f"{charge:g} mAh left")
    if volts:
        at.append(f"{volts:g} V")
    if charge is None or volts is None:
        at.append("thresholds not all told")
    if not at:
        names = ", ".join(_name("ardupilot", key) for key in (f"{stage}-battery", f"{stage}-battery-voltage"))
        return f"battery {stage}: no threshold is set ({names}): it does nothing"
    action = _action("ardupilot", f"{stage}-battery-action", _ARDUPILOT_BATTERY, values)
    return f"battery {stage} ({' or '.join(at)}): it {action}"


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
