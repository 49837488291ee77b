"""Interface of a vehicle, whatever its driver."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from skyway.link.protocol.mission_words import MissionKind
    from skyway.link.protocol.parameters import ParameterCheck, ParameterValue
    from skyway.link.protocol.verified import Part, UploadOutcome
    from skyway.link.telemetry.vehicle_monitor import Change, Home
    from skyway.missions.autopilots.family import Family
    from skyway.missions.autopilots.read_back import Difference
    from skyway.missions.items.mission import Mission
    from skyway.missions.items.parameters import Parameter
    from skyway.models.drones.telemetry import TelemetrySample

CAPABILITIES = {
    1: "missions (float)",
    4: "missions",
    8: "commands with places",
    2048: "flight termination",
    8192: "MAVLink 2",
    16384: "fences",
    32768: "rally points",
}
TYPES = {1: "plane", 2: "quadrotor", 3: "coaxial", 4: "helicopter", 13: "hexarotor", 14: "octorotor", 20: "VTOL"}


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a vehicle is.

    Attributes
    ----------
    system : int
        MAVLink system id.
    autopilot : str
        Name of its family.
    kind : int
        MAV_TYPE.
    version : str
        Of the flight software, such as ``4.6.0``; empty where it does not tell.
    capabilities : int
        MAV_PROTOCOL_CAPABILITY bits; 0 where it does not tell.
    uid : int
        Hardware id; 0 where it does not tell.
    """

    system: int
    autopilot: str
    kind: int
    version: str = ""
    capabilities: int = 0
    uid: int = 0

    @property
    def words(self) -> tuple[str, ...]:
        """Capabilities in words."""
        return tuple(word for bit, word in CAPABILITIES.items() if self.capabilities & bit)

    def __str__(self) -> str:
        kind = TYPES.get(self.kind, f"type {self.kind}")
        return f"vehicle {self.system}: {self.autopilot} {self.version or 'of unknown version'}, {kind}"


def version_text(number: int) -> str:
    """Version of a flight_sw_version field: major, minor and patch in its upper bytes."""
    return f"{number >> 24 & 0xFF}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}" if number else ""


class Vehicle(Protocol):
    """One vehicle. Every method may raise a `LinkError`; what moves it says so in words when it is refused."""

    @property
    def family(self) -> Family:
        """Which autopilot's way it has."""
        ...

    @property
    def armed(self) -> bool:
        """Whether it said so last; one that was never heard counts as armed."""
        ...

    @property
    def mode(self) -> str:
        """The mode it said it is in last, for a person."""
        ...

    @property
    def changing(self) -> bool:
        """Whether it has just told of a change that we did not ask for, and that is not confirmed yet."""
        ...

    @property
    def reboots(self) -> int:
        """How often it has restarted since it was met."""
        ...

    @property
    def silent_s(self) -> float:
        """For how long nothing has been heard of it."""
        ...

    def answers(self) -> bool:
        """Ask whether it hears us: one that is heard need not."""
        ...

    @property
    def mission_state(self) -> str:
        """What it says of its mission: one of `link.telemetry.vehicle_monitor.MISSION_STATES`."""
        ...

    def changes(self) -> list[Change]:
        """Return what has become different since this was asked last, and whether an order of ours asks for it."""
        ...

    def home(self) -> Home:
        """Ask where it counts heights from now."""
        ...

    def texts(self) -> list[str]:
        """What it has said, the newest last."""
        ...

    def new_texts(self) -> list[tuple[int, str]]:
        """What it has said since this was asked last: MAV_SEVERITY and text, the oldest first."""
        ...

    def request_telemetry(self, rates_hz: Mapping[int, float] = ...) -> tuple[int, ...]:
        """Ask for the messages that telemetry is made of; returns the ids of those refused."""
        ...

    def check_ground_station(self) -> None:
        """Make sure that its failsafe counts our heartbeat."""
        ...

    def identify(self) -> Identity:
        """Tell who it is."""
        ...

    def samples(self, duration_s: float = math.inf) -> Iterator[TelemetrySample]:
        """Yield telemetry as it comes."""
        ...

    def parameter(self, name: str) -> ParameterValue:
        """Read a parameter."""
        ...

    def set_parameter(self, name: str, value: float) -> ParameterValue:
        """Set a parameter, and read it back."""
        ...

    def parameters(self) -> dict[str, ParameterValue]:
        """Read all parameters, by name."""
        ...

    def read_settings(self, keys: Sequence[str]) -> dict[str, float]:
        """Read settings by their keys (`missions.autopilots.settings`), in our units; what this firmware has not is left out."""
        ...

    def check_required(self, wanted: Sequence[Parameter]) -> tuple[ParameterCheck, ...]:
        """Read the parameters that a mission relies on."""
        ...

    def arm(self, patience_s: float = 0.0) -> None:
        """Arm; try again for so long while it is not ready."""
        ...

    def disarm(self) -> None:
        """Disarm."""
        ...

    def set_mode(self, name: str) -> None:
        """Switch to ``hold``, ``mission``, ``guided``, ``return``, ``land`` or ``position``."""
        ...

    def start(self, patience_s: float = 0.0) -> None:
        """Arm and fly the mission from its beginning; blocked while it is not known what the vehicle holds."""
        ...

    def pause(self) -> None:
        """Stop on the way."""
        ...

    def resume(self) -> None:
        """Go on with the mission."""
        ...

    def change_speed(self, ground_speed_mps: float) -> None:
        """Fly the mission on at another ground speed."""
        ...

    def go_to(self, lat_deg: float, lon_deg: float, height_m: float) -> None:
        """Fly there, height above home, and stay."""
        ...

    def return_home(self) -> None:
        """Return as the vehicle's parameters say."""
        ...

    def land(self) -> None:
        """Land here."""
        ...

    def release(self) -> None:
        """Let the package go."""
        ...

    def reset_battery(self, soc: float) -> float:
        """Tell the autopilot's counter what the battery holds, 0-1; returns what it reports then, NaN for nothing."""
        ...

    def upload(
        self, part: Part, *, current: int = 0, progress: Callable[[str, int, int], None] | None = None
    ) -> UploadOutcome:
        """Upload a mission, a fence or rally points, and read them back."""
        ...

    def change_in_flight(self, mission: Mission, current: int) -> UploadOutcome:
        """Hold, upload, read back, set the current item, resume; stay in hold where it is not verified."""
        ...

    def download(self, kind: MissionKind) -> Part:
        """Read what it holds, in our numbering."""
        ...

    def verify(self, part: Part) -> tuple[Difference, ...]:
        """Return how what it holds differs in meaning."""
        ...

    def clear(self, kind: MissionKind) -> None:
        """Clear one kind, and read back that it is gone."""
        ...

    def set_current(self, item: int) -> None:
        """Make one of our items the next to be flown."""
        ...
