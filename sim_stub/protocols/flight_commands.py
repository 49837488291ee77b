"""Flight commands: arming, modes, missions, reposition, speed, gripper."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.formatting import speed_text
from skyway.sim_stub.autopilot.items import Command, Home, Result
from skyway.sim_stub.autopilot.mission_run import MissionState
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.protocols.orders import CommandGroup

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.protocols.orders import Order

_RELEASE, _GRAB = 0.0, 1.0


class FlightCommands(CommandGroup):
    """Those commands."""

    def table(self) -> dict[int, Callable[[Order], Result]]:
        """Handlers by command."""
        c = Command
        return {
            c.COMPONENT_ARM_DISARM: self._arm_disarm,
            c.TAKEOFF: lambda o: self._pilot.take_off(o.z, o.by),
            c.LAND: lambda o: self._pilot.request_mode(Mode.LAND, o.by),
            c.RETURN_TO_LAUNCH: lambda o: self._pilot.request_mode(Mode.RTL, o.by),
            c.LOITER_UNLIM: lambda o: self._pilot.request_mode(self._pilot.LOITER_MODE, o.by),
            c.DO_SET_MODE: self._set_mode,
            c.MISSION_START: lambda o: self._pilot.start_mission(o.p[0], o.p[1], o.by),
            c.DO_SET_MISSION_CURRENT: self._set_current,
            c.DO_PAUSE_CONTINUE: self._pause_continue,
            c.DO_REPOSITION: self._reposition,
            c.DO_CHANGE_SPEED: self._change_speed,
            c.DO_SET_HOME: self._set_home,
            c.DO_GRIPPER: self._gripper,
            c.DO_WINCH: self._winch,
            c.DO_LAND_START: self._land_start,
            c.DO_FENCE_ENABLE: self._fence_enable,
            c.DO_FLIGHT_TERMINATION: self._terminate,
            c.CONDITION_YAW: self._yaw,
        }

    def _arm_disarm(self, order: Order) -> Result:
        pilot = self._pilot
        if order.p[0] == 1.0:
            return pilot.arm(force=order.p[1] == pilot.FORCES_ARMING, by=order.by)
        if order.p[0] == 0.0:
            return pilot.disarm(force=order.p[1] == pilot.FORCES_DISARMING, by=order.by)
        return Result.UNSUPPORTED

    def _set_mode(self, order: Order) -> Result:
        values = [int(v) if math.isfinite(v) and 0.0 <= v < 256.0 else -1 for v in order.p[:3]]
        if min(values[:2]) < 0:
            return Result.DENIED
        return self._pilot.set_mode(values[0], values[1], max(values[2], 0), order.by)

    def _set_current(self, order: Order) -> Result:
        """Make an item the current one (-1: leave it), and with p2 forget how often jumps were taken."""
        number, again = order.p[0], order.p[1]
        if not math.isfinite(number) or number < -1.0 or again not in (0.0, 1.0):
            return Result.DENIED
        run = self._pilot.run
        if not run.items:
            return Result.FAILED
        if number >= 0.0 and not self.vehicle.set_mission_current(int(number)):
            return Result.FAILED
        if again == 1.0:
            run.begin_again()
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
        if order.placed and (abs(order.lat) > 90.0 or abs(order.lon) > 180.0):
            return Result.DENIED
        refusal = pilot.reposition_refusal(here=not order.placed, as_int=order.as_int, flags=order.p[1])
        if refusal is not None:
            return refusal
        body = pilot.body
        height = body.alt_m
        if math.isfinite(order.z):
            height = order.z + (pilot.home_alt_m if order.relative else 0.0)
        lat, lon = (order.lat, order.lon) if order.placed else (pilot.lat, pilot.lon)
        height = max(-1000.0, min(height, 20_000.0))
        barred = pilot.outside_fence(lat, lon, height)
        if barred not in (None, Result.ACCEPTED):
            return barred
        result = pilot.request_mode(pilot.REPOSITION_MODE, order.by)
        if result == Result.ACCEPTED and barred is None and pilot.armed and not pilot.landed:
            if order.p[0] > 0.0:
                pilot.change_speed(order.p[0])
            yaw = order.p[3] if pilot.KEEPS_HEADINGS and math.isfinite(order.p[3]) else None
            pilot.fly_to(lat, lon, height, yaw)
        return result

    def _change_speed(self, order: Order) -> Result:
        pilot = self._pilot
        result = pilot.speed_command(order.p[0], order.p[1])
        if result == Result.ACCEPTED:
            pilot.event(f"speed {speed_text(pilot.cruise_mps)} ({order.by})")
        return result

    def _set_home(self, order: Order) -> Result:
        pilot = self._pilot
        if order.p[0] == 1.0:
            pilot.set_home(pilot.here)
            return Result.ACCEPTED
        if not order.placed or abs(order.lat) > 90.0 or abs(order.lon) > 180.0:
            return pilot.BAD_VALUE
        if not math.isfinite(order.z) or not -1000.0 < order.z < 20_000.0:
            return pilot.BAD_VALUE
        pilot.set_home(Home(order.lat, order.lon, order.z))
        return Result.ACCEPTED

    def _gripper(self, order: Order) -> Result:
        """Open or close at once, or as long as PX4 takes: it says so, and again when it is done."""
        pilot, wanted = self._pilot, order.p[1]
        if wanted not in (_RELEASE, _GRAB):
            return Result.DENIED
        lasts_s = pilot.gripper_s()
        if not pilot.has_gripper or lasts_s <= 0.0:
            return Result.ACCEPTED if pilot.move_gripper(close=wanted == _GRAB) else Result.FAILED
        under_way = self.server.tasks.get(order.number)
        if under_way is not None and under_way.order.p[1] == wanted:
            return Result.TEMPORARILY_REJECTED
        self.server.drop(order.number)
        if pilot.gripper_closed == (wanted == _GRAB):
            return Result.ACCEPTED

        def done() -> Result:
            pilot.move_gripper(close=wanted == _GRAB)
            return Result.ACCEPTED

        return self.server.begin(order, lasts_s, done, tells=False)

    def _winch(self, order: Order) -> Result:
        """Move the winch: acknowledged when it begins."""
        return Result.ACCEPTED if self._pilot.move_winch(*order.p[1:4]) else Result.FAILED

    def _land_start(self, order: Order) -> Result:
        pilot = self._pilot
        marks = [n for n, i in enumerate(pilot.run.items) if i.command == Command.DO_LAND_START]
        if not marks or pilot.landed:
            return pilot.NO_LAND_START
        pilot.run.jump(marks[0])
        return pilot.request_mode(Mode.MISSION, order.by)

    def _fence_enable(self, order: Order) -> Result:
        if order.p[0] not in (0.0, 1.0):
            return Result.UNSUPPORTED
        self._pilot.parameters.set(self._pilot.FENCE_SWITCH, order.p[0])
        return Result.ACCEPTED

    def _terminate(self, order: Order) -> Result:
        if not order.p[0] > 0.5 or not self._pilot.armed:
            return self._pilot.BAD_VALUE
        self._pilot.terminate()
        return Result.ACCEPTED

    def _yaw(self, order: Order) -> Result:
        self._pilot.execute(order.item())
        return Result.ACCEPTED
