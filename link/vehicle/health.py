"""Calibration and health of a vehicle before the first flight of a day: its own reports, item by item.

Nothing is changed on it, and what it does not tell is unknown, never good. What few vehicles tell (cells, cycles, motors) does not
keep one on the ground; it is said that it is unknown.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import reduce
from operator import and_
from typing import TYPE_CHECKING, Any, Literal

from skyway.link.protocol.command import AskFor
from skyway.link.protocol.parameters import ReadParameters
from skyway.models.base.errors import VehicleTimeoutError
from skyway.models.base.formatting import percent, with_unit
from skyway.models.base.views import how_often

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.missions.autopilots.calibration import Calibration
    from skyway.missions.autopilots.family import Family

Verdict = Literal["ok", "no", "unknown"]
_SENSORS = {
    0x1: "gyro", 0x2: "accelerometer", 0x4: "compass", 0x8: "barometer", 0x10: "airspeed sensor", 0x20: "GPS",
    0x8000: "motor outputs", 0x10000: "remote control", 0x20000: "second gyro", 0x40000: "second accelerometer",
    0x80000: "second compass", 0x100000: "geofence", 0x200000: "attitude and heading", 0x400000: "terrain", 0x1000000: "logging",
    0x2000000: "battery", 0x4000000: "proximity sensor", 0x20000000: "obstacle avoidance", 0x40000000: "propulsion",
}  # fmt: skip
"""MAV_SYS_STATUS_SENSOR; what is omitted says nothing of health (controllers, the answer of the pre-arm checks)."""
_NEEDED = 0x1 | 0x2 | 0x8 | 0x20
"""Sensors without which no delivery is flown: they must be there."""
_SOUND = 0x1 | 0x2 | 0x4 | 0x10 | 0x20
"""Attitude, velocity and place over ground and in height, of the filter's flags."""
_WORDS = {"vel": "velocity", "pos": "position", "horiz": "horizontal", "vert": "vertical", "mag": "compass"}
"""What the names of the filter's tests are short for."""
_GLITCHES = 0x80 | 0x400 | 0x800 | 0x8000
_FIX, _SATELLITES, _HDOP = 3, 6, 2.0
_UNTOLD_EPH, _UNTOLD_SATELLITES, _UNTOLD_CELL = (0, 65535), 255, 65535
_MOST_PARTS = 16
_LATE_S, _STREAM_S = 0.2, 2.5
"""Waits for a message after a refusal to send it; longer where it has come before."""
_AWAY_S = 3.0
"""A vehicle that has been silent for longer is asked whether it still answers."""
_BROKEN = {5: "failed", 6: "unhealthy"}
"""MAV_BATTERY_CHARGE_STATE of a battery that is not to be used."""
_CELL_SPREAD_V, _CELL_V = 0.1, (3.0, 4.4)
_MOST_CYCLES = 300
_CLIPS = 100
_GROUP = 4
_RECEIVER = ("GPS_RAW_INT", 24)
_RANK = {"ok": 0, "unknown": 1, "no": 2}


@dataclass(frozen=True, slots=True)
class HealthItem:
    """One checked item."""

    name: str
    verdict: Verdict
    said: str
    """What was found, with figures."""
    needed: bool = True
    """Whether it must be known: where not, *unknown* keeps no vehicle on the ground."""

    @property
    def ok(self) -> bool:
        """Whether it lets the vehicle fly."""
        return self.verdict == "ok" or (self.verdict == "unknown" and not self.needed)

    def __str__(self) -> str:
        mark = {"ok": "ok", "no": "NOT OK", "unknown": "unknown"}[self.verdict]
        return f"{self.name}: {mark}: {self.said}"


@dataclass(frozen=True, slots=True)
class Vibration:
    """What shook a vehicle on a flight."""

    worst_mps2: float
    """What was exceeded in a twentieth of the flight, by the worst axis."""
    clips: int
    """How often an accelerometer reached its limit."""


