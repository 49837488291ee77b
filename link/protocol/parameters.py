"""Parameter protocol: read by name, set, list all; and the parameters that a mission requires."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.protocol.exchange import Exchange, Question
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message
    from skyway.missions.items.parameters import Parameter

REAL32 = 9
CHANGE_BY_THEMSELVES = ("STAT_", "COM_FLIGHT_UUID", "LND_FLIGHT_T", "_HASH_CHECK")
"""Prefixes of the names of parameters that autopilots write themselves."""
GIVE_UP_S = 5.0
_LIST_GIVE_UP_S = 8.0
_LIST_QUIET_S = 0.6
_LONGEST_S = 60.0
"""Time limit of reading by name, also if another station constantly requests parameters."""
_ASK_AT_ONCE = 10
_CHANCE = 1e-4
"""Accepted probability that a parameter counts as absent although it exists and its answers were lost."""
_ANSWERS = ("PARAM_VALUE", "PARAM_ERROR")
_DOES_NOT_EXIST = 1
PARAMETER_ERRORS = {
    1: "there is no parameter of that name", 2: "out of range", 3: "not permitted", 4: "unknown component", 5: "read-only",
    6: "its type is not supported", 7: "another type",
}  # fmt: skip
"""MAV_PARAM_ERROR in words."""
_WHOLE = {1: "<B3x", 2: "<b3x", 3: "<H2x", 4: "<h2x", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of whole numbers, and the layout of their bytes in those of a float."""


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """A parameter with its value on the vehicle."""

    name: str
    """The autopilot's name."""
    value: float
    """In the autopilot's unit."""
    kind: int
    """MAV_PARAM_TYPE."""


def read_value(message: Message, *, bytewise: bool) -> ParameterValue:
    """Value of a PARAM_VALUE message."""
    kind, value = message["param_type"], message["param_value"]
    if bytewise and kind in _WHOLE:
        value = float(struct.unpack(_WHOLE[kind], message.payload[:4].ljust(4, b"\0"))[0])
    return ParameterValue(message["param_id"], float(value), kind)


def wire_value(value: float, kind: int, *, bytewise: bool) -> float:
    """Value for a PARAM_SET message."""
    if not (bytewise and kind in _WHOLE):
        return value
    try:
        raw = struct.pack(_WHOLE[kind], round(value))
    except struct.error:
        raise InputError(Fault("does not fit this parameter", value=value, remedy="a smaller whole number")) from None
    return float(struct.unpack("<f", raw)[0])


def is_whole(kind: int) -> bool:
    """Whether a parameter of a MAV_PARAM_TYPE is a whole number."""
    return kind in _WHOLE


def misfit(value: float, kind: int) -> str:
    """Reason why a parameter of a MAV_PARAM_TYPE cannot hold a value; empty if it can."""
    if not math.isfinite(value):
        return "is not a finite number"
    try:
        if is_whole(kind):
            wire_value(value, kind, bytewise=True)
        else:
            struct.pack("<f", value)
    except (InputError, OverflowError):
        return "does not fit this parameter of the vehicle"
    return "is a whole number on the vehicle" if is_whole(kind) and value != round(value) else ""


def same_value(wanted: float, actual: float, kind: int) -> bool:
    """Whether a value read back equals the value set."""
    if kind in _WHOLE:
        return round(wanted) == round(actual)
    return math.isclose(wanted, actual, rel_tol=1e-6, abs_tol=1e-9)


class SetParameter(Question):
    """Sets one parameter and waits for the resulting value."""

    def __init__(
        self,
        target: Target,
        name: str,
        value: float,
        kind: int,
        *,
        bytewise: bool,
    ) -> None:
        _check_name(name)
        wire = wire_value(value, kind, bytewise=bytewise)
        super().__init__(target, "PARAM_SET", param_id=name, param_value=wire, param_type=kind)
        self.name, self.value, self.kind, self.bytewise = name, value, kind, bytewise
        self.found: ParameterValue | None = None
        """The vehicle's answer; None: no answer."""
        self.refused: int | None = None
        """MAV_PARAM_ERROR, if it reports that it does not accept the value."""

    def hear(self, message: Message, now_s: float) -> None:
        """Process the answer."""
        if message.name not in _ANSWERS or message["param_id"] != self.name:
            return
        self._learn(now_s)
        if message.name == "PARAM_ERROR":
            self.refused = message["error"]
        else:
            self.found = read_value(message, bytewise=self.bytewise)
        self.finish()


