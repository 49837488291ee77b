"""Operator control: the ground station in control, as planned for ArduPilot (its pull request 33332, June 2026).

A station in control is asked to give way; until it does, or allows takeovers, orders of others are denied.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.items import Result
from skyway.sim_stub.protocols.orders import CommandGroup
from skyway.sim_stub.wire.messages import message

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from skyway.sim_stub.protocols.orders import Order

REQUEST = 32100
_SYSTEM_MANAGER, _TAKEOVER_ALLOWED = 1, 2
_ASKING = frozenset((REQUEST, 410, 510, 511, 512, 519, 520))
"""Commands that everybody may give: they ask."""


class OperatorControl(CommandGroup):
    """Operator in control of one vehicle."""

    holder = 0
    """System of the station in control; 0: none."""
    takeover_allowed = False

    def table(self) -> dict[int, Callable[[Order], Result]]:
        """Handlers by command."""
        return {REQUEST: self._request} if self.vehicle.config.operator_control else {}

    def denies(self, system: int, command: int | None = None) -> bool:
        """Whether an order of a station is denied."""
        return self.holder not in (0, system) and command not in _ASKING

    def _request(self, order: Order) -> Result:
        action, allows, _, system = order.p
        who = int(system) if math.isfinite(system) and 0.0 < system < 256.0 else order.sender.system
        if action == 0.0:
            if self.holder != who:
                return Result.FAILED
            self._give(0, allows=False)
            return Result.ACCEPTED
        if self.holder in (0, who) or self.takeover_allowed:
            self._give(who, allows=allows == 1.0)
            return Result.ACCEPTED
        self.vehicle.radio.broadcast(
            message(
                "COMMAND_LONG", target_system=self.holder, command=REQUEST, param1=1.0, param2=allows, param3=10.0,
                param4=float(who),
            )
        )  # fmt: skip
        return Result.FAILED

    def _give(self, system: int, *, allows: bool) -> None:
        self.holder, self.takeover_allowed = system, allows
        self.vehicle.event(f"in control: {f'station {system}' if system else 'nobody'}")
        self.vehicle.radio.broadcast(self.status())

    def status(self) -> Any:
        """Make CONTROL_STATUS."""
        flags = _SYSTEM_MANAGER | (_TAKEOVER_ALLOWED if self.takeover_allowed else 0)
        return message("CONTROL_STATUS", gcs_main=self.holder, flags=flags)
