"""Effects of faults on a vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.modes import Mode

if TYPE_CHECKING:
    from skyway.sim_stub.faults import Fault
    from skyway.sim_stub.vehicle import Vehicle


def change(vehicle: Vehicle, now_s: float) -> None:
    """Bring a vehicle's faults up to an instant at which one begins or ends."""
    faults = vehicle.faults
    before = set(faults.active)
    for fault in faults.update(now_s):
        vehicle.event(f"fault {fault.kind} begins")
        _begin(vehicle, fault)
    for kind in sorted(before - set(faults.active)):
        vehicle.event(f"fault {kind} ends")
    vehicle.battery.resistance_ohm = vehicle.battery.nominal_ohm * faults.value("battery-sag", 1.0)
    vehicle.battery.capacity_j = vehicle.airframe.drone.battery_j * faults.value("battery-weak", 1.0)
    vehicle.radio.mute(muted="link-loss" in faults.active)
    locate(vehicle)


def _begin(vehicle: Vehicle, fault: Fault) -> None:
    """Do what a fault does once."""
    match fault.kind:
        case "battery-drop":
            vehicle.battery.soc = max(0.0, vehicle.battery.soc - fault.value)
        case "package-lost":
            vehicle.autopilot.let_go(fault.value)
        case "battery-swap" if vehicle.active:
            vehicle.event("no battery is swapped: the motors are on")
        case "battery-swap":
            vehicle.swap_battery(fault.value)
        case "reboot":
            vehicle.reboot_at_s = vehicle.sim_s
        case "pilot":
            vehicle.autopilot.switch(Mode(fault.word), reason="the pilot")
        case _:
            pass  # acts for as long as it is active


def locate(vehicle: Vehicle) -> None:
    """Let fix and estimate agree or not, and say so as the family does."""
    position, texts = vehicle.position, vehicle.autopilot.GLITCH_TEXTS
    was = position.glitching
    if position.update(vehicle.faults.value("gps-glitch"), vehicle.sim_s):
        off = f"is {position.fix_m:g} m off" if position.fix_m else "is true again"
        vehicle.event(f"the position estimate {off}")
    if texts is not None and was != position.glitching:
        vehicle.radio.say(2, texts[0] if position.glitching else texts[1])
