"""PX4's events (topic ``event``) as text.

An event is a number and its packed arguments. Its meaning is in metadata that PX4 writes into each log (XZ, JSON of the
libevents project). If these are missing or damaged, the events in which a flight ends or is refused are still known: a
number is the 32-bit FNV-1a hash of the event's name, its lower 24 bits, behind the number of the component.

Sources: https://docs.px4.io/main/en/concept/events_interface and https://github.com/mavlink/libevents (schema, message templates);
the numbers of all 350 events in the metadata of a PX4 1.14 log are the hashes of their names.
"""

from __future__ import annotations

import lzma
import re
import struct

import msgspec

from skyway.models.base.errors import one_line

AUTOPILOT = 1
"""The component whose names are hashed."""
MAX_PACKED, MAX_JSON = 1 << 20, 1 << 23
"""Limit of the bytes of metadata, packed and unpacked; PX4's are 50 and 160 kB."""
_MAX_MEMORY = 80 << 20
"""Bytes for unpacking: XZ's highest setting, which PX4 uses, requires 65 MB."""
_WHOLE = [f"{kind}{bits}_t" for bits in (8, 16, 32, 64) for kind in ("int", "uint")]
_TYPES = {**dict(zip(_WHOLE, "bBhHiIqQ", strict=True)), "float": "f"}
_PLACE = re.compile(r"\\(.)|\{(\d{1,3})(?::(?:\.(\d))?)?(m_v|m/s|m\^2|m|C)?\}|</?[a-z]+(?: [^>]*)?>", re.DOTALL)
_UNITS = {"m_v": " m", "m/s": " m/s", "m^2": " m²", "m": " m", "C": " °C"}


class Argument(msgspec.Struct, frozen=True):
    """One argument of an event: a number, or one of an enumeration ``component::name``."""

    type: str


class Entry(msgspec.Struct, frozen=True):
    """One value of an enumeration."""

    description: str = ""
    name: str = ""


class Enumeration(msgspec.Struct, frozen=True):
    """Words for the values of an argument."""

    type: str
    entries: dict[str, Entry]
    is_bitfield: bool = False


class EventKind(msgspec.Struct, frozen=True):
    """One kind of event; `type` is ``summary`` for those around a report of checks."""

    name: str = ""
    message: str = ""
    arguments: tuple[Argument, ...] = ()
    type: str = ""


class _Group(msgspec.Struct, frozen=True):
    events: dict[str, EventKind] = {}


class _Component(msgspec.Struct, frozen=True):
    namespace: str = ""
    enums: dict[str, Enumeration] = {}
    event_groups: dict[str, _Group] = {}


class _Metadata(msgspec.Struct, frozen=True):
    components: dict[str, _Component]


def number_of(name: str) -> int:
    """Number of an event of the autopilot with a name."""
    hashed = 0x811C9DC5
    for byte in name.encode():
        hashed = (hashed ^ byte) * 0x01000193 & 0xFFFFFFFF
    return AUTOPILOT << 24 | hashed & 0xFFFFFF


def _entries(words: str) -> dict[str, Entry]:
    return {str(number): Entry(word) for number, word in enumerate(words.split("|"))}


