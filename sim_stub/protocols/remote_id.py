"""A Remote ID module on the vehicle, like ArduRemoteID: a separate component that reports what it lacks before it is ready.

Its rules are those of ArduRemoteID's transport.cpp: position and system message every 3 s, the others every 22 s; the vehicle's own id is kept in the module.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.wire.messages import message

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

COMPONENT = 236
"""MAV_COMP_ID_ODID_TXRX_1."""
_TYPE_ODID, _NO_AUTOPILOT = 34, 8
_FAST_S, _SLOW_S = 3.0, 22.0
_NAMES = {
    "OPEN_DRONE_ID_SELF_ID": ("SELF_ID", _SLOW_S),
    "OPEN_DRONE_ID_OPERATOR_ID": ("OP_ID", _SLOW_S),
    "OPEN_DRONE_ID_SYSTEM": ("SYS", _FAST_S),
}
"""Required messages, their names in errors, and their longest intervals."""


class RemoteIdModule:
    """The module of one vehicle; `told` is its broadcast data, by the name of the message."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.told: dict[str, Any] = {}
        self._heard_s: dict[str, float] = {}

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return dict.fromkeys((*_NAMES, "OPEN_DRONE_ID_SYSTEM_UPDATE"), self._hear) if self.present else {}

    @property
    def present(self) -> bool:
        """Whether the vehicle has one."""
        return self.vehicle.config.remote_id

    @property
    def silent(self) -> bool:
        """Whether it sends nothing, and broadcasts nothing."""
        return "remote-id-off" in self.vehicle.faults.active

    def _hear(self, port: Any, heard: Any) -> None:  # noqa: ARG002
        if self.silent:
            return
        name = heard.get_type()
        if name == "OPEN_DRONE_ID_SYSTEM_UPDATE":  # counts only after the whole message
            name = "OPEN_DRONE_ID_SYSTEM"
            if name not in self.told:
                return
        else:
            self.told[name] = heard
        self._heard_s[name] = self.vehicle.sim_s

    def lacks(self) -> str:
        """Return its missing data; empty where it is ready."""
        now = self.vehicle.sim_s
        found = [] if self.vehicle.faults.positioning else ["LOC"]
        late = (word for name, (word, age_s) in _NAMES.items() if now > self._heard_s.get(name, -math.inf) + age_s)
        found += late
        system = self.told.get("OPEN_DRONE_ID_SYSTEM")
        if system is None or not (system.operator_latitude or system.operator_longitude):
            found.append("OP_LOC")
        return f"missing {' '.join(found)}" if found else ""

    def refusal(self) -> str:
        """Return why an autopilot that requires it does not arm; empty where it may."""
        return "not available" if not self.present or self.silent else self.lacks()

    def says(self) -> tuple[Any, ...]:
        """Make what it sends once a second: its heartbeat, and whether it is ready."""
        if self.silent:
            return ()
        lacks = self.lacks()
        status = message("OPEN_DRONE_ID_ARM_STATUS", status=1 if lacks else 0, error=lacks)
        return message(
            "HEARTBEAT", type=_TYPE_ODID, autopilot=_NO_AUTOPILOT, system_status=4, mavlink_version=3
        ), status
