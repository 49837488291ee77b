"""System commands: restart, calibration, checks, battery, message requests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.items import Command, Result
from skyway.sim_stub.protocols.orders import CommandGroup
from skyway.sim_stub.protocols.telemetry import BUILDERS, HOME, ON_REQUEST, PROTOCOL_VERSION, VERSION, WINCH
from skyway.sim_stub.wire.messages import message_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.protocols.orders import Order

_CALIBRATION_S = 2.0
_NO_INTERVAL = -1.0


class SystemCommands(CommandGroup):
    """Those commands."""

    def table(self) -> dict[int, Callable[[Order], Result]]:
        """Handlers by command."""
        c = Command
        return {
            c.BATTERY_RESET: self._battery_reset,
            c.PREFLIGHT_CALIBRATION: self._calibrate,
            c.PREFLIGHT_STORAGE: self._store,
            c.PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            c.RUN_PREARM_CHECKS: self._check,
            c.GET_HOME_POSITION: lambda o: self._send(o, HOME),
            c.GET_MESSAGE_INTERVAL: self._get_interval,
            c.SET_MESSAGE_INTERVAL: self._set_interval,
            c.REQUEST_MESSAGE: lambda o: self._send(o, o.p[0]),
            c.REQUEST_PROTOCOL_VERSION: lambda o: self._send(o, PROTOCOL_VERSION),
            c.REQUEST_AUTOPILOT_CAPABILITIES: lambda o: self._send(o, VERSION),
        }

    def _calibrate(self, order: Order) -> Result:
        """Take two seconds and tell the progress."""
        if self._pilot.armed:
            return Result.TEMPORARILY_REJECTED
        return self.server.begin(order, _CALIBRATION_S, lambda: Result.ACCEPTED)

    def _store(self, order: Order) -> Result:  # noqa: ARG002
        """Parameters are kept as they are set: there is nothing to do."""
        return Result.TEMPORARILY_REJECTED if self._pilot.armed else Result.ACCEPTED

    def _battery_reset(self, order: Order) -> Result:
        """Set the count of the battery monitor."""
        percent = order.p[1]
        if not 0.0 <= percent <= 100.0:
            return Result.FAILED
        self._pilot.count_charge(percent / 100.0)
        self._pilot.failsafes.battery_level = 0
        self.vehicle.event(f"battery counter set to {percent:g} %")
        return Result.ACCEPTED

    def _reboot(self, order: Order) -> Result:
        pilot = self._pilot
        if order.p[0] not in (1.0, 3.0):
            return pilot.NO_REBOOT if order.p[0] == 0.0 else pilot.REBOOT_REFUSED
        if pilot.armed:
            return pilot.REBOOT_REFUSED
        self.vehicle.reboot_soon()
        return Result.ACCEPTED

    def _check(self, order: Order) -> Result:  # noqa: ARG002
        pilot = self._pilot
        if pilot.armed:
            return Result.TEMPORARILY_REJECTED
        for reason in pilot.arming_refusals():
            pilot.say(2, f"PreArm: {reason}")
        return Result.ACCEPTED

    # Messages

    def _known(self, number: float) -> int | None:
        """Id of a message that this family can send."""
        whole = int(number) if math.isfinite(number) else -1
        if whole == WINCH:
            return whole if self._pilot.tells_winch else None
        return whole if whole in BUILDERS and message_name(whole) not in self._pilot.LACKS else None

    def _set_interval(self, order: Order) -> Result:
        number, interval_us = self._known(order.p[0]), order.p[1]
        if number is None or not math.isfinite(interval_us) or interval_us < _NO_INTERVAL:
            return self._pilot.BAD_VALUE
        self.vehicle.radio.set_interval(order.sender.port, number, interval_us)
        return Result.ACCEPTED

    def _get_interval(self, order: Order) -> Result:
        number = self._known(order.p[0])
        if number is None:
            return Result.FAILED
        stream = order.sender.port.streams.get(number)
        interval = -1 if stream is None else round(stream.interval_s * 1e6)
        order.sender.port.reply("MESSAGE_INTERVAL", message_id=number, interval_us=interval)
        return Result.ACCEPTED

    def _send(self, order: Order, number: float) -> Result:
        known = int(number) if number in (VERSION, PROTOCOL_VERSION) else self._known(number)
        if known is None:
            return self._pilot.UNKNOWN_MESSAGE
        sent = ON_REQUEST[known](self.vehicle)
        if sent is None:
            return Result.FAILED
        order.sender.port.write(sent)
        return Result.ACCEPTED