def look_at(vehicle: Vehicle, flown: Vibration | None = None) -> Iterator[HealthItem]:
    """Check all of a vehicle's health; `flown` is its vibration on the last flight, as far as known.

    Raises a `VehicleTimeoutError` if it no longer answers.
    """
    family = vehicle.family
    yield sensors(_told(vehicle, "SYS_STATUS", 1))
    yield filter_state(_told(vehicle, *family.filter_message), family)
    yield from calibrations(family.calibrations, _parameters(vehicle, family.calibrations))
    yield receiver(_told(vehicle, *_RECEIVER))
    _told_by_parts(vehicle, "BATTERY_STATUS", 147, "id")
    yield worst(cells, vehicle.batteries.reports(vehicle.connection.clock.now_s()))
    yield worst(cycles, _told_by_parts(vehicle, "SMART_BATTERY_INFO", 370, "id"))
    yield motors(_told_by_parts(vehicle, "ESC_INFO", 290, "index"))
    yield vibration(flown, family)


def look_again(vehicle: Vehicle) -> Iterator[HealthItem]:
    """Check what changes from minute to minute, of a vehicle that was found good today: sensors, filter and receiver."""
    yield sensors(_told(vehicle, "SYS_STATUS", 1))
    yield filter_state(_told(vehicle, *vehicle.family.filter_message), vehicle.family)
    yield receiver(_told(vehicle, *_RECEIVER))


def _told(vehicle: Vehicle, name: str, number: int) -> Mapping[str, Any] | None:
    streams = name in vehicle.peer.latest  # old firmware cannot be asked, and tells it by itself
    message = vehicle.carry_out(
        AskFor(vehicle.peer.target, name, number, late_s=_STREAM_S if streams else _LATE_S)
    ).message
    if message is None and vehicle.silent_s > _AWAY_S and not vehicle.answers():
        raise VehicleTimeoutError(name, vehicle.silent_s)
    return None if message is None else message.fields


def _told_by_parts(vehicle: Vehicle, name: str, number: int, key: str) -> dict[int, Mapping[str, Any]]:
    """What a message tells that comes once for each part (battery, group of motors), by its number.

    Some vehicles answer with all, others with one after the other: it is complete when two answers in a row are of known parts.
    """
    found: dict[int, Mapping[str, Any]] = {}
    again = 0
    while again < 2 and len(found) < _MOST_PARTS:
        told = _told(vehicle, name, number)
        if told is None:
            break
        again = again + 1 if told[key] in found else 0
        found[told[key]] = told
    return found


def _parameters(vehicle: Vehicle, places: Sequence[Calibration]) -> Mapping[str, float]:
    """Values by name, of those that it has: they may change by themselves, so nothing is decided by them later."""
    names = tuple(dict.fromkeys(name for place in places for name in place.names))
    if not names:
        return {}
    read = ReadParameters(vehicle.peer.target, names, bytewise=vehicle.bytewise_parameters)
    return {name: one.value for name, one in vehicle.carry_out(read).found.items()}


def sensors(told: Mapping[str, Any] | None) -> HealthItem:
    """Check the sensors by SYS_STATUS: each enabled one is healthy, and required ones are present."""
    if told is None:
        return HealthItem("sensors", "unknown", "the vehicle does not report it (SYS_STATUS)")
    present, enabled, healthy = (
        int(told[f"onboard_control_sensors_{word}"]) for word in ("present", "enabled", "health")
    )
    ill = [name for bit, name in _SENSORS.items() if enabled & bit and not healthy & bit]
    absent = [name for bit, name in _SENSORS.items() if _NEEDED & bit and not present & enabled & bit]
    if ill or absent:
        parts = [f"not healthy: {', '.join(ill)}"] if ill else []
        parts += [f"not there, or switched off: {', '.join(absent)}"] if absent else []
        return HealthItem("sensors", "no", "; ".join(parts))
    sound = [name for bit, name in _SENSORS.items() if enabled & bit]
    return HealthItem("sensors", "ok", ", ".join(sound))


