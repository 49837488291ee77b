"""An autopilot family that does not exist: what a new one consists of, on the ground and in the simulator.

It has mode numbers and parameters of its own; whole numbers travel as bytes, as with PX4; items count from 1, as with ArduPilot.
"""

from __future__ import annotations

from dataclasses import replace

from skyway.missions.autopilots.failsafes import Failsafes, LinkLoss
from skyway.missions.autopilots.family import Family
from skyway.missions.autopilots.modes import Modes
from skyway.missions.autopilots.settings import Name, Setting, Settings
from skyway.missions.autopilots.wire import from_wire, to_wire
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.finding import Finding
from skyway.missions.items.mission import Mission, MissionItem
from skyway.sim_stub.autopilot.ardupilot.ardupilot import ArduPilot
from skyway.sim_stub.autopilot.modes import Mode

NAME = "invented"
FIRMWARE = 200
"""A MAV_AUTOPILOT that nobody has."""
NUMBERS = {"hold": 11, "mission": 12, "return": 13, "land": 14, "position": 15, "guided": 17}
SIMULATED = {
    Mode.STABILIZE: 10,
    Mode.HOLD: 11,
    Mode.BRAKE: 11,
    Mode.MISSION: 12,
    Mode.RTL: 13,
    Mode.LAND: 14,
    Mode.POSITION: 15,
    Mode.GUIDED: 17,
}
SIMULATED_NUMBERS = {number: mode for mode, number in SIMULATED.items()}
HOME = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, x=0, y=0)


class InventedFailsafes(Failsafes):
    def battery(self, values):
        return [f"battery low: it {self.action('low-battery-action', {1: 'lands'}, values)}"]

    def battery_first(self, values):
        return self.battery(values)[0]


SETTINGS = Settings(
    (
        Setting("mission-speed", "ground speed of missions", (Name("INV_SPEED", "cm/s"),)),
        Setting("link-action", "what it does without us", (Name("INV_LINK"),)),
        Setting("low-battery-action", "what it does at low battery", (Name("INV_BATT"),)),
    )
)
LOSS = LinkLoss("link-action", "link-action", 2, {1: "lands"})


class Invented(Family):
    name = NAME
    firmware = FIRMWARE
    home_items = 1
    stays_in_mission_after_landing = True
    zero_means_as_it_is = False
    open_yaw_deg = 0.0
    settings = SETTINGS
    firmwares = ("1.0",)
    released = "1.0"
    modes = Modes(
        NUMBERS,
        {number: name for name, number in NUMBERS.items()},
        lambda n: (float(n),),
        lambda _, n: None,
    )
    failsafes = InventedFailsafes(SETTINGS, ("link-action", "low-battery-action"), LOSS, LOSS)
    arms_in = "guided"
    pauses_in_mission = False
    bytewise_parameters = True
    takes_uploads_whole = False

    def to_wire(self, mission, *, current=0):
        items = (replace(item, param4=0.0) for item in mission.items)
        return (
            to_wire(HOME, 0),
            *(to_wire(item, n, shift=1, current=int(n == current)) for n, item in enumerate(items)),
        )

    def from_wire(self, items):
        return Mission(tuple(from_wire(item) for item in items[1:]), firmware=self.firmware)

    def meaning(self, item):
        return {"command": item.name, "x": item.x or 0, "y": item.y or 0, "z": round(item.z, 2)}

    def disarm(self):
        return ()

    def leave_armed_hold(self, above):
        return (above,)

    def cannot_fly(self, document):
        for number, item in enumerate(document.mission.items):
            if item.command == Command.DO_JUMP:
                yield Finding("error", number, "invented-no-jump", "it does not jump", "fly on")

    def parameters(self, needs):
        return (SETTINGS["mission-speed"].need("at-least", needs.ground_speed_mps, "it is slow by default"),)


class SimulatedInvented(ArduPilot):
    AUTOPILOT_ID = FIRMWARE
    FIRMWARES = ("1.0",)
    USUAL_FIRMWARE = "1.0"
    BYTEWISE = True
    MODES = SIMULATED
    MODE_NUMBERS = SIMULATED_NUMBERS