class ReadParameters(Exchange):
    """Reads parameters by name, and distinguishes absent parameters from lost answers.

    Newer firmware reports that a parameter is absent (PARAM_ERROR); older firmware is silent. So the names are requested in
    rounds, and each round ends with a request that every vehicle answers: the first parameter of its list. If that
    answer comes and those to a name requested before it do not, in so many rounds that losses do not explain it
    (`_CHANCE`, by the share of answers that this link loses), the vehicle has no such parameter. If nothing comes at
    all for `GIVE_UP_S`, the link is lost, and nothing is known.
    """

    def __init__(self, target: Target, names: Sequence[str], *, bytewise: bool) -> None:
        super().__init__(target)
        for name in names:
            _check_name(name)
        self.bytewise = bytewise
        self.found: dict[str, ParameterValue] = {}
        """The received parameters, by name."""
        self.absent: set[str] = set()
        """Names of parameters that the vehicle does not have."""
        self._silent = dict.fromkeys(names, 0)
        self._round: tuple[str, ...] = ()
        self._answered = self._lost = self._missed = 0
        self._probed = False
        self._begun_s = self._heard_s = self._sent_s = 0.0

    @property
    def _open(self) -> list[str]:
        return [name for name in self._silent if name not in self.found and name not in self.absent]

    def begin(self, now_s: float) -> None:
        """Request the first."""
        self._begun_s = self._heard_s = now_s
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        """Begin a round: those that were requested least often, and last the request that is always answered."""
        self._round = tuple(sorted(self._open, key=self._silent.__getitem__)[:_ASK_AT_ONCE])
        if not self._round:
            self.finish()
            return
        for name in self._round:
            self.send("PARAM_REQUEST_READ", param_id=name, param_index=-1)
        self.send("PARAM_REQUEST_READ", param_id="", param_index=0)
        self._sent_s, self._probed = now_s, False
        self.next_s = now_s + max(self.round_trip.retry_s(1 + self._missed), 0.1)

    def hear(self, message: Message, now_s: float) -> None:
        """Process an answer; the next round begins with the last one of this."""
        if message.name not in _ANSWERS:
            return
        name = message["param_id"]
        self._heard_s = now_s
        if message.name == "PARAM_ERROR":
            if name in self._silent and message["error"] == _DOES_NOT_EXIST:
                self.absent.add(name)
                self._answered += 1
        elif name in self._silent:
            self._answered += name not in self.found
            self.found[name] = read_value(message, bytewise=self.bytewise)
        if message.name == "PARAM_VALUE" and message["param_index"] == 0 and name not in self._round:
            self._answered += not self._probed
            self._probed = True
            if self._missed:  # it may be the answer to an earlier round
                self.round_trip.unclear()
            else:
                self.round_trip.learn(now_s - self._sent_s)
            self._missed = 0
        if not self._open:
            self.finish()
        elif not any(name in self._open for name in self._round):
            self._ask(now_s)

    def tick(self, now_s: float) -> None:
        """End a round: requested values that did not arrive were lost, or do not exist."""
        if now_s >= min(self._heard_s + GIVE_UP_S, self._begun_s + _LONGEST_S):
            self.finish()
            return
        self._lost += not self._probed
        self._missed += not self._probed
        lost = self._lost + sum(self._silent[name] for name in self.found if name in self._silent)
        loss = (lost + 2.0) / (lost + self._answered + 3.0)
        for name in self._round:
            if self._probed and name in self._open:
                self._silent[name] += 1
                if loss ** self._silent[name] < _CHANCE:
                    self.absent.add(name)
        self._ask(now_s)


def _check_name(name: str) -> None:
    if not 1 <= len(name.encode("ascii", "replace")) <= 16:
        raise InputError(Fault("is not a parameter name", field="parameter", value=name, remedy="1 to 16 letters"))


