"""Interface of a simulated autopilot family: what `base` leaves to subclasses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from skyway.sim_stub.autopilot.items import Result

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.sim_stub.autopilot.behaviours import ReturnHome, Speeds
    from skyway.sim_stub.autopilot.items import Item
    from skyway.sim_stub.autopilot.mission_server import MissionServer
    from skyway.sim_stub.autopilot.modes import Action, Mode
    from skyway.sim_stub.autopilot.parameters import ParameterStore
    from skyway.sim_stub.storage.flight_log import LogFormat
    from skyway.sim_stub.storage.ftp import Habits


class Family(ABC):
    """The family's own: names, result codes, and decisions."""

    AUTOPILOT_ID: ClassVar[int]
    """MAV_AUTOPILOT."""
    FIRMWARES: ClassVar[tuple[str, ...]]
    """Versions that are simulated."""
    USUAL_FIRMWARE: ClassVar[str]
    UNRELEASED: ClassVar[frozenset[str]] = frozenset()
    """Versions that say of themselves that they are no release."""
    PARAMETER_ERRORS_SINCE: ClassVar[tuple[int, int]]
    """Version that answers PARAM_ERROR where it has no such parameter; older ones are silent."""
    MODES: ClassVar[Mapping[Mode, int]]
    """custom_mode of HEARTBEAT in each mode; what is not in it tells that of holding."""
    MODE_NUMBERS: ClassVar[Mapping[int, Mode]]
    """Mode of each number that it takes."""
    CAPABILITIES: ClassVar[int]
    """MAV_PROTOCOL_CAPABILITY."""
    SYSTEM_PARAMETERS: ClassVar[tuple[str, ...]]
    """Names of the parameter that is its system id, in all versions."""
    BYTEWISE: ClassVar[bool]
    """Whole numbers of parameters travel as the bytes of a float."""
    STRICT_PARAMETERS: ClassVar[bool] = False
    """It refuses a parameter of another type, and says so, and of one that it does not have."""
    FENCE_SWITCH: ClassVar[str] = ""
    """Parameter that DO_FENCE_ENABLE sets, of a family that obeys it."""
    DEFAULT_HZ: ClassVar[dict[str, float]]
    """Messages that it streams unasked."""
    LACKS: ClassVar[frozenset[str]] = frozenset()
    """Messages that it does not have."""
    OBEYS_STREAM_GROUPS: ClassVar[bool]
    """Whether it knows REQUEST_DATA_STREAM."""
    TELLS_LIST_IDS: ClassVar[bool] = False
    """Whether MISSION_CURRENT has the opaque ids of what is stored."""
    REACHED_REPEATS: ClassVar[int] = 0
    """How often it tells again that an item is reached, a second apart."""
    HOME_ITEMS: ClassVar[int] = 0
    """Items of its missions that are home, not flown."""
    KEEPS_HEADINGS: ClassVar[bool]
    """Waypoints, and orders to reposition, keep the heading that they ask for."""
    TELLS_AIRSPEED: ClassVar[bool]
    """It tells its ground speed as airspeed, without a sensor."""
    LINK_TIMEOUT: ClassVar[tuple[str, float, float]]
    """Parameter with the silence after which the link counts as lost, and its range."""
    ALWAYS_MANUAL_INPUT: ClassVar[bool] = False
    """Its base_mode has the bit of manual input in every mode."""
    MISSION_SERVER: ClassVar[type[MissionServer]]
    """Its mission protocol."""
    REMOTE_CONTROL_LOST: ClassVar[str]
    POSITION_LOST: ClassVar[str]
    FENCE_BREACHED: ClassVar[str]
    READY_AFTER_S: ClassVar[float]
    BOOT_S: ClassVar[float]
    GLITCH_PATIENCE_S: ClassVar[float]
    GLITCH_TEXTS: ClassVar[tuple[str, str] | None] = None
    LOITER_MODE: ClassVar[Mode]
    REPOSITION_MODE: ClassVar[Mode]
    BAD_VALUE: ClassVar[Result]
    UNKNOWN_MESSAGE: ClassVar[Result]
    UNSUPPORTED: ClassVar[frozenset[int]] = frozenset()
    LONG_HEIGHTS_RELATIVE: ClassVar[bool]
    HEEDS_FRAMES: ClassVar[bool]
    """PX4 up to 1.17 takes the height of every COMMAND_INT as above mean sea level (its issues 10246 and 28257)."""
    FORCES_ARMING: ClassVar[float | None]
    FORCES_DISARMING: ClassVar[float] = 21196.0
    NO_LAND_START: ClassVar[Result]
    NO_REBOOT: ClassVar[Result]
    REBOOT_REFUSED: ClassVar[Result]
    LOG_ENDINGS: ClassVar[tuple[str, ...]]
    """How the names of its logs end, in small letters."""
    LOG_HEAD: ClassVar[bytes]
    """First bytes of its logs."""
    VIBRATION_OF_ACCELERATION: ClassVar[bool] = True
    """All three fields of VIBRATION are accelerations; otherwise the last alone, and the others are of the gyro."""
    VIBRATION_SCALE: ClassVar[float] = 1.0
    """Its measure of the same shaking, beside that of the other family."""
    LOG_FORMAT: ClassVar[type[LogFormat]]
    """What writes the log of a flight."""
    CARD_FOLDERS: ClassVar[tuple[str, ...]]
    """Folders that its card always has."""
    FIRST_LOG: ClassVar[int]
    """Number of the first log in LOG_ENTRY."""
    LOGS_WHEN_DISARMED: ClassVar[bool]
    """It sends logs only when disarmed, and one part at a time; otherwise a new request takes the place of the old, and the logs
    must have been listed."""
    MODE_REFUSED: ClassVar[Result] = Result.TEMPORARILY_REJECTED
    ARM_PREFIX: ClassVar[str] = "Arm: "
    ARMED_TEXT: ClassVar[str] = "Arming motors"
    ARM_REFUSED: ClassVar[Result] = Result.FAILED
    DISARMED_TEXT: ClassVar[str] = "Disarming motors"
    DISARM_DENIED: ClassVar[str] = "Disarm: vehicle is not landed"

    @abstractmethod
    def ftp_habits(self, version: tuple[int, int]) -> Habits:
        """File service of a version."""

    @abstractmethod
    def log_path(self, number: int, time_s: float) -> str:
        """Path of the log of a number, started at an instant, POSIX seconds."""

    @abstractmethod
    def default_parameters(self, version: tuple[int, int]) -> ParameterStore:
        """Parameters as a version of the firmware has them, with its defaults."""

    @abstractmethod
    def mavlink_version(self, *, heard_2: bool) -> int:
        """MAVLink 1 or 2 by its parameters, on a port on which MAVLink 2 was heard or not."""

    def count_charge(self, soc: float) -> None:  # noqa: B027  not all count
        """Set the counter of its battery to a state of charge, where it has one."""

    @abstractmethod
    def read_speeds(self) -> Speeds:
        """Limits from the parameters."""

    @abstractmethod
    def max_lean_deg(self) -> float:
        """Greatest lean that it asks of the airframe."""

    def default_takeoff_m(self) -> float:
        """Height of a take-off that names none."""
        return 10.0

    @abstractmethod
    def set_mode(self, base: int, main: int, sub: int, by: str) -> Result:
        """Do DO_SET_MODE; p1 to p3."""

    @abstractmethod
    def speed_command(self, kind: float, speed_mps: float) -> Result:
        """Do DO_CHANGE_SPEED; p1 and p2."""

    @property
    @abstractmethod
    def has_gripper(self) -> bool:
        """Whether one is enabled."""

    @property
    def has_winch(self) -> bool:
        """Whether a winch obeys it."""
        return True

    @property
    def tells_winch(self) -> bool:
        """Whether it sends WINCH_STATUS."""
        return False

    def winch_mps(self, rate_mps: float) -> float:
        """Line speed, for a requested one."""
        return rate_mps

    def gripper_s(self) -> float:
        """Time a gripper takes to complete its command."""
        return 0.0

    @abstractmethod
    def take_off(self, height_m: float, by: str) -> Result:
        """Do NAV_TAKEOFF; the height is p7."""

    @abstractmethod
    def start_mission(self, first: float, last: float, by: str) -> Result:
        """Do MISSION_START."""

    @abstractmethod
    def reposition_refusal(self, *, here: bool, as_int: bool, flags: float) -> Result | None:
        """Why DO_REPOSITION is not obeyed, or None."""

    @abstractmethod
    def outside_fence(self, lat: float, lon: float, alt_m: float) -> Result | None:
        """Answer to a DO_REPOSITION beyond the fence, which is not flown; None within it."""

    @abstractmethod
    def mode_refusal(self, mode: Mode) -> str | None:
        """Why a mode cannot be entered now, or None."""

    @abstractmethod
    def entered_mission(self) -> None:
        """Start or resume the mission, as the family does on entering the mode."""

    @abstractmethod
    def mission_may_run(self) -> bool:
        """Whether the mission flies once the mode is entered and the vehicle armed."""

    @abstractmethod
    def arming_refusals(self) -> list[str]:
        """Why it does not arm, in the family's words."""

    @abstractmethod
    def has_armed(self) -> None:
        """React to arming."""

    @abstractmethod
    def has_disarmed(self) -> None:
        """React to disarming."""

    @abstractmethod
    def touched_down(self) -> None:
        """React to a landing."""

    @abstractmethod
    def disarm_on_ground(self) -> None:
        """Disarm after a landing when it is time; called at every step on the ground."""

    @abstractmethod
    def return_home(self) -> ReturnHome:
        """Return to home or a rally point."""

    @abstractmethod
    def acceptance_m(self, item: Item) -> float:
        """Radius within which a waypoint counts as reached."""

    @abstractmethod
    def circling(self, radius_m: float) -> tuple[float, float]:
        """Radius and speed of a circle for which a radius is asked; 0 is the default one."""

    @abstractmethod
    def delay_s(self, item: Item) -> float:
        """Duration of a NAV_DELAY."""

    @abstractmethod
    def battery_level(self) -> int:
        """0 fine, 1 low, 2 critical, 3 emergency."""

    @abstractmethod
    def battery_action(self, level: int) -> Action:
        """Action at a battery level."""

    @abstractmethod
    def battery_warning(self, level: int) -> None:
        """Warn that a battery level is reached."""

    @abstractmethod
    def reported_percent(self) -> int:
        """Battery percentage as reported, -1 unknown."""

    @abstractmethod
    def ground_heard_s(self) -> float | None:
        """Time at which the supervising ground station was last heard; None for never."""

    @abstractmethod
    def link_action(self) -> Action:
        """Action on loss of the link, in the present mode."""

    @abstractmethod
    def link_warning(self, *, lost: bool) -> None:
        """Warn that the link is lost or recovered."""

    @abstractmethod
    def remote_control_action(self) -> Action:
        """Action on loss of the remote control, in the present mode."""

    def position_delay_s(self) -> float:
        """Time without position after which the vehicle acts."""
        return 1.0

    @abstractmethod
    def fenced_off(self, lat: float, lon: float, alt_m: float) -> bool:
        """Whether the fence forbids a place; metres above mean sea level."""

    @abstractmethod
    def fence_action(self) -> Action:
        """Action at a breach."""

    def failsafe_on_ground(self, name: str) -> None:  # noqa: B027  not all do anything
        """React to a failsafe while armed on the ground."""

    @property
    @abstractmethod
    def estimates_wind(self) -> bool:
        """Whether its estimator of the wind is on."""

    @abstractmethod
    def missions_stored(self, *, replaced: bool, current: int | None) -> None:
        """React to a new mission having been stored."""
