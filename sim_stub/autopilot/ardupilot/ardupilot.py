"""ArduPilot Copter: modes, refusals and behaviour (4.5 to 4.8; parameter names of 4.6)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from skyway.sim_stub.autopilot.ardupilot import parameters as ardupilot_parameters
from skyway.sim_stub.autopilot.ardupilot.dataflash import DataFlash
from skyway.sim_stub.autopilot.ardupilot.failsafes import ArduPilotFailsafes
from skyway.sim_stub.autopilot.ardupilot.mission_server import ArduPilotMissionServer
from skyway.sim_stub.autopilot.behaviours import ReturnHome, Speeds
from skyway.sim_stub.autopilot.items import FENCE, NAV_COMMANDS, Command, Item, Result
from skyway.sim_stub.autopilot.mission_run import MissionState
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.storage.ftp import DATA_BYTES, Habits, Nak

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.sim_stub.autopilot.mission_server import MissionServer
    from skyway.sim_stub.autopilot.parameters import ParameterStore
    from skyway.sim_stub.storage.flight_log import LogFormat
    from skyway.sim_stub.vehicle import Vehicle

_MODES = {
    Mode.STABILIZE: 0,
    Mode.ALTITUDE: 2,
    Mode.MISSION: 3,
    Mode.GUIDED: 4,
    Mode.POSITION: 5,
    Mode.RTL: 6,
    Mode.LAND: 9,
    Mode.HOLD: 17,
    Mode.BRAKE: 17,
}
_NAMES = {
    Mode.STABILIZE: "STABILIZE",
    Mode.ALTITUDE: "ALT_HOLD",
    Mode.MISSION: "AUTO",
    Mode.GUIDED: "GUIDED",
    Mode.POSITION: "LOITER",
    Mode.RTL: "RTL",
    Mode.LAND: "LAND",
    Mode.BRAKE: "BRAKE",
}
_CONTINUE_AFTER_LAND = 2


class ArduPilot(ArduPilotFailsafes):
    """ArduPilot Copter."""

    AUTOPILOT_ID: ClassVar[int] = 3
    FIRMWARES: ClassVar[tuple[str, ...]] = ("4.5", "4.6", "4.7", "4.8")
    USUAL_FIRMWARE: ClassVar[str] = "4.6"
    UNRELEASED: ClassVar[frozenset[str]] = frozenset({"4.8"})
    PARAMETER_ERRORS_SINCE: ClassVar[tuple[int, int]] = (4, 7)
    MODES: ClassVar[Mapping[Mode, int]] = _MODES
    MODE_NUMBERS: ClassVar[Mapping[int, Mode]] = {n: mode for mode, n in _MODES.items()} | {
        16: Mode.POSITION,
        21: Mode.RTL,
    }
    KEEPS_HEADINGS: ClassVar[bool] = False
    TELLS_AIRSPEED: ClassVar[bool] = True
    LINK_TIMEOUT: ClassVar[tuple[str, float, float]] = ("FS_GCS_TIMEOUT", 2.0, 120.0)
    # As PX4's, with whole numbers of parameters as numbers (131072; 2 is its old name) and SET_POSITION_TARGET_GLOBAL_INT (256).
    CAPABILITIES: ClassVar[int] = 1 | 2 | 4 | 8 | 32 | 256 | 2048 | 8192 | 16384 | 32768 | 131072
    SYSTEM_PARAMETERS: ClassVar[tuple[str, ...]] = ("SYSID_THISMAV", "MAV_SYSID")
    BYTEWISE: ClassVar[bool] = False
    FENCE_SWITCH: ClassVar[str] = "FENCE_ENABLE"
    DEFAULT_HZ: ClassVar[dict[str, float]] = {"HEARTBEAT": 1.0}
    LACKS: ClassVar[frozenset[str]] = frozenset({"WIND_COV", "ESTIMATOR_STATUS", "ALTITUDE", "ESC_INFO"})
    OBEYS_STREAM_GROUPS: ClassVar[bool] = True
    HOME_ITEMS: ClassVar[int] = 1
    ALWAYS_MANUAL_INPUT: ClassVar[bool] = True
    MISSION_SERVER: ClassVar[type[MissionServer]] = ArduPilotMissionServer
    REMOTE_CONTROL_LOST: ClassVar[str] = "Radio Failsafe"
    POSITION_LOST: ClassVar[str] = "EKF Failsafe: changed to LAND Mode"
    FENCE_BREACHED: ClassVar[str] = "Fence Breached"
    LOG_ENDINGS: ClassVar[tuple[str, ...]] = (".bin",)
    LOG_FORMAT: ClassVar[type[LogFormat]] = DataFlash
    LOG_HEAD: ClassVar[bytes] = b"\xa3\x95\x80\x80\x59FMT\0"
    CARD_FOLDERS: ClassVar[tuple[str, ...]] = ("/APM/LOGS", "/@SYS", "/@PARAM", "/@MISSION", "/@ROMFS")
    FIRST_LOG: ClassVar[int] = 1
    LOGS_WHEN_DISARMED: ClassVar[bool] = True
    READY_AFTER_S: ClassVar[float] = 40.0
    BOOT_S: ClassVar[float] = 4.0
    GLITCH_PATIENCE_S: ClassVar[float] = 10.0
    GLITCH_TEXTS: ClassVar[tuple[str, str] | None] = ("GPS Glitch or Compass error", "Glitch cleared")
    MODE_REFUSED: ClassVar[Result] = Result.FAILED
    LOITER_MODE: ClassVar[Mode] = Mode.POSITION
    REPOSITION_MODE: ClassVar[Mode] = Mode.GUIDED
    BAD_VALUE: ClassVar[Result] = Result.FAILED
    UNKNOWN_MESSAGE: ClassVar[Result] = Result.UNSUPPORTED
    LONG_HEIGHTS_RELATIVE: ClassVar[bool] = True
    HEEDS_FRAMES: ClassVar[bool] = True
    FORCES_ARMING: ClassVar[float | None] = 2989.0
    NO_LAND_START: ClassVar[Result] = Result.FAILED
    NO_REBOOT: ClassVar[Result] = Result.UNSUPPORTED
    REBOOT_REFUSED: ClassVar[Result] = Result.FAILED

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.mode = Mode.STABILIZE
        self.auto_armed = False

    def ftp_habits(self, version: tuple[int, int]) -> Habits:
        """Bursts during which requests wait, paced without flow control; sessions with separate numbers from 4.7 on."""
        several = version >= (4, 7)
        return Habits(
            sessions=3 if several else 1, numbers_sessions=several, burst_bytes=(2000 if several else 500) * DATA_BYTES,
            queues=True, open_refused=Nak.NO_SESSIONS if several else Nak.FAIL, no_file=Nak.NOT_FOUND,
            empty_is_end=True, lists_skipped=False, reads_asked=True, idle_s=20.0, waiting=5,
        )  # fmt: skip

    def log_path(self, number: int, time_s: float) -> str:  # noqa: ARG002  its names are numbers
        """By its number."""
        return f"/APM/LOGS/{number:08}.BIN"

    def default_parameters(self, version: tuple[int, int]) -> ParameterStore:
        """Those that matter to a delivery."""
        return ardupilot_parameters.store(version)

    def mavlink_version(self, *, heard_2: bool) -> int:  # noqa: ARG002  its parameter alone decides
        """SERIAL0_PROTOCOL."""
        return 1 if self.parameters["SERIAL0_PROTOCOL"] == 1.0 else 2

    def count_charge(self, soc: float) -> None:
        """Of BATT_CAPACITY."""
        self.vehicle.counted_mah = (1.0 - soc) * self.parameters.clamped("BATT_CAPACITY", 1.0, 1e6)

    def read_speeds(self) -> Speeds:
        """WPNAV_* and LAND_SPEED, kept in cm/s; at most 20 m/s."""
        p = self.parameters
        cruise = p.clamped("WPNAV_SPEED", 20.0, 2000.0) / 100.0
        up, down = self.commanded_up_mps, self.commanded_down_mps
        return Speeds(
            cruise,
            p.clamped("WPNAV_SPEED_UP", 10.0, 1000.0) / 100.0 if up is None else min(max(up, 0.1), 10.0),
            p.clamped("WPNAV_SPEED_DN", 10.0, 500.0) / 100.0 if down is None else min(max(down, 0.1), 5.0),
            p.clamped("LAND_SPEED", 30.0, 200.0) / 100.0,
            cruise,
        )

    def max_lean_deg(self) -> float:
        """PSC_ANGLE_MAX, where it is not 0, and no more than ANGLE_MAX."""
        most = self.parameters.clamped("ANGLE_MAX", 1000.0, 8000.0) / 100.0
        own = self.parameters["PSC_ANGLE_MAX"]
        return min(most, own) if own > 0.0 else most

    # Modes

    def mode_refusal(self, mode: Mode) -> str | None:
        """Refuse what the state does not allow."""
        name = _NAMES.get(mode, mode.value)
        if mode not in (Mode.STABILIZE, Mode.ALTITUDE, Mode.LAND) and self.armed and not self.ready:
            return f"Mode change to {name} failed: requires position"
        if mode == Mode.MISSION:
            if len(self.run.items) <= 1:
                return "Mode change to AUTO failed: init failed"
            if self.armed and self.landed and not self._starts_with_takeoff():
                return "Auto: Missing Takeoff Cmd"
        return None

    def _starts_with_takeoff(self) -> bool:
        start = max(self.run.current, 1)
        item = next((i for i in self.run.items[start:] if i.command in NAV_COMMANDS), None)
        return item is not None and item.command in (Command.TAKEOFF, Command.LAND, Command.DELAY)

    def switch(self, mode: Mode, *, reason: str) -> None:
        """Enter a mode; there is none to hold in but BRAKE."""
        super().switch(Mode.BRAKE if mode == Mode.HOLD else mode, reason=reason)

    def entered_mission(self) -> None:
        """Resume, or start from the first item; on the ground it waits for MISSION_START (or AUTO_OPTIONS bit 1)."""
        run = self.run
        if run.state == MissionState.COMPLETE or self.parameters["MIS_RESTART"] == 1.0:
            run.reset()
        if run.state == MissionState.PAUSED:
            run.state = MissionState.ACTIVE
        if not self.landed or self.parameters.bit("AUTO_OPTIONS", 1):
            self.auto_armed = True

    def set_mode(self, base: int, main: int, sub: int, by: str) -> Result:  # noqa: ARG002
        """The number is in p2 alone."""
        if not base & 1:
            return Result.DENIED
        mode = self.MODE_NUMBERS.get(main)
        return self.BAD_VALUE if mode is None else self.request_mode(mode, by)

    def speed_command(self, kind: float, speed_mps: float) -> Result:
        """Set the ground speed, or with kind 2 the speed up and with 3 the speed down."""
        if not math.isfinite(speed_mps) or speed_mps <= 0.0:
            return Result.FAILED
        if kind > 2.9:
            self.commanded_down_mps = speed_mps
        elif kind > 1.9:
            self.commanded_up_mps = speed_mps
        else:
            self.change_speed(speed_mps)
        return Result.ACCEPTED

    @property
    def has_gripper(self) -> bool:
        """GRIP_ENABLE."""
        return self.parameters["GRIP_ENABLE"] == 1.0

    @property
    def has_winch(self) -> bool:
        """WINCH_TYPE: 1 by pulses, 2 a Daiwa, which reports the length of line."""
        return self.parameters["WINCH_TYPE"] >= 1.0

    @property
    def tells_winch(self) -> bool:
        """Whether there is a winch."""
        return self.has_winch

    def winch_mps(self, rate_mps: float) -> float:  # noqa: ARG002  by length it goes as fast as it may
        """WINCH_RATE_MAX."""
        return self.parameters.clamped("WINCH_RATE_MAX", 0.05, 10.0)

    def take_off(self, height_m: float, by: str) -> Result:
        """Only armed, on the ground, in GUIDED; the height is above home."""
        if self.mode != Mode.GUIDED or not self.armed or not self.landed:
            return Result.FAILED
        if not math.isfinite(height_m) or not 0.0 < height_m <= 1000.0:
            return Result.FAILED
        self.behaviour = self.take_off_behaviour(self.home_alt_m + height_m)
        self.event(f"take-off to {height_m:g} m ({by})")
        return Result.ACCEPTED

    def reposition_refusal(self, *, here: bool, as_int: bool, flags: float) -> Result | None:
        """Obeyed as COMMAND_INT, in GUIDED or with the flag that changes to it; on the ground it stays where it is."""
        if not as_int:
            return Result.UNSUPPORTED
        may_change = math.isfinite(flags) and flags > 0.0 and int(min(flags, 255.0)) & 1
        return Result.DENIED if here or not (self.mode == Mode.GUIDED or may_change) else None

    def outside_fence(self, lat: float, lon: float, alt_m: float) -> Result | None:
        """FAILED: a destination beyond the fence is not taken."""
        return Result.FAILED if self.fenced_off(lat, lon, alt_m) else None

    def start_mission(self, first: float, last: float, by: str) -> Result:  # noqa: ARG002
        """Do MISSION_START, from where the mission is."""
        if first or last:
            return Result.DENIED
        if self.mode != Mode.MISSION and self.request_mode(Mode.MISSION, "mission start") != Result.ACCEPTED:
            return Result.FAILED
        self.auto_armed = True
        if self.run.state == MissionState.COMPLETE:
            self.run.reset()
        return Result.ACCEPTED

    def mission_may_run(self) -> bool:
        """Wait for the start order on the ground; item 0 is home and is never flown."""
        if self.run.current == 0 and self.run.behaviour is None and self.auto_armed:
            self.run.jump(1)
        return self.auto_armed

    def missions_stored(self, *, replaced: bool, current: int | None) -> None:
        """Restart the command in progress where its item was replaced: new items act at once."""
        run = self.run
        if run.state in (MissionState.NO_MISSION, MissionState.UNKNOWN) and run.items:
            run.state = MissionState.NOT_STARTED
        self.parameters.set("MIS_TOTAL", float(len(run.items)))
        if replaced and current == run.current and self.mode == Mode.MISSION and run.behaviour is not None:
            run.jump(run.current)
            self.say(5, "Auto mission changed, restarted command")

    def mission_done(self) -> None:
        """Disarm on the ground, hover in the air."""
        super().mission_done()
        if self.landed:
            self.disarm(force=True, by="mission exit")

    def fence_stored(self) -> None:
        """Take over a fence."""
        super().fence_stored()
        self.parameters.set("FENCE_TOTAL", float(min(len(self.stores[FENCE]), 127)))

    # Arming and landing

    def arming_refusals(self) -> list[str]:
        """Reasons of the pre-arm checks and of the mode."""
        reasons = []
        if self.mode == Mode.MISSION and not self.parameters.bit("AUTO_OPTIONS", 0):
            reasons.append("AUTO mode not armable")
        elif self.mode in (Mode.RTL, Mode.LAND, Mode.BRAKE, Mode.HOLD):
            reasons.append(f"{_NAMES.get(self.mode, 'BRAKE')} mode not armable")
        if self.vehicle.since_boot_s < 5.0:
            reasons.append("Gyros still settling")
        elif self.mode not in (Mode.STABILIZE, Mode.ALTITUDE) and not self.ready:
            reasons.append("Need Position Estimate")
        enforced = self.parameters["DID_ENABLE"] == 1.0 and self.parameters.bit("DID_OPTIONS", 0)
        if enforced and (lacks := self.vehicle.remote_id.refusal()):
            reasons.append(f"OpenDroneID: {lacks.replace('not available', 'ARM_STATUS not available')}")
        unchecked = {"ARMING_CHECK": 0.0, "ARMING_SKIPCHK": -1.0}  # up to 4.6 and from 4.7 on
        if any(name in self.parameters and self.parameters[name] == none for name, none in unchecked.items()):
            return reasons
        volts = self.parameters["BATT_ARM_VOLT"]
        if self.vehicle.battery.voltage_v < max(volts, 0.0):
            reasons.append("Battery 1 below minimum arming voltage")
        if self.parameters["FENCE_ENABLE"] == 1.0 and self.ready and self.fence_breached:
            reasons.append("vehicle outside Polygon fence")
        return reasons + self.vehicle.faults.arming_faults()

    def has_armed(self) -> None:
        """Start counting again."""
        self.auto_armed = self.mode == Mode.MISSION and self.parameters.bit("AUTO_OPTIONS", 1)

    def has_disarmed(self) -> None:
        """Disarming resets the mission."""
        self.run.reset()
        self.auto_armed = False

    @property
    def continues_after_land(self) -> bool:
        """MIS_OPTIONS bit 2."""
        return self.parameters.bit("MIS_OPTIONS", _CONTINUE_AFTER_LAND)

    def touched_down(self) -> None:
        """Disarm at once after a landing, unless the mission is to continue."""
        if not self.armed:
            return
        item = self.run.items[self.run.current] if self.run.current < len(self.run.items) else None
        landing = item is not None and item.command in (Command.LAND, Command.RETURN_TO_LAUNCH)
        if self.mode in (Mode.LAND, Mode.RTL) or (
            self.mode == Mode.MISSION and landing and not self.continues_after_land
        ):
            self.disarm(force=True, by="landed")

    def disarm_on_ground(self) -> None:
        """Disarm after DISARM_DELAY, in every mode."""
        delay = self.parameters.clamped("DISARM_DELAY", 0.0, 127.0)
        since = max(self.armed_s, self.grounded_s if self.grounded_s is not None else self.armed_s)
        climbing = self.run.behaviour is not None and self.mode == Mode.MISSION
        lifting = self.body.grounded and climbing and self.run.current < len(self.run.items)
        if lifting and self.run.items[self.run.current].command == Command.TAKEOFF:
            return
        if delay > 0.0 and self.sim_s - since >= delay:
            self.disarm(force=True, by="disarm delay")

    def return_home(self) -> ReturnHome:
        """To a rally point within RALLY_LIMIT_KM, else home, at RTL_ALT or higher."""
        p = self.parameters
        limit_m = p["RALLY_LIMIT_KM"] * 1000.0
        lat, lon = self.safe_place(limit_m if limit_m > 0.0 else math.inf, home_counts=p["RALLY_INCL_HOME"] == 1.0)
        height = self.home_alt_m + p.clamped("RTL_ALT", 0.0, 300_000.0) / 100.0
        return ReturnHome(lat, lon, height, p.clamped("RTL_LOIT_TIME", 0.0, 60_000.0) / 1000.0)

    # Missions

    def acceptance_m(self, item: Item) -> float:  # noqa: ARG002
        """WPNAV_RADIUS: the radius of an item is not kept."""
        return self.parameters.clamped("WPNAV_RADIUS", 5.0, 1000.0) / 100.0

    def circling(self, radius_m: float) -> tuple[float, float]:
        """CIRCLE_RADIUS, CIRCLE_RATE; no more than half of WPNAV_ACCEL goes into the turn."""
        p = self.parameters
        radius_m = radius_m or p.clamped("CIRCLE_RADIUS", 100.0, 200_000.0) / 100.0
        turn_back = math.sqrt(0.5 * p.clamped("WPNAV_ACCEL", 50.0, 500.0) / 100.0 * radius_m)
        rate = math.radians(max(1.0, abs(p.clamped("CIRCLE_RATE", -90.0, 90.0))))
        return radius_m, min(self.cruise_mps, turn_back, rate * radius_m)

    def delay_s(self, item: Item) -> float:
        """p1 seconds; where that is 0 or less, until the UTC time of day in p2, p3, p4: midnight, if they are 0."""
        if item.p1 > 0.0:
            return min(item.p1, 1e7)
        wanted = max(item.p2, 0.0) * 3600.0 + max(item.p3, 0.0) * 60.0 + max(item.p4, 0.0)
        return (wanted - self.vehicle.posix_s) % 86_400.0

    # Estimates

    @property
    def estimates_wind(self) -> bool:
        """With the drag coefficients of EK3 set."""
        return any(self.parameters[f"EK3_DRAG_{name}"] > 0.0 for name in ("BCOEF_X", "BCOEF_Y", "MCOEF"))