def filter_state(told: Mapping[str, Any] | None, family: Family) -> HealthItem:
    """Judge the autopilot's filter: it has attitude, velocity and place, and agrees with its sensors."""
    if told is None:
        return HealthItem("filter", "unknown", f"the vehicle does not report it ({family.filter_message[0]})")
    flags = int(told["flags"])
    tests = {name: float(told[name]) for name in family.filter_tests}
    known = {name: value for name, value in tests.items() if math.isfinite(value)}
    if flags & _SOUND != _SOUND or flags & _GLITCHES:
        return HealthItem("filter", "no", f"no sound estimate of attitude, velocity and place (flags {flags:#x})")
    if not known:
        return HealthItem("filter", "unknown", "the vehicle does not report how its sensors agree")
    worst = max(known, key=known.__getitem__)
    name = " ".join(_WORDS.get(word, word) for word in worst.split("_"))
    said = f"{name} {known[worst]:.2f}, less than {family.filter_limit:g} allowed"
    return HealthItem("filter", "ok" if known[worst] < family.filter_limit else "no", said)


def calibrations(places: Sequence[Calibration], values: Mapping[str, float]) -> Iterator[HealthItem]:
    """Check the calibrations: one for every sensor in use, and at least one of each kind."""
    for sensor in Counter(place.sensor for place in places):
        mine = [place for place in places if place.sensor == sensor]
        known = [place for place in mine if place.identified in values]
        filled = [place for place in known if values[place.identified] != 0.0 and values.get(place.used, 1.0) != 0.0]
        faults = [fault for place in filled if (fault := _fault(place, values))]
        name = f"{sensor} calibration"
        if faults:
            yield HealthItem(name, "no", "; ".join(faults))
        elif not known:
            yield HealthItem(name, "unknown", f"the vehicle does not report {mine[0].identified}")
        elif not filled:
            yield HealthItem(name, "no", f"none: {', '.join(place.identified for place in known)} are 0, or not in use")
        else:
            yield HealthItem(
                name, "ok", f"{len(filled)} of {len(mine)} places, {', '.join(p.identified for p in filled)}"
            )


def _fault(place: Calibration, values: Mapping[str, float]) -> str:
    """Why a calibration is none; empty for a good one."""
    offsets = [values[name] for name in place.offsets if name in values]
    if len(offsets) < len(place.offsets):
        return f"{', '.join(name for name in place.offsets if name not in values)} not reported"
    if not all(map(math.isfinite, offsets)):
        return f"{place.offsets[0]} and the others of {place.identified} are not numbers"
    if offsets and place.zero_is_none and not any(offsets):
        return f"{', '.join(place.offsets)} are 0: never calibrated"
    length = math.hypot(*offsets)
    return (
        f"the offsets of {place.identified} are {length:.0f} long, {place.most:.0f} at most"
        if length > place.most
        else ""
    )


def receiver(told: Mapping[str, Any] | None) -> HealthItem:
    """Judge the satellite receiver, by GPS_RAW_INT."""
    if told is None:
        return HealthItem("GPS", "unknown", "the vehicle does not report it (GPS_RAW_INT)")
    fix, satellites, eph = int(told["fix_type"]), int(told["satellites_visible"]), int(told["eph"])
    hdop = math.nan if eph in _UNTOLD_EPH else eph / 100.0
    counted = satellites != _UNTOLD_SATELLITES
    seen = f"{satellites} satellites" if counted else "satellites not reported"
    said = f"fix {fix}, {seen}, HDOP {'not reported' if math.isnan(hdop) else f'{hdop:.1f}'}"
    if fix < _FIX or satellites < _SATELLITES or hdop > _HDOP:
        return HealthItem("GPS", "no", f"{said}; {_FIX}, {_SATELLITES} and {_HDOP:g} needed")
    return HealthItem("GPS", "ok" if counted and not math.isnan(hdop) else "unknown", said)


def worst(judge: Callable[[Mapping[str, Any] | None], HealthItem], told: Mapping[int, Mapping[str, Any]]) -> HealthItem:
    """Judge what each battery tells: the worst counts, and where there are several, all are named."""
    items = {number: judge(one) for number, one in told.items()}
    if len(items) <= 1:
        return next(iter(items.values()), judge(None))
    first = max(items.values(), key=lambda item: _RANK[item.verdict])
    said = "; ".join(f"battery {number}: {item.said}" for number, item in items.items())
    return replace(first, said=said)