_OWN_ENUMS = {
    "px4::arm_disarm_reason_t": Enumeration(
        "uint8_t",
        _entries(
            "Transition to standby|RC|RC (switch)|internal command|external command|mission start|landing|"
            "auto preflight disarming|kill switch|lockdown|failure detector|shutdown request|unit tests|RC (button)|failsafe"
        ),
    ),
    "px4::failsafe_action_t": Enumeration(
        "uint8_t",
        _entries(
            "none|warning|fallback to position control|fallback to altitude control|fallback to stabilized|hold|RTL|land|"
            "descend|disarm|terminate"
        ),
    ),
    "px4::failsafe_cause_t": Enumeration(
        "uint8_t",
        _entries(
            "unknown cause|manual control loss|GCS connection loss|low battery level|critical battery level|"
            "emergency battery level|low remaining flight time"
        ),
    ),
    "px4::arming_state_t": Enumeration("uint8_t", _entries("Init|Standby|Armed|Standby Error|Shutdown|In-air Restore")),
}
_REASON, _STATE = "px4::arm_disarm_reason_t", "px4::arming_state_t"
_ACTION, _CAUSE = "px4::failsafe_action_t", "px4::failsafe_cause_t"
_OWN = {
    "commander_arming_check_summary": ("Arming check summary", "summary"),
    "commander_health_summary": ("Health report summary", "summary"),
    "commander_armed_by": ("Armed by {1}", _REASON),
    "commander_disarmed_by": ("Disarmed by {1}", _REASON),
    "commander_transition_denied": ("Arming state transition denied: {1} to {2}", _STATE, _STATE),
    "commander_arm_denied_not_manual": ("Arming denied: switch to manual mode first",),
    "commander_arm_denied_throttle_center": ("Arming denied: throttle above center",),
    "commander_arm_denied_throttle_high": ("Arming denied: high throttle",),
    "commander_arm_denied_resolve_failures": ("Arming denied: Resolve system health failures first",),
    "commander_disarming_denied_not_landed": ("Disarming denied, not landed",),
    "commander_mission_start_denied_no_mission": ("Mission start denied! No valid mission",),
    "commander_takeoff_detected": ("Takeoff detected",),
    "commander_landing_detected": ("Landing detected",),
    "commander_kill_sw_engaged": ("Kill-switch engaged",),
    "commander_kill_sw_disengaged": ("Kill-switch disengaged",),
    "commander_rc_lost": ("Manual control lost",),
    "commander_rc_regained": ("Manual control regained after {1:.1} s", "float"),
    "commander_rc_override": ("Pilot took over using sticks",),
    "failsafe_rc_override": ("Pilot took over using sticks",),
    "commander_gcs_lost": ("Connection to ground control station lost",),
    "commander_dl_regained": ("GCS connection regained",),
    "commander_failsafe_enter": ("Failsafe activated due to {3}, triggering {2}", "uint32_t", _ACTION, _CAUSE),
    "commander_failsafe_enter_hold": (
        "Failsafe activated due to {4}, triggering {2} in {3} seconds",
        *("uint32_t", _ACTION, "uint16_t", _CAUSE),
    ),
    "commander_failsafe_enter_generic": ("Failsafe activated, triggering {2}", "uint32_t", _ACTION),
    "commander_failsafe_enter_generic_hold": (
        "Failsafe activated, triggering {2} in {3} seconds",
        *("uint32_t", _ACTION, "uint16_t"),
    ),
    "commander_failsafe_enter_warn": ("Failsafe warning triggered due to {2}", "uint32_t", _CAUSE),
    "commander_failsafe_enter_generic_warn": ("Failsafe warning triggered", "uint32_t"),
    "commander_failsafe_enter_low_bat": ("Low battery level, return advised",),
    "commander_failsafe_enter_crit_bat_warn": ("Critical battery level, land now",),
    "commander_failsafe_enter_crit_low_bat_warn": ("Emergency battery level, land immediately",),
    "commander_low_bat_shutdown": ("Dangerously low battery! Shutting system down",),
}


REPORT_BEGINS = number_of("commander_arming_check_summary")
"""The event before the lines of a report of checks; another summary follows them."""
_CHECKS = ("arming_check", "health")


def _own() -> dict[int, tuple[str, EventKind]]:
    """Events known without metadata, in the form of `_read`."""
    known = {}
    for name, (message, *types) in _OWN.items():
        summary = "summary" in types
        kinds = () if summary else tuple(Argument(kind) for kind in types)
        known[number_of(name)] = "default", EventKind(name, message, kinds, "summary" if summary else "")
    return known


