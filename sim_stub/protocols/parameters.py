"""Parameter protocol, with each family's encoding of integers."""

from __future__ import annotations

import math
import struct
from collections import deque
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.parameters import REAL32, Parameter
from skyway.sim_stub.wire.messages import payload_of
from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_PER_TICK = 8
_TICK_S = 0.01
_MAX_LISTS = 4
_DOES_NOT_EXIST = 1
"""MAV_PARAM_ERROR."""


class ParameterServer:
    """Answers PARAM_* messages."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.bytewise = vehicle.autopilot.BYTEWISE
        self.lists: deque[tuple[Port, int]] = deque()
        self.next_s = math.inf

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "PARAM_REQUEST_LIST": self.request_list,
            "PARAM_REQUEST_READ": self.read,
            "PARAM_SET": self.set,
        }

    def forget(self) -> None:
        """Drop lists under way."""
        self.lists.clear()
        self.next_s = math.inf

    def next_wall_s(self) -> float:
        """Next time at which more of a list is sent."""
        return self.next_s

    def request_list(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Begin to send all parameters, a few at a time."""
        waiting = [entry for entry in self.lists if entry[0] is not port and not entry[0].closed]
        self.lists = deque([*waiting[-_MAX_LISTS:], (port, 0)])
        self.next_s = self.vehicle.wall_s

    def tick(self) -> None:
        """Send the next few parameters of the list requested first."""
        if not self.lists or self.vehicle.wall_s < self.next_s:
            return
        port, index = self.lists[0]
        store = self.vehicle.autopilot.parameters
        stop = len(store) if port.closed else min(index + _PER_TICK, len(store))
        for number in range(index, stop if not port.closed else index):
            parameter = store.at(number)
            if parameter is not None:
                self._send(port, parameter)
        if stop >= len(store):
            self.lists.popleft()
        else:
            self.lists[0] = (port, stop)
        self.next_s = self.vehicle.wall_s + _TICK_S if self.lists else math.inf

    def read(self, port: Port, message: Any) -> None:
        """Send one parameter, by name or by index; silence for one that does not exist, or an error in newer firmware."""
        store = self.vehicle.autopilot.parameters
        index = message.param_index
        parameter = store.find(message.param_id) if index < 0 else store.at(index)
        if parameter is not None:
            self._send(port, parameter)
        else:
            self._tell_absent(port, message)

    def _tell_absent(self, port: Port, message: Any) -> None:
        """PARAM_ERROR, which MAVLink has since late 2025."""
        if self.vehicle.config.version >= self.vehicle.autopilot.PARAMETER_ERRORS_SINCE:
            index = getattr(message, "param_index", -1)
            Partner.of(port, message).tell(
                "PARAM_ERROR", param_id=message.param_id, param_index=index, error=_DOES_NOT_EXIST
            )

    def set(self, port: Port, message: Any) -> None:
        """Set a parameter and tell everybody; some say in a text what is wrong with it."""
        store = self.vehicle.autopilot.parameters
        parameter = store.find(message.param_id)
        if parameter is None:
            if self.vehicle.autopilot.STRICT_PARAMETERS:
                self.vehicle.radio.say(3, f"unknown param: {message.param_id}"[:50])
            self._tell_absent(port, message)
            return
        kind = message.param_type
        if self.vehicle.autopilot.STRICT_PARAMETERS and kind != parameter.kind:
            self.vehicle.radio.say(3, f"param types mismatch param: {parameter.name}")
            return
        value = message.param_value
        if self.bytewise and kind != REAL32:
            value = float(int.from_bytes(payload_of(message)[:4], "little", signed=True))
        if store.set(parameter.name, value):
            self.vehicle.event(f"parameter {parameter.name} = {parameter.value:g}")
            self.vehicle.radio.choose_versions()
        for open_port in self.vehicle.radio.ports:
            self._send(open_port, parameter)

    def _send(self, port: Port, parameter: Parameter) -> None:
        store = self.vehicle.autopilot.parameters
        value = parameter.value
        if self.bytewise and parameter.kind != REAL32:
            (value,) = struct.unpack("<f", int(value).to_bytes(4, "little", signed=True))
        port.reply(
            "PARAM_VALUE",
            param_id=parameter.name,
            param_value=value,
            param_type=parameter.kind,
            param_count=len(store),
            param_index=store.index(parameter.name),
        )