def cells(told: Mapping[str, Any] | None) -> HealthItem:
    """Check the spread of the battery's cells by BATTERY_STATUS: reported singly, shared out evenly, or not at all."""
    if told is None:
        return HealthItem("battery cells", "unknown", "the vehicle does not report it (BATTERY_STATUS)", needed=False)
    if fault := int(told.get("fault_bitmask", 0)):
        return HealthItem("battery cells", "no", f"the battery reports a fault (bits {fault:#x})")
    if state := _BROKEN.get(int(told.get("charge_state", 0))):
        return HealthItem("battery cells", "no", f"the battery reports that it is {state}")
    volts = [value / 1e3 for value in told["voltages"] if value != _UNTOLD_CELL]
    volts += [value / 1e3 for value in told.get("voltages_ext", ()) if value not in (0, _UNTOLD_CELL)]
    if len(volts) < 2 or len(set(volts)) == 1:
        shared = "its cells are not reported individually" if volts else "no voltage is reported"
        return HealthItem("battery cells", "unknown", shared, needed=False)
    spread = max(volts) - min(volts)
    said = f"{len(volts)} cells, {min(volts):.2f} to {max(volts):.2f} V, {with_unit(spread * 1e3, 'mV', 0)} apart"
    good = spread <= _CELL_SPREAD_V and _CELL_V[0] <= min(volts) and max(volts) <= _CELL_V[1]
    return HealthItem(
        "battery cells", "ok" if good else "no", said if good else f"{said}; 100 mV at most, 3.0 to 4.4 V each"
    )


def cycles(told: Mapping[str, Any] | None) -> HealthItem:
    """Judge the age of the battery, by SMART_BATTERY_INFO, which smart batteries have."""
    count = -1 if told is None else int(told["cycle_count"])
    if told is None or not 0 <= count < _UNTOLD_CELL:
        return HealthItem(
            "battery cycles", "unknown", "the battery does not report them (SMART_BATTERY_INFO)", needed=False
        )
    full, design = float(told["capacity_full"]), float(told["capacity_full_specification"])
    holds = f"; it holds {percent(full / design)} of its design capacity" if full > 0.0 and design > 0.0 else ""
    said = f"{count} cycles{holds}"
    return HealthItem(
        "battery cycles",
        "ok" if count <= _MOST_CYCLES else "no",
        said if count <= _MOST_CYCLES else f"{said}; {_MOST_CYCLES} at most",
    )


def motors(told: Mapping[int, Mapping[str, Any]]) -> HealthItem:
    """Judge the motors' controllers, by ESC_INFO of each group of four, by its first: all are heard, none reports a failure."""
    count = max((int(group["count"]) for group in told.values()), default=0)
    if not count:
        return HealthItem("motors", "unknown", "the motor controllers do not report (ESC_INFO)", needed=False)
    failing, untold = [], []
    for n in range(count):
        group = told.get(n // _GROUP * _GROUP)
        if group is None:
            untold.append(n + 1)
        elif group["failure_flags"][n % _GROUP]:
            failing.append(n + 1)
    heard = reduce(and_, (int(group["info"]) for group in told.values()))
    silent = [n + 1 for n in range(min(count, 8)) if not heard >> n & 1]
    if silent or failing:
        parts = [f"not heard: {', '.join(map(str, silent))}"] if silent else []
        parts += [f"failing: {', '.join(map(str, failing))}"] if failing else []
        return HealthItem("motors", "no", "; ".join(parts))
    if untold:
        said = f"{count} controllers, of which {', '.join(map(str, untold))} are not reported"
        return HealthItem("motors", "unknown", said, needed=False)
    return HealthItem("motors", "ok", f"{count} controllers heard, no failure")


def vibration(flown: Vibration | None, family: Family) -> HealthItem:
    """Judge how the vehicle shook on its last flight."""
    if flown is None or not math.isfinite(flown.worst_mps2):
        return HealthItem("vibration", "unknown", "skyway has not watched a flight of it yet", needed=False)
    raised, most = family.vibration_mps2
    said = f"{with_unit(flown.worst_mps2, 'm/s²', 1)} on the last flight, {how_often(flown.clips)} at the limit of an accelerometer"
    if flown.worst_mps2 >= most or flown.clips > _CLIPS:
        return HealthItem("vibration", "no", f"{said}; {most:g} m/s² and {_CLIPS} times at most")
    return HealthItem(
        "vibration", "ok", f"{said}; above {raised:g} m/s² check its mounts" if flown.worst_mps2 >= raised else said
    )