class EventWords:
    """Texts of events, from the metadata of a log in their stored form, `packed`; empty if it has none."""

    def __init__(self, packed: bytes = b"") -> None:
        found = _read(packed) if packed else None
        self._known, self._enums = found or (_own(), _OWN_ENUMS)

    def is_summary(self, number: int) -> bool:
        """Whether an event only begins or ends a report of checks."""
        return self.describes(number) and self._known[number][1].type == "summary"

    def describes(self, number: int) -> bool:
        """Whether an event has a text."""
        return number in self._known

    def is_check(self, number: int) -> bool:
        """Whether an event is a line of a report of checks, which repeats lasting conditions each time."""
        return self.describes(number) and self._known[number][0] in _CHECKS and not self.is_summary(number)

    def text(self, number: int, arguments: bytes) -> str:
        """Return the text of an event; of an undescribed one, its number and arguments."""
        group, kind = self._known.get(number, ("", None))
        values = None if kind is None else self._values(kind, arguments)
        if kind is None or values is None or not kind.message:
            name = f" ({kind.name})" if kind is not None and kind.name else ""
            given = f", arguments {arguments.rstrip(bytes(1)).hex(' ')}" if any(arguments) else ""
            return f"event {number >> 24}:{number & 0xFFFFFF}{name}, not described in the log{given}"
        said = _PLACE.sub(lambda place: _filled(place, values), kind.message).strip()
        return f"check failed: {said}" if group in _CHECKS else said

    def _values(self, kind: EventKind, arguments: bytes) -> list[float | str] | None:
        """Arguments as numbers and words; None if they do not fit."""
        values: list[float | str] = []
        place = 0
        for argument in kind.arguments:
            enum = None if argument.type in _TYPES else self._enums.get(argument.type)
            letter = _TYPES.get(argument.type if enum is None else enum.type)
            if letter is None or place + struct.calcsize(letter) > len(arguments):
                return None
            (value,) = struct.unpack_from(f"<{letter}", arguments, place)
            place += struct.calcsize(letter)
            values.append(value if enum is None else _word(enum, value))
        return values


class EventReports:
    """Processes events in order, and omits from each report of checks the lines of the previous report."""

    def __init__(self, words: EventWords) -> None:
        self._words = words
        self._before: set[tuple[int, bytes]] = set()
        self._report: set[tuple[int, bytes]] = set()
        self._reporting = False

    def hear(self, number: int, arguments: bytes) -> tuple[str, bool]:
        """Take an event; returns the text to report, empty for none, and whether it is a line of a report."""
        if self._words.is_summary(number):
            self._reporting = number == REPORT_BEGINS
            if self._reporting:
                self._before, self._report = self._report, set()
            return "", True
        check = self._words.is_check(number) or (self._reporting and not self._words.describes(number))
        lasts = check and (number, arguments) in self._before | self._report
        if check:
            self._report.add((number, arguments))
        return "" if lasts else one_line(self._words.text(number, arguments)), check


def _word(enum: Enumeration, value: int) -> str:
    """Words for a value, or for each bit of it."""
    if enum.is_bitfield and value >= 0:
        bits = [1 << bit for bit in range(64) if value >> bit & 1]
        return "|".join(_word(Enumeration(enum.type, enum.entries), bit) for bit in bits) or "none"
    entry = enum.entries.get(str(value))
    return (entry.description or entry.name) if entry is not None else f"number {value}"


def _filled(place: re.Match[str], values: list[float | str]) -> str:
    """Replacement for an escaped character, an argument or a tag in a message."""
    escaped, number, digits, unit = place.groups()
    if escaped:
        return escaped
    if not number:
        return ""  # a tag; its content stays
    if not 1 <= int(number) <= len(values):
        return place.group()
    value = values[int(number) - 1]
    said = f"{value:.{digits}f}" if digits and not isinstance(value, str) else f"{value}"
    return said + _UNITS.get(unit, "")


def _read(packed: bytes) -> tuple[dict[int, tuple[str, EventKind]], dict[str, Enumeration]] | None:
    """Read metadata: group and kind of each event by its number, and enumerations; None if they are invalid."""
    try:
        unpack = lzma.LZMADecompressor(memlimit=_MAX_MEMORY)
        text = unpack.decompress(packed, MAX_JSON)
        metadata = msgspec.json.decode(text, type=_Metadata) if unpack.eof else None
        if metadata is None:
            return None
        known = {
            int(number) << 24 | int(sub) & 0xFFFFFF: (group, kind)
            for number, component in metadata.components.items()
            for group, found in component.event_groups.items()
            for sub, kind in found.events.items()
        }
    except (lzma.LZMAError, msgspec.MsgspecError, ValueError, RecursionError, MemoryError):
        return None
    enums = {
        f"{component.namespace}::{name}": enum
        for component in metadata.components.values()
        for name, enum in component.enums.items()
    }
    # within a component its own enumerations may be named without it
    enums = {name.partition("::")[2]: enum for name, enum in enums.items()} | enums
    return known, enums