class ListParameters(Exchange):
    """Reads all parameters, and requests missing ones by number."""

    def __init__(self, target: Target, *, bytewise: bool) -> None:
        super().__init__(target)
        self.bytewise = bytewise
        self.found: dict[int, ParameterValue] = {}
        """By number."""
        self.total: int | None = None
        """Latest reported number of parameters; None until the first arrives."""
        self._renumbered = False
        self._heard_s = 0.0

    @property
    def complete(self) -> bool:
        """Whether all have arrived."""
        return self.total is not None and len(self.found) >= self.total and not self._missing

    @property
    def consistent(self) -> bool:
        """Whether their number stayed the same, and each has another name: otherwise they were renumbered, and some may be missing."""
        return not self._renumbered and len({value.name for value in self.found.values()}) == self.total

    @property
    def _missing(self) -> list[int]:
        return [number for number in range(self.total or 0) if number not in self.found]

    def begin(self, now_s: float) -> None:
        """Request all."""
        self._heard_s = now_s
        self.send("PARAM_REQUEST_LIST")
        self.next_s = now_s + 1.0

    def hear(self, message: Message, now_s: float) -> None:
        """Process one."""
        if message.name != "PARAM_VALUE":
            return
        index, count = message["param_index"], message["param_count"]
        if index >= count:
            return  # not of the list: a value that changes by itself, or was set by another station
        self._renumbered = self._renumbered or self.total not in (None, count)
        self.total = count
        if index not in self.found:  # whatever else comes again and again is no progress
            self._heard_s = now_s
            self.next_s = now_s + _LIST_QUIET_S
        self.found[index] = read_value(message, bytewise=self.bytewise)
        if self.complete:
            self.finish()

    def tick(self, now_s: float) -> None:
        """Request the missing ones."""
        if now_s >= self._heard_s + _LIST_GIVE_UP_S:
            self.finish()
            return
        if self.total is None:
            self.send("PARAM_REQUEST_LIST")
        else:
            for number in self._missing[:_ASK_AT_ONCE]:
                self.send("PARAM_REQUEST_READ", param_id="", param_index=number)
        self.next_s = now_s + max(self.round_trip.retry_s(1), 0.2)


@dataclass(frozen=True, slots=True)
class ParameterCheck:
    """One required parameter compared with the vehicle's value."""

    wanted: Parameter
    """The required parameter in the form for this vehicle's firmware; the first alternative if it has none."""
    actual: float | None
    """The vehicle's value; None if it has no such parameter, or did not answer."""
    absent: bool = False
    """It answers, but has a parameter of none of the names."""

    @property
    def ok(self) -> bool:
        """Whether the value is acceptable."""
        return self.actual is not None and self.wanted.accepts(self.actual)

    @property
    def to_set(self) -> float | None:
        """Value to set; None if nothing is to be set."""
        if self.ok or self.wanted.value is None or self.actual is None or not self.wanted.believes(self.actual):
            return None
        if self.wanted.rule == "bits":
            return float(int(self.actual) | int(self.wanted.value))
        return self.wanted.value

    @property
    def problem(self) -> str:
        """The problem with its remedy; empty if there is none."""
        wanted = self.wanted
        why = f" ({wanted.why})" if wanted.why else ""
        if self.ok:
            return ""
        if self.absent:
            known = " or ".join(dict.fromkeys(way.name for way in wanted.ways))
            remedy = f"; if this firmware has it under another name: --parameter-name {wanted.key}=NAME:UNIT"
            return f"the vehicle has no {known}{why}{remedy if wanted.key else ''}"
        if self.actual is None:
            return f"the vehicle does not report {wanted.name}{why}"
        if not wanted.believes(self.actual):
            return f"{wanted.name} is {self.actual:g} {wanted.unit}: that is impossible; does this firmware use another unit?"
        to_be = "must be checked by hand" if self.to_set is None else f"must be {self.to_set:g}"
        return f"{wanted.name} is {self.actual:g}, {to_be}{f': {wanted.why}' if wanted.why else ''}"


def check_parameters(
    wanted: Sequence[Parameter], actual: Mapping[str, float], absent: Collection[str] = frozenset()
) -> tuple[ParameterCheck, ...]:
    """Compare the required parameters of a mission with those that the vehicle has, and does not have.

    A name in neither was not answered, and may exist.
    """
    return tuple(_check(parameter, actual, absent) for parameter in wanted)


def _check(wanted: Parameter, actual: Mapping[str, float], absent: Collection[str]) -> ParameterCheck:
    """The first alternative that the vehicle has decides; later ones are not considered while an earlier one is unanswered."""
    for way in wanted.ways:
        if way.paired and way.paired in absent:
            continue
        if way.name in absent:
            continue
        known = way.name in actual and (not way.paired or way.paired in actual)
        return ParameterCheck(way, actual[way.name] if known else None)
    return ParameterCheck(wanted, None, absent=True)
