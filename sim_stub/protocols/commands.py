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
            c.LOITER_UNLIM: lambda o: self._mode(o, Mode.HOLD if self._px4 else Mode.POSITION),
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
    def _px4(self) -> bool:
        return self.vehicle.autopilot.FAMILY == "px4"

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
        relative = not self._px4  # of a COMMAND_LONG, PX4 takes heights as above sea level, ArduPilot as relative
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
        handler = self.table.get(order.number)
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
        pilot = self.vehicle.autopilot
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
        pilot = self.vehicle.autopilot
        force = order.p[1] in (_FORCE, _FORCE_OLD)
        if order.p[0] == 1.0:
            return pilot.arm(force=force, by=order.by)
        if order.p[0] == 0.0:
            return pilot.disarm(force=force, by=order.by)
        return Result.UNSUPPORTED

    def _take_off(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        if self._px4:
            if not pilot.landed:
                return Result.TEMPORARILY_REJECTED
            result = pilot.request_mode(Mode.TAKEOFF, order.by)
            if result == Result.ACCEPTED and math.isfinite(order.z) and order.z > pilot.body.alt_m:
                pilot.behaviour = pilot.take_off_behaviour(order.z)
            return result
        if pilot.mode != Mode.GUIDED or not pilot.armed or not pilot.landed:
            return Result.FAILED
        if not math.isfinite(order.z) or not 0.0 < order.z <= 1000.0:
            return Result.FAILED
        pilot.behaviour = pilot.take_off_behaviour(pilot.home_alt_m + order.z)
        pilot.event(f"take-off to {order.z:g} m ({order.by})")
        return Result.ACCEPTED

    def _mode(self, order: Order, mode: Mode) -> Result:
        return self.vehicle.autopilot.request_mode(mode, order.by)

    def _set_mode(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        values = [v if math.isfinite(v) and 0.0 <= v < 256.0 else -1.0 for v in order.p[:3]]
        if values[0] < 0.0 or values[1] < 0.0 or not int(values[0]) & 1:
            return Result.DENIED
        custom = int(values[1])
        if self._px4:
            custom = int(values[1]) << 16 | int(max(values[2], 0.0)) << 24
        mode = pilot.mode_of(custom)
        if mode is None:
            return Result.DENIED if self._px4 else Result.FAILED
        return pilot.request_mode(mode, order.by)

    def _mission_start(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        start = getattr(pilot, "start_mission", None)
        if start is not None:
            if order.p[0] or order.p[1]:
                return Result.DENIED
            result: Result = start()
            return result
        if pilot.mode_refusal(Mode.MISSION) is not None:
            pilot.say(3, pilot.mode_refusal(Mode.MISSION) or "")
            return Result.DENIED
        if math.isfinite(order.p[0]) and 0.0 <= order.p[0] < len(pilot.run.items):
            pilot.run.jump(int(order.p[0]))
        return pilot.request_mode(Mode.MISSION, order.by)

    def _set_current(self, order: Order) -> Result:
        if self._px4:
            return Result.UNSUPPORTED
        number = order.p[0]
        if not math.isfinite(number) or number < -1.0:
            return Result.DENIED
        if order.p[1] == 1.0:
            self.vehicle.autopilot.run.reset(self.vehicle.autopilot.run.current)
        if number >= 0.0 and not self.vehicle.set_mission_current(int(number)):
            return Result.FAILED
        self.vehicle.broadcast_mission_current()
        return Result.ACCEPTED

    def _pause_continue(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        if self._px4:
            return Result.UNSUPPORTED
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
        pilot = self.vehicle.autopilot
        here = not (math.isfinite(order.lat) and math.isfinite(order.lon))
        if not here and (abs(order.lat) > 90.0 or abs(order.lon) > 180.0):
            return Result.DENIED
        if not pilot.armed or pilot.landed:
            return Result.FAILED if not self._px4 else Result.TEMPORARILY_REJECTED
        if not self._px4:
            if not order.as_int or here:
                return Result.UNSUPPORTED if not order.as_int else Result.DENIED
            if pilot.mode != Mode.GUIDED and not int(max(order.p[1], 0.0)) & 1:
                return Result.DENIED
        body = pilot.body
        height = body.alt_m
        if math.isfinite(order.z):
            height = order.z + (pilot.home_alt_m if order.relative else 0.0)
        result = pilot.request_mode(Mode.HOLD if self._px4 else Mode.GUIDED, order.by)
        if result == Result.ACCEPTED:
            if order.p[0] > 0.0:
                pilot.change_speed(order.p[0])
            lat, lon = (body.lat, body.lon) if here else (order.lat, order.lon)
            height = max(-1000.0, min(height, 20_000.0))
            yaw = order.p[3] if math.isfinite(order.p[3]) and self._px4 else None
            pilot.fly_to(lat, lon, height, yaw)
        return result

    def _change_speed(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        if order.p[1] == -1.0 and self._px4:
            pilot.commanded_mps = None
            return Result.ACCEPTED
        kind = order.p[0]
        if kind not in (0.0, 1.0) or not pilot.change_speed(order.p[1]):
            return Result.DENIED if self._px4 else Result.FAILED
        pilot.event(f"speed {pilot.cruise_mps:.1f} m/s ({order.by})")
        return Result.ACCEPTED

    def _set_home(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        if order.p[0] == 1.0:
            pilot.set_home(Home(pilot.body.lat, pilot.body.lon, pilot.body.alt_m))
            return Result.ACCEPTED
        place = (order.lat, order.lon, order.z)
        if not all(map(math.isfinite, place)) or abs(order.lat) > 90.0 or abs(order.lon) > 180.0:
            return Result.DENIED if self._px4 else Result.FAILED
        if not -1000.0 < order.z < 20_000.0:
            return Result.DENIED if self._px4 else Result.FAILED
        pilot.set_home(Home(*place))
        return Result.ACCEPTED

    def _gripper(self, order: Order) -> Result:
        if order.p[1] not in (0.0, 1.0):
            return Result.DENIED
        moved = self.vehicle.autopilot.move_gripper(close=order.p[1] == 1.0)
        return Result.ACCEPTED if moved else Result.FAILED

    def _land_start(self, order: Order) -> Result:
        pilot = self.vehicle.autopilot
        marks = [n for n, i in enumerate(pilot.run.items) if i.command == Command.DO_LAND_START]
        if not marks or pilot.landed:
            return Result.DENIED if self._px4 else Result.FAILED
        pilot.run.jump(marks[0])
        return pilot.request_mode(Mode.MISSION, order.by)

    def _fence_enable(self, order: Order) -> Result:
        if self._px4 or order.p[0] not in (0.0, 1.0):
            return Result.UNSUPPORTED
        self.vehicle.autopilot.parameters.set("FENCE_ENABLE", order.p[0])
        return Result.ACCEPTED

    def _terminate(self, order: Order) -> Result:
        if order.p[0] != 1.0:
            return Result.DENIED
        self.vehicle.autopilot.terminate()
        return Result.ACCEPTED

    def _yaw(self, order: Order) -> Result:
        if self._px4:
            return Result.UNSUPPORTED
        self.vehicle.autopilot.execute(order.item())
        return Result.ACCEPTED

    # The vehicle itself

    def _battery_reset(self, order: Order) -> Result:
        """Set the count of ArduPilot's battery monitor; PX4 knows no such command."""
        if self._px4:
            return Result.UNSUPPORTED
        percent = order.p[1]
        if not 0.0 <= percent <= 100.0:
            return Result.FAILED
        capacity = self.vehicle.autopilot.parameters.clamped("BATT_CAPACITY", 1.0, 1e6)
        self.vehicle.counted_mah = capacity * (1.0 - percent / 100.0)
        self.vehicle.autopilot.failsafes.battery_level = 0
        self.vehicle.event(f"battery counter set to {percent:g} %")
        return Result.ACCEPTED

    def _reboot(self, order: Order) -> Result:
        if self.vehicle.autopilot.armed:
            return Result.FAILED if not self._px4 else Result.TEMPORARILY_REJECTED
        if order.p[0] not in (1.0, 3.0):
            return Result.DENIED
        self.vehicle.reboot_soon()
        return Result.ACCEPTED

    def _check(self, order: Order) -> Result:  # noqa: ARG002
        pilot = self.vehicle.autopilot
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
        if FAMILY_ONLY.get(message.name, self.vehicle.autopilot.FAMILY) != self.vehicle.autopilot.FAMILY:
            return None
        return whole

    def _set_interval(self, order: Order) -> Result:
        number, interval_us = self._known(order.p[0]), order.p[1]
        if number is None or not math.isfinite(interval_us) or interval_us < _NO_INTERVAL:
            return Result.FAILED if not self._px4 else Result.DENIED
        self.vehicle.set_interval(order.port, number, interval_us)
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
            return Result.UNSUPPORTED if not self._px4 else Result.DENIED
        payload = BUILDERS[known](self.vehicle)
        if payload is None:
            return Result.FAILED
        order.port.write(specs()[0][known], payload)
        return Result.ACCEPTED
