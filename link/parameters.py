"""Parameters: read one, set one and read it back, list all; and what a mission requires of them."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from link.exchange import Exchange
from models.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from link.exchange import RoundTrip, Target
    from link.frames import Message
    from missions.parameters import Parameter

REAL32 = 9
GIVE_UP_S = 5.0
_LIST_GIVE_UP_S = 8.0
_LIST_QUIET_S = 0.6
_ASK_AT_ONCE = 10
_WHOLE = {1: "<B3x", 2: "<b3x", 3: "<H2x", 4: "<h2x", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of whole numbers, and how their bytes lie in those of a float."""


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """A parameter as the vehicle has it.

    Attributes
    ----------
    name : str
        The autopilot's name.
    value : float
        In the autopilot's unit.
    kind : int
        MAV_PARAM_TYPE.
    """

    name: str
    value: float
    kind: int


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


def same_value(wanted: float, actual: float, kind: int) -> bool:
    """Whether a value read back is the one that was set."""
    if kind in _WHOLE:
        return round(wanted) == round(actual)
    return math.isclose(wanted, actual, rel_tol=1e-6, abs_tol=1e-9)


class ReadParameter(Exchange):
    """Reads one parameter by name, or sets it first.

    Parameters
    ----------
    setting : (value, kind) or None
        What to set.

    Attributes
    ----------
    found : ParameterValue or None
        What the vehicle answered; None for silence, with which both families meet an unknown name.
    """

    def __init__(
        self,
        target: Target,
        name: str,
        *,
        bytewise: bool,
        setting: tuple[float, int] | None = None,
        round_trip: RoundTrip | None = None,
    ) -> None:
        super().__init__(target, round_trip)
        if not 1 <= len(name.encode("ascii", "replace")) <= 16:
            raise InputError(
                Fault("is no name of a parameter", field="parameter", value=name, remedy="1 to 16 letters")
            )
        self.name, self.bytewise, self.setting = name, bytewise, setting
        self.found: ParameterValue | None = None
        self._tries = 0
        self._begun_s = self._sent_s = 0.0

    def begin(self, now_s: float) -> None:
        """Ask, or set."""
        self._begun_s = now_s
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        if self.setting is None:
            self.send("PARAM_REQUEST_READ", param_id=self.name, param_index=-1)
        else:
            value, kind = self.setting
            wire = wire_value(value, kind, bytewise=self.bytewise)
            self.send("PARAM_SET", param_id=self.name, param_value=wire, param_type=kind)
        self._sent_s = now_s
        self._tries += 1
        self.next_s = now_s + max(self.round_trip.retry_s(self._tries), 0.1)

    def hear(self, message: Message, now_s: float) -> None:
        """Take the answer."""
        if message.name != "PARAM_VALUE" or message["param_id"] != self.name:
            return
        if self._tries == 1:
            self.round_trip.learn(now_s - self._sent_s)
        self.found = read_value(message, bytewise=self.bytewise)
        self.finish()

    def tick(self, now_s: float) -> None:
        """Ask again."""
        if now_s >= self._begun_s + GIVE_UP_S:
            self.finish()
        else:
            self._ask(now_s)


class ListParameters(Exchange):
    """Reads all parameters, and asks by number for those that did not arrive.

    Attributes
    ----------
    found : dict
        By number.
    total : int or None
        How many there are; None as long as nothing has come.
    """

    def __init__(self, target: Target, *, bytewise: bool, round_trip: RoundTrip | None = None) -> None:
        super().__init__(target, round_trip)
        self.bytewise = bytewise
        self.found: dict[int, ParameterValue] = {}
        self.total: int | None = None
        self._heard_s = 0.0

    @property
    def complete(self) -> bool:
        """Whether all have come."""
        return self.total is not None and len(self.found) >= self.total

    def begin(self, now_s: float) -> None:
        """Ask for all."""
        self._heard_s = now_s
        self.send("PARAM_REQUEST_LIST")
        self.next_s = now_s + 1.0

    def hear(self, message: Message, now_s: float) -> None:
        """Take one."""
        if message.name != "PARAM_VALUE":
            return
        index = message["param_index"]
        self.total = message["param_count"]
        self._heard_s = now_s
        self.next_s = now_s + _LIST_QUIET_S
        if index < self.total:
            self.found[index] = read_value(message, bytewise=self.bytewise)
        if self.complete:
            self.finish()

    def tick(self, now_s: float) -> None:
        """Ask for what is missing."""
        if now_s >= self._heard_s + _LIST_GIVE_UP_S:
            self.finish()
            return
        if self.total is None:
            self.send("PARAM_REQUEST_LIST")
        else:
            missing = [number for number in range(self.total) if number not in self.found]
            for number in missing[:_ASK_AT_ONCE]:
                self.send("PARAM_REQUEST_READ", param_id="", param_index=number)
        self.next_s = now_s + max(self.round_trip.retry_s(1), 0.2)


@dataclass(frozen=True, slots=True)
class ParameterCheck:
    """One required parameter beside what the vehicle has.

    Attributes
    ----------
    wanted : Parameter
        What a mission relies on.
    actual : float or None
        What the vehicle has; None where it has no such parameter, or did not answer.
    """

    wanted: Parameter
    actual: float | None

    @property
    def ok(self) -> bool:
        """Whether it will do."""
        return self.actual is not None and self.wanted.accepts(self.actual)

    @property
    def to_set(self) -> float | None:
        """What to set it to; None where nothing is to be set."""
        if self.ok or self.wanted.value is None or self.actual is None:
            return None
        if self.wanted.rule == "bits":
            return float(int(self.actual) | int(self.wanted.value))
        return self.wanted.value


def check_parameters(wanted: Sequence[Parameter], actual: Mapping[str, Any]) -> tuple[ParameterCheck, ...]:
    """Put what a mission relies on beside what was read from the vehicle, by name."""
    return tuple(ParameterCheck(parameter, actual.get(parameter.name)) for parameter in wanted)
