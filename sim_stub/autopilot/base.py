"""Behaviour shared by both autopilot families: arming, modes, missions, landing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.formatting import speed_text
from skyway.sim_stub.autopilot.behaviours import Behaviour, Climb, Fly, Idle, Land, ReturnHome
from skyway.sim_stub.autopilot.failsafe import Failsafes
from skyway.sim_stub.autopilot.family import Family
from skyway.sim_stub.autopilot.fence import Fence
from skyway.sim_stub.autopilot.items import FENCE, MISSION, RALLY, Command, Home, Item, Result
from skyway.sim_stub.autopilot.mission_run import MissionRun
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.plant.physics import Demand, metres_per_degree, offset_m

if TYPE_CHECKING:
    from skyway.sim_stub.plant.physics import Body
    from skyway.sim_stub.vehicle import Vehicle

LOOK_S = 0.1
"""Failsafes and parameters are looked at ten times a second, as the autopilots do."""
_LANDED_AFTER_S = 1.0
_CRASH_MPS = 4.0
_BRAKING_MPS2 = 1.6
_YAW_REACHED_DEG = 2.0


class Autopilot(Family):
    """One autopilot."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.parameters = self.default_parameters(vehicle.config.version)
        self.run = MissionRun()
        self.stores: dict[int, list[Item]] = {MISSION: self.run.items, FENCE: [], RALLY: []}
        self.fence = Fence()
        self.failsafes = Failsafes()
        self.mode = Mode.HOLD
        self.behaviour: Behaviour = Idle()
        self.armed = False
        self.armed_s = 0.0
        self.flown = False
        self.landed = True
        self.grounded_s: float | None = 0.0
        self.crashed = False
        self.terminated = False
        self.gripper_closed = True
        self.package_let_go = False
        self.commanded_mps: float | None = None
        self.commanded_up_mps: float | None = None
        self.commanded_down_mps: float | None = None
        self.yaw_override_deg: float | None = None
        self.home: Home | None = None
        self.infeasible: str | None = None
        self._read_parameters()
        self._look_s = -math.inf

    # What the behaviours ask

    @property
    def body(self) -> Body:
        """The airframe."""
        return self.vehicle.body

    @property
    def lat(self) -> float:
        """Latitude by its own estimate, degrees."""
        return self.vehicle.position.lat

    @property
    def lon(self) -> float:
        """Longitude by its own estimate, degrees."""
        return self.vehicle.position.lon

    @property
    def sim_s(self) -> float:
        """Simulated time."""
        return self.vehicle.sim_s

    def clock_of_day_s(self) -> float:
        """Its POSIX time in seconds; simulated."""
        return self.vehicle.posix_s

    @property
    def ground_m(self) -> float:
        """Height of the ground below, above mean sea level."""
        return self.vehicle.ground_m

    @property
    def position_known(self) -> bool:
        """Whether there is a position to hold."""
        return self.vehicle.faults.positioning

    @property
    def ready(self) -> bool:
        """Whether the estimator has converged and gives a position."""
        return self.vehicle.since_boot_s >= self.READY_AFTER_S and self.position_known

    def wind_estimate(self) -> tuple[float, float] | None:
        """(north, east) towards as its own estimator has it; None where that is off."""
        return self.vehicle.felt_wind() if self.estimates_wind and not self.landed else None

    @property
    def cruise_mps(self) -> float:
        """Ground speed in force: the last commanded one, clipped to the parameters' limit."""
        speeds = self.speeds
        wanted = speeds.cruise_mps if self.commanded_mps is None else self.commanded_mps
        return max(0.5, min(wanted, speeds.most_mps))

    @property
    def home_alt_m(self) -> float:
        """Height that relative heights count from."""
        return self.home.alt_m if self.home else self.body.alt_m

    def hover_here(self) -> Fly:
        """Hold the place where braking ends."""
        body = self.body
        north_scale, east_scale = metres_per_degree(self.lat)
        braking_s = body.ground_speed_mps / (2.0 * _BRAKING_MPS2) + 0.6
        lat = self.lat + body.north_mps * braking_s / north_scale
        lon = self.lon + body.east_mps * braking_s / east_scale
        return Fly(lat, lon, body.alt_m + 0.5 * body.up_mps, 1.0, math.inf, math.degrees(body.yaw))

    def safe_place(self, reach_m: float, *, home_counts: bool) -> tuple[float, float]:
        """Place to return to, degrees: the nearest rally point within range, or home where that counts and is no farther."""

        def away_m(place: tuple[float, float]) -> float:
            return math.hypot(*offset_m(self.lat, self.lon, *place))

        home = (self.home.lat, self.home.lon) if self.home else (self.lat, self.lon)
        points = [(item.lat, item.lon) for item in self.stores[RALLY] if item.command == Command.RALLY_POINT]
        rally = min(points, key=away_m, default=home)
        return rally if away_m(rally) <= reach_m and not (home_counts and away_m(home) <= away_m(rally)) else home

    def event(self, text: str) -> None:
        """Record an event in the log of the world."""
        self.vehicle.event(text)

    def say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT to every ground station."""
        self.vehicle.radio.say(severity, text)

    # Stepping

    def step(self) -> Demand:
        """Decide what to ask of the airframe in this step of physics."""
        if self.sim_s >= self._look_s:
            self._look_s = self.sim_s + LOOK_S - 1e-6
            if self._parameters_of != (self.parameters, self.parameters.changes):
                self._read_parameters()
            self.failsafes.check(self)
        if self.terminated or not self.armed:
            return Demand(motors=False)
        if self.vehicle.battery.empty:
            self.say(0, "Battery empty")
            self.event("battery empty: the motors stop")
            self.terminated = True
            return Demand(motors=False)
        if self.mode == Mode.MISSION:
            demand = self.run.step(self) if self.mission_may_run() else Demand(up_mps=-0.1)
        else:
            demand = self.behaviour.step(self)
            if self.behaviour.done:
                self._behaviour_done()
        if self.yaw_override_deg is not None:
            demand.yaw_deg = self.yaw_override_deg
        demand.max_lean_deg = self._lean_deg
        return demand

    def _read_parameters(self) -> None:
        """Read the parameters that are needed in every step."""
        self._parameters_of = self.parameters, self.parameters.changes
        self.speeds, self._lean_deg = self.read_speeds(), self.max_lean_deg()

    def after_step(self) -> None:
        """Notice what the step of physics has brought about: touch-down, a crash, the time to disarm."""
        body = self.body
        if not body.grounded:
            if self.landed:
                self.landed = False
                self.flown = True
                self.event("in the air")
                self.vehicle.faults.took_off(self.sim_s)
            self.grounded_s = None
            return
        if body.impact_mps > _CRASH_MPS and not self.landed:
            self._crash(body.impact_mps)
        body.impact_mps = 0.0
        if self.grounded_s is None:
            self.grounded_s = self.sim_s
        if not self.landed and self.sim_s - self.grounded_s >= _LANDED_AFTER_S:
            self.landed = True
            self.event(f"landed {self.vehicle.place()}")
            self.touched_down()
        if self.armed and self.landed:
            self.disarm_on_ground()

    def _crash(self, impact_mps: float) -> None:
        self.crashed = True
        self.armed = False
        self.landed = True
        self.say(0, "Crash: Disarming")
        self.event(f"crashed at {speed_text(impact_mps)} {self.vehicle.place()}")

    def _behaviour_done(self) -> None:
        if self.mode == Mode.TAKEOFF:
            self.switch(Mode.HOLD, reason="take-off done")
        elif isinstance(self.behaviour, Climb):
            self.behaviour = self.hover_here()
        elif isinstance(self.behaviour, (Land, ReturnHome)):
            self.behaviour = Idle()

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.landed:
            return 1
        behaviour = self.run.behaviour if self.mode == Mode.MISSION else self.behaviour
        if isinstance(behaviour, ReturnHome) and behaviour.stage is not None:
            behaviour = behaviour.stage
        if isinstance(behaviour, Climb):
            return 3
        return 4 if isinstance(behaviour, Land) and behaviour.arrived else 2

    # Modes

    def custom_mode(self) -> int:
        """custom_mode of HEARTBEAT."""
        return self.MODES.get(self.mode, self.MODES[Mode.HOLD])

    def request_mode(self, mode: Mode, by: str) -> Result:
        """Switch the mode if it can be entered."""
        reason = self.mode_refusal(mode)
        if reason is not None:
            self.say(3, reason)
            self.event(f"mode {mode.value} refused: {reason}")
            return self.MODE_REFUSED
        self.switch(mode, reason=by)
        return Result.ACCEPTED

    def switch(self, mode: Mode, *, reason: str) -> None:
        """Enter a mode."""
        if mode == self.mode and mode == Mode.MISSION:
            return
        if self.mode == Mode.MISSION:
            self.run.pause()
        if mode != self.mode:
            self.event(f"mode {mode.value} ({reason})")
        self.mode = mode
        self.yaw_override_deg = None
        self.behaviour = self._entering(mode)
        if mode == Mode.MISSION:
            self.entered_mission()

    def _entering(self, mode: Mode) -> Behaviour:
        if mode == Mode.LAND:
            return Land()
        if mode == Mode.RTL:
            return self.return_home()
        if mode == Mode.TAKEOFF:
            return self.take_off_behaviour(None)
        return Idle() if self.body.grounded else self.hover_here()

    def take_off_behaviour(self, alt_m: float | None) -> Climb:
        """Climb to a height above mean sea level, or to the default one."""
        height = self.body.alt_m + self.default_takeoff_m() if alt_m is None else alt_m
        return Climb(self.lat, self.lon, height)

    def fly_to(self, lat: float, lon: float, alt_m: float, yaw_deg: float | None) -> None:
        """Go to a place and stay there, in the mode the vehicle is in."""
        self.behaviour = Fly(lat, lon, alt_m, 1.0, math.inf, yaw_deg)

    # Arming

    def arm(self, *, force: bool, by: str) -> Result:
        """Arm, or say why not."""
        if self.armed:
            return Result.ACCEPTED
        reasons = ["vehicle has crashed"] if self.crashed else []
        if not force:
            reasons += self.arming_refusals()
        if reasons:
            for reason in reasons:
                self.say(2, f"{self.ARM_PREFIX}{reason}")
            self.event(f"arming refused: {'; '.join(reasons)}")
            return self.ARM_REFUSED
        self.armed = True
        self.armed_s = self.sim_s
        self.flown = False
        self.grounded_s = self.sim_s
        self.terminated = False
        self.commanded_mps = self.commanded_up_mps = self.commanded_down_mps = None
        self.failsafes.reset()
        self.set_home(self.here)
        if self.mode != Mode.MISSION:
            self.behaviour = self.take_off_behaviour(None) if self.mode == Mode.TAKEOFF else Idle()
        self.event(f"armed ({by})")
        self.say(6, self.ARMED_TEXT)
        self.has_armed()
        return Result.ACCEPTED

    def disarm(self, *, force: bool, by: str) -> Result:
        """Disarm; in the air only when forced, and then it falls."""
        if not self.armed:
            return Result.ACCEPTED
        if not self.landed and not force:
            self.say(2, self.DISARM_DENIED)
            return self.ARM_REFUSED
        self.armed = False
        self.event(f"disarmed ({by})")
        self.say(6, self.DISARMED_TEXT)
        self.has_disarmed()
        return Result.ACCEPTED

    def terminate(self) -> None:
        """Stop the motors permanently."""
        self.terminated = True
        self.event("flight terminated")

    # Small commands, the same from a mission and from a ground station

    def set_home(self, home: Home) -> None:
        """Move home."""
        self.home = home
        self.vehicle.radio.home_changed()

    @property
    def here(self) -> Home:
        """Its position, as a home."""
        return Home(self.lat, self.lon, self.body.alt_m)

    def restarted(self) -> None:
        """Read what survives a restart: the stored items."""
        self.run.reset()
        self.fence = Fence.from_items(self.stores[FENCE])

    def change_speed(self, speed_mps: float) -> bool:
        """Set the ground speed; the airspeed flag of the command makes no difference to a multirotor."""
        if not math.isfinite(speed_mps) or speed_mps <= 0.0:
            return False
        self.commanded_mps = speed_mps
        return True

    def turn_to(self, degrees: float, *, clockwise: bool, relative: bool) -> None:
        """Take a heading and keep it until the next item or mode."""
        if relative:
            degrees = math.degrees(self.body.yaw) + (degrees if clockwise else -degrees)
        self.yaw_override_deg = degrees % 360.0

    def yaw_reached(self) -> bool:
        """Whether the heading of `turn_to` is taken."""
        if self.yaw_override_deg is None:
            return True
        error = (math.degrees(self.body.yaw) - self.yaw_override_deg + 180.0) % 360.0 - 180.0
        return abs(error) <= _YAW_REACHED_DEG

    def execute(self, item: Item) -> None:
        """Do an item that takes no time."""
        match item.command:
            case Command.DO_CHANGE_SPEED:
                self.speed_command(item.p1, item.p2)
            case Command.DO_SET_HOME if item.p1 == 1.0:
                self.set_home(self.here)
            case Command.DO_SET_HOME if item.has_position:
                self.set_home(Home(item.lat, item.lon, item.z))
            case Command.DO_GRIPPER:
                self.move_gripper(close=item.p2 != 0.0)
            case Command.DO_WINCH:
                self.move_winch(item.p2, item.p3, item.p4)
            case Command.CONDITION_YAW if math.isfinite(item.p1):
                self.turn_to(item.p1, clockwise=item.p3 >= 0.0, relative=item.p4 == 1.0)
            case Command.COMPONENT_ARM_DISARM if item.p1 == 0.0:
                self.disarm(force=False, by="mission")

    def move_gripper(self, *, close: bool) -> bool:
        """Close the gripper, or open it and let the package go; False where none is enabled."""
        if not self.has_gripper:
            self.event("no gripper is enabled: nothing moves")
            return False
        if "gripper-silent" in self.vehicle.faults.active:
            return False
        if self.gripper_closed and not close:
            self.let_go(1.0 - self.vehicle.faults.value("gripper-stuck"))
        self.gripper_closed = close
        return True

    def move_winch(self, action: float, metres: float, rate_mps: float) -> bool:
        """Do a WINCH_ACTION: 1 pay out a length of line, 2 at a speed; False where there is no winch, or the action is unknown."""
        winch = self.vehicle.winch
        if not self.has_winch or action not in (1.0, 2.0) or not (math.isfinite(metres) and math.isfinite(rate_mps)):
            self.event("no winch, or no such action: nothing moves")
            return False
        if action == 1.0:
            winch.pay_out(metres, self.winch_mps(rate_mps))
            self.event(f"winch: {metres:+g} m of line")
        else:
            winch.set_rate(rate_mps)
        return True

    def let_go(self, share: float) -> None:
        """Let a share of the package fall off."""
        body = self.body
        if share > 0.0 and body.payload_kg > 0.0:
            self.event(f"package of {share * body.payload_kg:g} kg released {self.vehicle.place()}")
            body.payload_kg *= 1.0 - share

    def item_begun(self, index: int) -> None:
        """Report the new current item."""
        self.yaw_override_deg = None
        command = self.run.items[index].command
        name = Command(command).name.lower() if command in Command.__members__.values() else str(command)
        self.event(f"item {index} begins ({name})")
        self.vehicle.radio.tell_mission_current()

    def item_done(self, index: int) -> None:
        """Report an item as reached."""
        self.event(f"item {index} reached")
        self.vehicle.radio.item_reached(index)

    def mission_done(self) -> None:
        """Report the end of the mission."""
        self.event("mission complete")

    @property
    def fence_breached(self) -> bool:
        """Whether it is where the fence forbids it."""
        return self.fenced_off(self.lat, self.lon, self.body.alt_m)

    def fence_stored(self) -> None:
        """Read the fence items again."""
        self.fence = Fence.from_items(self.stores[FENCE])
