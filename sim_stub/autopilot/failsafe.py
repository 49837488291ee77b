"""Failsafes: what a vehicle does on low battery, lost link, lost position or breached fence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.modes import ACTION_MODES, Action, Mode

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot

_LEVELS = ("ok", "low", "critical", "emergency")


@dataclass(slots=True)
class Failsafes:
    """State of the failsafes of one vehicle."""

    battery_level: int = 0
    """0 fine, 1 low, 2 critical, 3 emergency; never falls while armed."""
    active: dict[str, Action] = field(default_factory=dict)
    """Failsafes in force with the action taken."""
    position_lost_s: float | None = None
    breaches: int = 0

    def reset(self) -> None:
        """Start again, as after a reboot or on arming."""
        self.battery_level = 0
        self.active.clear()
        self.position_lost_s = None

    def check(self, pilot: Autopilot) -> None:
        """Look at everything once."""
        self._battery(pilot)
        self._link(pilot)
        self._remote_control(pilot)
        if pilot.armed:
            self._position(pilot)
            self._fence(pilot)

    def _battery(self, pilot: Autopilot) -> None:
        level = pilot.battery_level()
        if level <= self.battery_level:
            return
        self.battery_level = level
        pilot.event(f"battery {_LEVELS[level]}: {pilot.reported_percent()} %")
        pilot.battery_warning(level)
        self._act(pilot, f"battery {_LEVELS[level]}", pilot.battery_action(level))

    def _link(self, pilot: Autopilot) -> None:
        heard = pilot.ground_heard_s()
        if heard is None:
            return
        lost = pilot.sim_s - heard > pilot.parameters.clamped(*pilot.LINK_TIMEOUT)
        if lost and "link" not in self.active:
            self.active["link"] = Action.NONE
            pilot.link_warning(lost=True)
            self._act(pilot, "link", pilot.link_action())
        elif not lost and "link" in self.active:
            del self.active["link"]
            pilot.link_warning(lost=False)

    def _remote_control(self, pilot: Autopilot) -> None:
        lost = "rc-loss" in pilot.vehicle.faults.active
        if lost and "remote control" not in self.active:
            self.active["remote control"] = Action.NONE
            pilot.say(4, pilot.REMOTE_CONTROL_LOST)
            self._act(pilot, "remote control", pilot.remote_control_action())
        elif not lost and "remote control" in self.active:
            del self.active["remote control"]

    def _position(self, pilot: Autopilot) -> None:
        if pilot.position_known:
            self.position_lost_s = None
            self.active.pop("position", None)
            return
        if self.position_lost_s is None:
            self.position_lost_s = pilot.sim_s
        if "position" not in self.active and pilot.sim_s - self.position_lost_s >= pilot.position_delay_s():
            self.active["position"] = Action.LAND
            pilot.say(2, pilot.POSITION_LOST)
            self._act(pilot, "position", Action.LAND)

    def _fence(self, pilot: Autopilot) -> None:
        breached = pilot.position_known and not pilot.landed and pilot.fence_breached
        if breached and "fence" not in self.active:
            self.active["fence"] = Action.NONE
            self.breaches += 1
            pilot.say(4, pilot.FENCE_BREACHED)
            self._act(pilot, "fence", pilot.fence_action())
        elif not breached and "fence" in self.active:
            del self.active["fence"]

    def _act(self, pilot: Autopilot, name: str, action: Action) -> None:
        """Do it, unless something as grave is being done already."""
        self.active[name] = action
        if action == Action.NONE:
            return
        pilot.event(f"failsafe {name}: {action.name.lower()}")
        if not pilot.armed or action == Action.WARN:
            return
        if pilot.landed:
            pilot.failsafe_on_ground(name)
            return
        if action == Action.TERMINATE:
            pilot.terminate()
            return
        busy = {Mode.LAND: Action.LAND, Mode.RTL: Action.RTL}.get(pilot.mode, Action.NONE)
        if busy.value >= action.value:
            return
        pilot.switch(ACTION_MODES[action], reason=f"{name} failsafe")
