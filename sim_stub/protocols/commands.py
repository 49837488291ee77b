"""The command protocol: COMMAND_LONG and COMMAND_INT, answers, progress, cancelling."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_stub.autopilot.base import Home
from sim_stub.autopilot.items import Command, Frame, Item, Result
from sim_stub.autopilot.mission_run import MissionState
from sim_stub.autopilot.modes import Mode
from sim_stub.protocols.telemetry import BUILDERS, FAMILY_ONLY
from sim_stub.wire.messages import specs

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_stub.autopilot.base import Autopilot
    from sim_stub.ports import Port
    from sim_stub.vehicle import Vehicle
    from sim_stub.wire.frames import Message

_FORCE = 21196.0
_FORCE_OLD = 2989.0
_CALIBRATION_S = 2.0
_NO_INTERVAL = -1.0


@dataclass(frozen=True, slots=True)
class Order:
    """A command as it came.

    Attributes
    ----------
    number : int
        MAV_CMD.
    p : tuple of float
        p1 to p4.
    lat, lon : float
        Degrees; NaN where none is given.
    z : float
        p7.
    relative : bool
        z counts from home.
    port : Port
        Where it came from and the answer goes.
    """

    number: int
    p: tuple[float, float, float, float]
    lat: float
    lon: float
    z: float
    relative: bool
    port: Port
    system: int
    component: int
    as_int: bool

    @property
    def by(self) -> str:
        """Who gave it, for the log."""
        return f"station {self.system}"

    def item(self) -> Item:
        """The same as a mission item."""
        placed = math.isfinite(self.lat) and math.isfinite(self.lon)
        x, y = (round(self.lat * 1e7), round(self.lon * 1e7)) if placed else (0, 0)
        return Item(self.number, Frame.GLOBAL, *self.p, x, y, self.z)


@dataclass(slots=True)
class _Calibration:
    order: Order
    end_s: float
    told: int = 0


class CommandServer:
    """Executes commands and answers each one.

    Parameters
    ----------
    vehicle : Vehicle
        Which obeys.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.calibration: _Calibration | None = None
        c = Command
        self.table: dict[int, Callable[[Order], Result]] = {
            c.COMPONENT_ARM_DISARM: self._arm_disarm,
            c.TAKEOFF: self._take_off,
            c.LAND: lambda o: self._mode(o, Mode.LAND),
            c.RETURN_TO_LAUNCH: lambda o: self._mode(o, Mode.RTL),
            c.LOITER_UNLIM: lambda o: self._mode(o, self._pilot.LOITER_MODE),
            c.DO_SET_MODE: self._set_mode,
            c.MISSION_START: self._mission_start,
            c.DO_SET_MISSION_CURRENT: self._set_current,
            c.DO_PAUSE_CONTINUE: self._pause_continue,
            c.DO_REPOSITION: self._reposition,
            c.DO_CHANGE_SPEED: self._change_speed,
            c.DO_SET_HOME: self._set_home,
            c.DO_GRIPPER: self._gripper,
            c.DO_LAND_START: self._land_start,
            c.DO_FENCE_ENABLE: self._fence_enable,
            c.DO_FLIGHT_TERMINATION: self._terminate,
            c.CONDITION_YAW: self._yaw,
            c.BATTERY_RESET: self._battery_reset,
            c.PREFLIGHT_CALIBRATION: self._calibrate,
            c.PREFLIGHT_STORAGE: lambda _: Result.ACCEPTED,
            c.PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            c.RUN_PREARM_CHECKS: self._check,
            c.GET_HOME_POSITION: lambda o: self._send(o, 242),
            c.GET_MESSAGE_INTERVAL: self._get_interval,
            c.SET_MESSAGE_INTERVAL: self._set_interval,
            c.REQUEST_MESSAGE: lambda o: self._send(o, o.p[0]),
            c.REQUEST_PROTOCOL_VERSION: lambda o: self._send(o, 300),
            c.REQUEST_AUTOPILOT_CAPABILITIES: lambda o: self._send(o, 148),
        }

    @property
    def _pilot(self) -> Autopilot:
        return self.vehicle.autopilot

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "COMMAND_LONG": self.command_long,
            "COMMAND_INT": self.command_int,
            "COMMAND_CANCEL": self.cancel,
        }

    def command_long(self, port: Port, message: Message) -> None:
        """Execute a command whose place is in floats."""
        f = message.fields
        p = (f["param1"], f["param2"], f["param3"], f["param4"])
        relative = self._pilot.LONG_HEIGHTS_RELATIVE
        self._run(
            Order(
                f["command"],
                p,
                f["param5"],
                f["param6"],
                f["param7"],
                relative,
                port,
                message.system,
                message.component,
                as_int=False,
            )
        )

    def command_int(self, port: Port, message: Message) -> None:
        """Execute a command whose place is in integers."""
        f = message.fields
        p = (f["param1"], f["param2"], f["param3"], f["param4"])
        lat, lon = (math.nan if v == -(2**31) else v * 1e-7 for v in (f["x"], f["y"]))
        relative = f["frame"] in (Frame.RELATIVE, Frame.RELATIVE_INT)
        if f["frame"] not in (0, 2, 3, 5, 6):
            self._answer_to(port, message.system, message.component, f["command"], Result.DENIED)
            return
        self._run(
            Order(
                f["command"],
                p,
                lat,
                lon,
                f["z"],
                relative,
                port,
                message.system,
                message.component,
                as_int=True,
            )
        )

    def _run(self, order: Order) -> None:
        handler = None if order.number in self._pilot.UNSUPPORTED else self.table.get(order.number)
        result = Result.UNSUPPORTED if handler is None else handler(order)
        progress = 0
        if result == Result.IN_PROGRESS and self.calibration is not None:
            progress = self.calibration.told
        self._answer_to(order.port, order.system, order.component, order.number, result, progress)

    @staticmethod
    def _answer_to(port: Port, system: int, component: int, number: int, result: Result, progress: int = 0) -> None:
        port.reply(
            "COMMAND_ACK",
            command=number,
            result=int(result),
            progress=progress,
            target_system=system,
            target_component=component,
        )

    # Progress

    def _calibrate(self, order: Order) -> Result:
        """Take two seconds and tell the progress; asked again meanwhile, tell the progress again."""
        pilot = self._pilot
        if pilot.armed:
            return Result.TEMPORARILY_REJECTED
        if self.calibration is None:
            self.calibration = _Calibration(order, self.vehicle.wall_s + _CALIBRATION_S)
        return Result.IN_PROGRESS

    def next_wall_s(self) -> float:
        """When there is progress to tell."""
        calibration = self.calibration
        if calibration is None:
            return math.inf
        return calibration.end_s - _CALIBRATION_S * (1.0 - (calibration.told + 25) / 100.0)

    def tick(self) -> None:
        """Tell progress, and the end."""
        while self.calibration is not None and self.vehicle.wall_s >= self.next_wall_s():
            calibration, order = self.calibration, self.calibration.order
            calibration.told += 25
            done = calibration.told >= 100
            result = Result.ACCEPTED if done else Result.IN_PROGRESS
            if done:
                self.calibration = None
            self._answer_to(order.port, order.system, order.component, order.number, result, calibration.told)

    def cancel(self, port: Port, message: Message) -> None:  # noqa: ARG002
        """Cancel what takes long."""
        calibration = self.calibration
        if calibration is None or message["command"] != calibration.order.number:
            return
        self.calibration = None
        order = calibration.order
        self._answer_to(order.port, order.system, order.component, order.number, Result.CANCELLED)

    def forget(self) -> None:
        """Drop what is under way."""
        self.calibration = None

    # Flying

    def _arm_disarm(self, order: Order) -> Result:
        pilot = self._pilot
        force = order.p[1] in (_FORCE, _FORCE_OLD)
        if order.p[0] == 1.0:
            return pilot.arm(force=force, by=order.by)
        if order.p[0] == 0.0:
            return pilot.disarm(force=force, by=order.by)
        return Result.UNSUPPORTED

    def _take_off(self, order: Order) -> Result:
        return self._pilot.take_off(order.z, order.by)

    def _mode(self, order: Order, mode: Mode) -> Result:
        return self._pilot.request_mode(mode, order.by)

    def _set_mode(self, order: Order) -> Result:
        values = [int(v) if math.isfinite(v) and 0.0 <= v < 256.0 else -1 for v in order.p[:3]]
        if values[0] < 0 or values[1] < 0 or not values[0] & 1:
            return Result.DENIED
        mode = self._pilot.mode_of_command(values[1], max(values[2], 0))
        return self._pilot.BAD_VALUE if mode is None else self._pilot.request_mode(mode, order.by)

    def _mission_start(self, order: Order) -> Result:
        return self._pilot.start_mission(order.p[0], order.p[1], order.by)

    def _set_current(self, order: Order) -> Result:
        number = order.p[0]
        if not math.isfinite(number) or number < -1.0:
            return Result.DENIED
        if order.p[1] == 1.0:
            self._pilot.run.reset(self._pilot.run.current)
        if number >= 0.0 and not self.vehicle.set_mission_current(int(number)):
            return Result.FAILED
        self.vehicle.radio.tell_mission_current()
        return Result.ACCEPTED

    def _pause_continue(self, order: Order) -> Result:
        pilot = self._pilot
        if pilot.mode != Mode.MISSION:
            return Result.FAILED
        run = pilot.run
        if order.p[0] == 0.0:
            run.pause()
            pilot.event("mission paused")
            return Result.ACCEPTED
        if order.p[0] == 1.0:
            if run.state == MissionState.PAUSED:
                run.state = MissionState.ACTIVE
                pilot.event("mission continued")
            return Result.ACCEPTED
        return Result.DENIED

    def _reposition(self, order: Order) -> Result:
        pilot = self._pilot
        here = not (math.isfinite(order.lat) and math.isfinite(order.lon))
        if not here and (abs(order.lat) > 90.0 or abs(order.lon) > 180.0):
            return Result.DENIED
        refusal = pilot.reposition_refusal(here=here, as_int=order.as_int, flags=order.p[1])
        if refusal is not None:
            return refusal
        body = pilot.body
        height = body.alt_m
        if math.isfinite(order.z):
            height = order.z + (pilot.home_alt_m if order.relative else 0.0)
        result = pilot.request_mode(pilot.REPOSITION_MODE, order.by)
        if result == Result.ACCEPTED:
            if order.p[0] > 0.0:
                pilot.change_speed(order.p[0])
            lat, lon = (pilot.lat, pilot.lon) if here else (order.lat, order.lon)
            pilot.fly_to(lat, lon, max(-1000.0, min(height, 20_000.0)), pilot.reposition_yaw(order.p[3]))
        return result

    def _change_speed(self, order: Order) -> Result:
        pilot = self._pilot
        if order.p[1] == -1.0 and pilot.MINUS_ONE_RESETS_SPEED:
            pilot.commanded_mps = None
            return Result.ACCEPTED
        if order.p[0] not in (0.0, 1.0) or not pilot.change_speed(order.p[1]):
            return pilot.BAD_VALUE
        pilot.event(f"speed {pilot.cruise_mps:.1f} m/s ({order.by})")
        return Result.ACCEPTED

    def _set_home(self, order: Order) -> Result:
        pilot = self._pilot
        if order.p[0] == 1.0:
            pilot.set_home(Home(pilot.lat, pilot.lon, pilot.body.alt_m))
            return Result.ACCEPTED
        place = (order.lat, order.lon, order.z)
        if not all(map(math.isfinite, place)) or abs(order.lat) > 90.0 or abs(order.lon) > 180.0:
            return pilot.BAD_VALUE
        if not -1000.0 < order.z < 20_000.0:
            return pilot.BAD_VALUE
        pilot.set_home(Home(*place))
        return Result.ACCEPTED

    def _gripper(self, order: Order) -> Result:
        if order.p[1] not in (0.0, 1.0):
            return Result.DENIED
        moved = self._pilot.move_gripper(close=order.p[1] == 1.0)
        return Result.ACCEPTED if moved else Result.FAILED

    def _land_start(self, order: Order) -> Result:
        pilot = self._pilot
        marks = [n for n, i in enumerate(pilot.run.items) if i.command == Command.DO_LAND_START]
        if not marks or pilot.landed:
            return pilot.BAD_VALUE
        pilot.run.jump(marks[0])
        return pilot.request_mode(Mode.MISSION, order.by)

    def _fence_enable(self, order: Order) -> Result:
        if order.p[0] not in (0.0, 1.0):
            return Result.UNSUPPORTED
        self._pilot.parameters.set("FENCE_ENABLE", order.p[0])
        return Result.ACCEPTED

    def _terminate(self, order: Order) -> Result:
        if order.p[0] != 1.0:
            return Result.DENIED
        self._pilot.terminate()
        return Result.ACCEPTED

    def _yaw(self, order: Order) -> Result:
        self._pilot.execute(order.item())
        return Result.ACCEPTED

    # The vehicle itself

    def _battery_reset(self, order: Order) -> Result:
        """Set the count of the battery monitor."""
        percent = order.p[1]
        if not 0.0 <= percent <= 100.0:
            return Result.FAILED
        capacity = self._pilot.parameters.clamped("BATT_CAPACITY", 1.0, 1e6)
        self.vehicle.counted_mah = capacity * (1.0 - percent / 100.0)
        self._pilot.failsafes.battery_level = 0
        self.vehicle.event(f"battery counter set to {percent:g} %")
        return Result.ACCEPTED

    def _reboot(self, order: Order) -> Result:
        if self._pilot.armed:
            return self._pilot.ARM_REFUSED
        if order.p[0] not in (1.0, 3.0):
            return Result.DENIED
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
        message = specs()[0].get(whole)
        if message is None or whole not in BUILDERS:
            return None
        if FAMILY_ONLY.get(message.name, self._pilot.FAMILY) != self._pilot.FAMILY:
            return None
        return whole

    def _set_interval(self, order: Order) -> Result:
        number, interval_us = self._known(order.p[0]), order.p[1]
        if number is None or not math.isfinite(interval_us) or interval_us < _NO_INTERVAL:
            return self._pilot.BAD_VALUE
        self.vehicle.radio.set_interval(order.port, number, interval_us)
        return Result.ACCEPTED

    def _get_interval(self, order: Order) -> Result:
        number = self._known(order.p[0])
        if number is None:
            return Result.FAILED
        stream = order.port.streams.get(number)
        interval = -1 if stream is None else round(stream.interval_s * 1e6)
        order.port.reply("MESSAGE_INTERVAL", message_id=number, interval_us=interval)
        return Result.ACCEPTED

    def _send(self, order: Order, number: float) -> Result:
        if number == 148:
            self.vehicle.services.send_version(order.port)
            return Result.ACCEPTED
        if number == 300:
            self.vehicle.services.send_protocol_version(order.port)
            return Result.ACCEPTED
        known = self._known(number)
        if known is None:
            return self._pilot.UNKNOWN_MESSAGE
        payload = BUILDERS[known](self.vehicle)
        if payload is None:
            return Result.FAILED
        order.port.write(specs()[0][known], payload)
        return Result.ACCEPTED
