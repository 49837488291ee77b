"""PX4 multirotor: modes, refusals and behaviour (1.15 to main)."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, ClassVar

from skyway.sim_stub.autopilot.behaviours import ReturnHome, Speeds
from skyway.sim_stub.autopilot.items import Command, Item, Result
from skyway.sim_stub.autopilot.mission_run import MissionState
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.autopilot.px4 import missions as px4_missions
from skyway.sim_stub.autopilot.px4 import parameters as px4_parameters
from skyway.sim_stub.autopilot.px4.failsafes import Px4Failsafes
from skyway.sim_stub.autopilot.px4.mission_server import Px4MissionServer
from skyway.sim_stub.autopilot.px4.ulog import ULog
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.storage.ftp import Habits, Nak

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.sim_stub.autopilot.mission_server import MissionServer
    from skyway.sim_stub.autopilot.parameters import ParameterStore
    from skyway.sim_stub.storage.flight_log import LogFormat
    from skyway.sim_stub.vehicle import Vehicle

_AUTO = 4 << 16
_MODES = {
    Mode.STABILIZE: 7 << 16,
    Mode.ALTITUDE: 2 << 16,
    Mode.POSITION: 3 << 16,
    Mode.HOLD: _AUTO | 3 << 24,
    Mode.MISSION: _AUTO | 4 << 24,
    Mode.TAKEOFF: _AUTO | 2 << 24,
    Mode.LAND: _AUTO | 6 << 24,
    Mode.RTL: _AUTO | 5 << 24,
    Mode.OFFBOARD: 6 << 16,
}
_DEFAULT_HZ = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 10.0,
    "GLOBAL_POSITION_INT": 5.0,
    "LOCAL_POSITION_NED": 4.0,
    "VFR_HUD": 4.0,
    "GPS_RAW_INT": 1.0,
    "SYS_STATUS": 1.0,
    "BATTERY_STATUS": 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "MISSION_CURRENT": 1.0,
    "ALTITUDE": 1.0,
    "ATTITUDE_QUATERNION": 2.0,
    "WIND_COV": 0.5,
    "SYSTEM_TIME": 1.0,
    "HOME_POSITION": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "RC_CHANNELS": 1.0,
}
_CUSTOM_MODE, _AUTO_MODE, _GUIDED_MODE, _MANUAL_MODE = 1, 4, 8, 64
"""Bits of MAV_MODE_FLAG."""
_NOT_TO_ARM_IN = frozenset({Mode.LAND, Mode.RTL})
_CHANGE_MODE = 1.0
"""MAV_DO_REPOSITION_FLAGS_CHANGE_MODE."""


def _mode_of_base(base: int) -> Mode | None:
    """Mode of a base_mode without a custom one."""
    if base & _AUTO_MODE:
        return Mode.MISSION
    if not base & _MANUAL_MODE:
        return None
    return Mode.POSITION if base & _GUIDED_MODE else Mode.STABILIZE


class Px4(Px4Failsafes):
    """PX4."""

    AUTOPILOT_ID: ClassVar[int] = 12
    FIRMWARES: ClassVar[tuple[str, ...]] = ("1.15", "1.16", "main")
    USUAL_FIRMWARE: ClassVar[str] = "1.16"
    UNRELEASED: ClassVar[frozenset[str]] = frozenset({"main"})
    PARAMETER_ERRORS_SINCE: ClassVar[tuple[int, int]] = (1, 18)
    # Mission float 1, mission int 4, command int 8, parameters bytewise 16, FTP 32, termination 2048, MAVLink 2 8192, fence 16384, rally 32768.
    CAPABILITIES: ClassVar[int] = 1 | 4 | 8 | 16 | 32 | 2048 | 8192 | 16384 | 32768
    MODES: ClassVar[Mapping[Mode, int]] = _MODES
    MODE_NUMBERS: ClassVar[Mapping[int, Mode]] = {
        **{number: mode for mode, number in _MODES.items()},
        1 << 16: Mode.STABILIZE,
        _AUTO: Mode.MISSION,
    }
    KEEPS_HEADINGS: ClassVar[bool] = True
    TELLS_AIRSPEED: ClassVar[bool] = False
    LINK_TIMEOUT: ClassVar[tuple[str, float, float]] = ("COM_DL_LOSS_T", 1.0, 300.0)
    SYSTEM_PARAMETERS: ClassVar[tuple[str, ...]] = ("MAV_SYS_ID",)
    BYTEWISE: ClassVar[bool] = True
    STRICT_PARAMETERS: ClassVar[bool] = True
    DEFAULT_HZ: ClassVar[dict[str, float]] = _DEFAULT_HZ
    LACKS: ClassVar[frozenset[str]] = frozenset({"WIND", "EKF_STATUS_REPORT", "FENCE_STATUS"})
    OBEYS_STREAM_GROUPS: ClassVar[bool] = False
    TELLS_LIST_IDS: ClassVar[bool] = True
    REACHED_REPEATS: ClassVar[int] = 10
    MISSION_SERVER: ClassVar[type[MissionServer]] = Px4MissionServer
    REMOTE_CONTROL_LOST: ClassVar[str] = "Manual control lost"
    POSITION_LOST: ClassVar[str] = "Failsafe activated: position estimate lost, blind land"
    FENCE_BREACHED: ClassVar[str] = "Geofence violation"
    LOG_ENDINGS: ClassVar[tuple[str, ...]] = (".ulg", ".px4log")
    VIBRATION_OF_ACCELERATION: ClassVar[bool] = False
    VIBRATION_SCALE: ClassVar[float] = 0.3
    LOG_FORMAT: ClassVar[type[LogFormat]] = ULog
    LOG_HEAD: ClassVar[bytes] = b"ULog\x01\x12\x35\x01"
    CARD_FOLDERS: ClassVar[tuple[str, ...]] = ("/fs/microsd/log", "/fs/microsd/params", "/etc")
    FIRST_LOG: ClassVar[int] = 0
    LOGS_WHEN_DISARMED: ClassVar[bool] = False
    READY_AFTER_S: ClassVar[float] = 8.0
    BOOT_S: ClassVar[float] = 3.0
    GLITCH_PATIENCE_S: ClassVar[float] = 7.0
    ARM_PREFIX: ClassVar[str] = "Preflight Fail: "
    ARM_REFUSED: ClassVar[Result] = Result.TEMPORARILY_REJECTED
    ARMED_TEXT: ClassVar[str] = "Armed by external command"
    DISARMED_TEXT: ClassVar[str] = "Disarmed"
    DISARM_DENIED: ClassVar[str] = "Disarming denied: not landed"
    LOITER_MODE: ClassVar[Mode] = Mode.HOLD
    REPOSITION_MODE: ClassVar[Mode] = Mode.HOLD
    BAD_VALUE: ClassVar[Result] = Result.DENIED
    UNKNOWN_MESSAGE: ClassVar[Result] = Result.DENIED
    UNSUPPORTED: ClassVar[frozenset[int]] = frozenset(
        {
            Command.LOITER_UNLIM,
            Command.DO_PAUSE_CONTINUE,
            Command.DO_FENCE_ENABLE,
            Command.CONDITION_YAW,
            Command.BATTERY_RESET,
        }
    )
    LONG_HEIGHTS_RELATIVE: ClassVar[bool] = False
    HEEDS_FRAMES: ClassVar[bool] = False
    FORCES_ARMING: ClassVar[float | None] = None  # checks are run for every command from outside
    NO_LAND_START: ClassVar[Result] = Result.CANCELLED
    NO_REBOOT: ClassVar[Result] = Result.ACCEPTED
    REBOOT_REFUSED: ClassVar[Result] = Result.DENIED

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.infeasible = "No valid mission available"
        self.mode_after_disarming = Mode.HOLD

    def clock_of_day_s(self) -> float:
        """POSIX seconds by the computer's clock, as in PX4's simulator: only its time since boot is the simulation's."""
        return self.vehicle.world.epoch_s + self.vehicle.wall_s

    def ftp_habits(self, version: tuple[int, int]) -> Habits:  # noqa: ARG002
        """One file at a time, bursts of 35 kB beside which other requests are answered (``mavlink_ftp.cpp``)."""
        return Habits(
            sessions=1, numbers_sessions=False, burst_bytes=35_000, queues=False,
            open_refused=Nak.NO_SESSIONS, no_file=Nak.BAD_SESSION, empty_is_end=False, lists_skipped=True,
            reads_asked=False, idle_s=10.0, waiting=0,
        )  # fmt: skip

    def log_path(self, number: int, time_s: float) -> str:
        """By day and time where it knows them, else by counted sessions."""
        if time_s <= 0.0:
            return f"/fs/microsd/log/sess{number:03}/log001.ulg"
        begun = datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d/%H_%M_%S")
        return f"/fs/microsd/log/{begun}.ulg"

    def default_parameters(self, version: tuple[int, int]) -> ParameterStore:
        """Those that matter to a delivery."""
        return px4_parameters.store(version)

    def mavlink_version(self, *, heard_2: bool) -> int:
        """MAV_PROTO_VER; 0 speaks MAVLink 1 until MAVLink 2 is heard."""
        wanted = int(self.parameters["MAV_PROTO_VER"])
        return 1 if wanted == 1 or (wanted == 0 and not heard_2) else 2

    def read_speeds(self) -> Speeds:
        """MPC_* parameters; nothing above 20 m/s."""
        p = self.parameters
        most = p.clamped("MPC_XY_VEL_MAX", 1.0, 20.0)
        return Speeds(
            min(p.clamped("MPC_XY_CRUISE", 1.0, 20.0), most),
            p.clamped("MPC_Z_V_AUTO_UP", 0.5, 8.0),
            p.clamped("MPC_Z_V_AUTO_DN", 0.5, 4.0),
            p.clamped("MPC_LAND_SPEED", 0.4, 2.0),
            most,
        )

    def max_lean_deg(self) -> float:
        """MPC_TILTMAX_AIR."""
        return self.parameters.clamped("MPC_TILTMAX_AIR", 20.0, 89.0)

    def default_takeoff_m(self) -> float:
        """MIS_TAKEOFF_ALT."""
        return self.parameters.clamped("MIS_TAKEOFF_ALT", 0.5, 500.0)

    # Modes

    def set_mode(self, base: int, main: int, sub: int, by: str) -> Result:
        """Main and sub mode come in parameters of their own; what names no mode is accepted and does nothing."""
        if not base & _CUSTOM_MODE:
            mode = _mode_of_base(base)
        elif main << 16 == _AUTO and sub and main << 16 | sub << 24 not in self.MODE_NUMBERS:
            self.say(2, "Unsupported auto mode")
            return self.MODE_REFUSED
        else:
            mode = self.MODE_NUMBERS.get(main << 16 | (sub << 24 if main << 16 == _AUTO else 0))
        return Result.ACCEPTED if mode is None else self.request_mode(mode, by)

    def speed_command(self, kind: float, speed_mps: float) -> Result:  # noqa: ARG002
        """Set the ground speed; an invalid speed restores that of the parameters."""
        if not self.change_speed(speed_mps):
            self.commanded_mps = None
        return Result.ACCEPTED

    @property
    def has_gripper(self) -> bool:
        """PD_GRIPPER_EN, from 1.17 on a PD_GRIPPER_TYPE."""
        p = self.parameters
        return p["PD_GRIPPER_EN"] == 1.0 if "PD_GRIPPER_EN" in p else p["PD_GRIPPER_TYPE"] >= 0.0

    def gripper_s(self) -> float:
        """PD_GRIPPER_TO."""
        return self.parameters.clamped("PD_GRIPPER_TO", 0.0, 60.0)

    def take_off(self, height_m: float, by: str) -> Result:
        """Enter the take-off mode; the height is above sea level, and may be omitted."""
        if not self.landed:
            return Result.TEMPORARILY_REJECTED
        result = self.request_mode(Mode.TAKEOFF, by)
        if result == Result.ACCEPTED and math.isfinite(height_m) and height_m > self.body.alt_m:
            self.behaviour = self.take_off_behaviour(min(height_m, 20_000.0))
        return result

    def start_mission(self, first: float, last: float, by: str) -> Result:  # noqa: ARG002
        """Start at an item (-1: the current one), and arm; DENIED where the mission is infeasible."""
        if self.infeasible is not None:
            self.say(2, "Mission start denied! No valid mission")
            return Result.DENIED
        if not -1.0 <= first < len(self.run.items):
            return Result.DENIED
        if first >= 0.0:
            self.run.jump(int(first))
        if self.request_mode(Mode.MISSION, by) != Result.ACCEPTED:
            return self.MODE_REFUSED
        return self.arm(force=False, by=by)

    def reposition_refusal(self, *, here: bool, as_int: bool, flags: float) -> Result | None:  # noqa: ARG002
        """Only with the flag that changes to HOLD, and with no other."""
        return None if flags == _CHANGE_MODE else Result.UNSUPPORTED

    def outside_fence(self, lat: float, lon: float, alt_m: float) -> Result | None:
        """ACCEPTED, for the mode changes, but it does not go there."""
        if int(self.parameters["GF_ACTION"]) == 0 or not self.fenced_off(lat, lon, alt_m):
            return None
        self.say(2, "Reposition is outside geofence")
        return Result.ACCEPTED

    def mode_refusal(self, mode: Mode) -> str | None:
        """Refuse what cannot be flown now; disarmed, every mode can be entered, and arming is refused instead."""
        if not self.armed:
            return None
        if mode == Mode.MISSION and self.infeasible is not None:
            return self.infeasible
        if mode == Mode.OFFBOARD:
            return "Switching to mode 'Offboard' is currently not possible: no setpoints"
        needs_position = mode not in (Mode.STABILIZE, Mode.ALTITUDE, Mode.LAND)
        if needs_position and not self.ready:
            return f"Switching to mode '{mode.value}' is currently not possible: no global position"
        return None

    def entered_mission(self) -> None:
        """Resume; a mission that was completed lands again at once where it ends in a LAND."""
        run = self.run
        if run.state == MissionState.PAUSED:
            run.state = MissionState.ACTIVE
        if run.state == MissionState.COMPLETE and run.items and run.items[-1].command == Command.LAND:
            run.jump(len(run.items) - 1)

    def mission_may_run(self) -> bool:
        """Only a feasible mission; found infeasible in the air, it holds."""
        if self.infeasible is None:
            return True
        if not self.landed:
            self.say(2, self.infeasible)
            self.switch(Mode.HOLD, reason="mission infeasible")
        return False

    def judge_mission(self) -> None:
        """Check whether the mission stored is feasible, and say so when it is not."""
        home = self.home.alt_m if self.home else None
        first = self.parameters["MIS_DIST_1WP"]
        self.infeasible = px4_missions.infeasible(
            self.run.items, self.fence, home, (self.lat, self.lon), first if self.landed else 0.0
        )
        if self.infeasible is not None and self.run.items:
            self.say(2, self.infeasible)

    def missions_stored(self, *, replaced: bool, current: int | None) -> None:  # noqa: ARG002
        """Take over a whole new mission.

        In flight, without an item marked as current, it goes on at the old number: waypoints are skipped, and in a
        shorter mission it flies straight to the last item.
        """
        run = self.run
        old = run.current
        flying = self.armed and not self.landed
        active = run.state in (MissionState.ACTIVE, MissionState.PAUSED)
        run.reset()
        self.judge_mission()
        if current is not None:
            run.jump(min(current, max(len(run.items) - 1, 0)))
        elif flying and active and run.items:
            run.jump(min(old, len(run.items) - 1))

    def restarted(self) -> None:
        """Judge the stored mission again."""
        super().restarted()
        self.judge_mission()

    def fence_stored(self) -> None:
        """Take over a fence; one whose vertex counts disagree is accepted and then not in force."""
        super().fence_stored()
        if not self.fence.consistent:
            self.say(2, "Geofence invalid, doesn't have consistent vertices")
        self.judge_mission()

    # Arming and landing

    def arming_refusals(self) -> list[str]:
        """Reasons of the preflight checks."""
        reasons = []
        if self.vehicle.since_boot_s < self.READY_AFTER_S:
            reasons.append("ekf2 missing data")
        if not self.position_known and self.parameters["COM_ARM_WO_GPS"] != 1.0:
            reasons.append("Global position required")
        if self.mode == Mode.MISSION and self.infeasible is not None:
            reasons.append(self.infeasible)
        if self.mode in _NOT_TO_ARM_IN:
            reasons.append("Mode not suitable for takeoff")
        if self.mode == Mode.OFFBOARD:
            reasons.append("Offboard: no setpoints")
        if self.battery_level() >= 2:
            reasons.append("Low battery")
        if self.parameters["COM_ARM_ODID"] == 2.0 and (lacks := self.vehicle.remote_id.refusal()):
            missing = lacks == "not available"
            reasons.append(f"Open Drone ID system {'missing' if missing else 'not ready'}")
        return reasons + self.vehicle.faults.arming_faults()

    def has_armed(self) -> None:
        """A mission is judged again from the new home."""
        self.judge_mission()

    def switch(self, mode: Mode, *, reason: str) -> None:
        """Enter a mode; the last one chosen in which it can be armed comes back after landing."""
        super().switch(mode, reason=reason)
        if mode not in _NOT_TO_ARM_IN and not reason.endswith("failsafe"):
            self.mode_after_disarming = mode

    def has_disarmed(self) -> None:
        """Leave a mode in which it cannot be armed; mission progress survives disarming."""
        if self.mode in _NOT_TO_ARM_IN:
            self.switch(self.mode_after_disarming, reason="disarmed")

    def touched_down(self) -> None:
        """Nothing: disarming has its own delay."""
        self.say(6, "Landing detected")

    def disarm_on_ground(self) -> None:
        """Disarm after COM_DISARM_LAND, or COM_DISARM_PRFLT before any flight; not amid a mission."""
        amid = self.mode == Mode.MISSION and self.run.state == MissionState.ACTIVE
        if amid and self.run.behaviour is not None:
            return
        delay = self.parameters["COM_DISARM_LAND" if self.flown else "COM_DISARM_PRFLT"]
        since = self.grounded_s if self.flown and self.grounded_s is not None else self.armed_s
        if delay > 0.0 and self.sim_s - since >= delay:
            by = "auto disarm after landing" if self.flown else "auto preflight disarming"
            self.disarm(force=True, by=by)

    def return_home(self) -> ReturnHome:
        """To the nearest of home and the rally points (main: RTL_TYPE 5 never home), at RTL_RETURN_ALT or higher."""
        only_safe = self.vehicle.config.version >= (1, 18) and int(self.parameters["RTL_TYPE"]) == 5
        lat, lon = self.safe_place(math.inf, home_counts=not only_safe)
        height = self.home_alt_m + self.parameters.clamped("RTL_RETURN_ALT", 0.0, 5000.0)
        near = math.hypot(*offset_m(self.lat, self.lon, lat, lon)) < self.parameters["RTL_MIN_DIST"]
        return ReturnHome(lat, lon, self.body.alt_m if near else height)

    # Missions

    def acceptance_m(self, item: Item) -> float:
        """p2 of a waypoint, else NAV_ACC_RAD."""
        if item.command == Command.WAYPOINT and item.p2 > 0.0:
            return max(0.5, min(item.p2, 200.0))
        return self.parameters.clamped("NAV_ACC_RAD", 0.5, 200.0)

    def circling(self, radius_m: float) -> tuple[float, float]:
        """NAV_LOITER_RAD; a multirotor is never given turns, for their items are refused."""
        return radius_m or self.parameters.clamped("NAV_LOITER_RAD", 5.0, 1000.0), self.cruise_mps

    def delay_s(self, item: Item) -> float:
        """p1 seconds."""
        return max(0.0, min(item.p1, 1e7)) if math.isfinite(item.p1) else 0.0

    # Estimates

    @property
    def estimates_wind(self) -> bool:
        """With EKF2_DRAG_CTRL = 1 and drag coefficients set."""
        p = self.parameters
        given = p["EKF2_MCOEF"] > 0.0 or min(p["EKF2_BCOEF_X"], p["EKF2_BCOEF_Y"]) > 0.0
        return int(p["EKF2_DRAG_CTRL"]) == 1 and given
