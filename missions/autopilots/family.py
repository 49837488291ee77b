"""Interface of an autopilot family: all differences between autopilots.

A family is a folder here and its name in `missions.autopilots.NAMES`. No other code compares names or MAV_AUTOPILOT numbers:
it uses the family.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from skyway.missions.autopilots.settings import version_of
from skyway.missions.items.parameters import dumps

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from skyway.missions.autopilots.calibration import Calibration
    from skyway.missions.autopilots.failsafes import Failsafes
    from skyway.missions.autopilots.modes import Modes
    from skyway.missions.autopilots.settings import Settings
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.mission import Mission, MissionItem
    from skyway.missions.items.parameters import FlightNeeds, Parameter

Meaning = dict[str, float | str | None]
"""Meaning of an item for an autopilot, field by field; None is "not given"."""


class Family(ABC):
    """One autopilot family: its missions, its commands, and the interpretation of its vehicles' messages."""

    name: ClassVar[str]
    """Such as ``px4``: name in commands and files."""
    firmware: ClassVar[int]
    """MAV_AUTOPILOT."""
    home_items: ClassVar[int] = 0
    """Items that it counts before the first of a mission: 1 where item 0 is home."""
    stays_in_mission_after_landing: ClassVar[bool]
    """Whether a mission continues after a landing that disarms."""
    zero_means_as_it_is: ClassVar[bool]
    """Whether a TAKEOFF climbs at the vehicle's position, whatever its place, and an altitude of 0 keeps the height."""
    open_yaw_deg: ClassVar[float]
    """Yaw of an item, or of a command, that leaves the choice to the vehicle."""
    refuses_open_parameters: ClassVar[bool] = False
    """Whether it refuses NaN, so that 0 is sent instead; otherwise NaN leaves the choice to the vehicle."""
    within_every_inclusion_area: ClassVar[bool] = False
    """Whether several inclusion areas of a fence mean all of them at once; otherwise any of them."""
    settings: ClassVar[Settings]
    """Names of its parameters in each version."""
    firmwares: ClassVar[tuple[str, ...]]
    """Known versions of its firmware, the oldest first."""
    places_payloads: ClassVar[bool] = False
    """It flies NAV_PAYLOAD_PLACE."""
    released: ClassVar[str]
    """The newest released one of them."""
    modes: ClassVar[Modes]
    """Its flight modes."""
    failsafes: ClassVar[Failsafes]
    """Its automatic behaviour."""
    arms_in: ClassVar[str | None] = None
    """Mode to arm in before a mission is started; None arms in any."""
    pauses_in_mission: ClassVar[bool]
    """Whether it obeys DO_PAUSE_CONTINUE; otherwise a mission is paused by holding."""
    heeds_frames: ClassVar[bool] = True
    """Whether the frame of a command determines its height reference; otherwise it is above mean sea level in any frame."""
    bytewise_parameters: ClassVar[bool]
    """Whether whole numbers of parameters travel as the bytes of a float."""
    takes_uploads_whole: ClassVar[bool]
    """Whether an upload replaces the old mission completely or not at all; otherwise each item takes effect as it arrives."""
    judges_missions: ClassVar[bool] = False
    """Whether it reports that it will not fly a mission that it has accepted."""
    ground_station_settings: ClassVar[tuple[str, ...]] = ()
    """Settings with the first and the last system that counts as a ground station; none if any does."""
    lean_limits: ClassVar[tuple[str, ...]] = ()
    """Settings of which the smallest limits its lean; 0 is no limit of its own."""
    wind_message: ClassVar[int] = 168
    """Id of the message with its estimate of the wind: WIND, or WIND_COV."""
    system_id_names: ClassVar[tuple[str, ...]] = ()
    """Names of the parameter that is its system id, in all versions."""
    calibrations: ClassVar[tuple[Calibration, ...]] = ()
    """Slots for the calibrations of its sensors; each kind of sensor requires at least one."""
    filter_message: ClassVar[tuple[str, int]] = ("ESTIMATOR_STATUS", 230)
    """Name and id of the message with the state of its filter."""
    filter_tests: ClassVar[tuple[str, ...]] = ()
    """Fields of it that compare measurements with the filter."""
    filter_limit: ClassVar[float] = 1.0
    """It does not take off, or lands, if one of them reaches this."""
    vibration_fields: ClassVar[tuple[str, ...]] = ("vibration_x", "vibration_y", "vibration_z")
    """Fields of VIBRATION with accelerations."""
    vibration_mps2: ClassVar[tuple[float, float]] = (30.0, 60.0)
    """Limits from which vibration is raised, and too high, m/s²."""
    log_folders: ClassVar[tuple[str, ...]]
    """Folders of its logs by MAVLink FTP; the first existing one counts."""
    log_endings: ClassVar[tuple[str, ...]]
    """Suffixes of their names, in lower case; the first is the usual one."""
    taken_text: ClassVar[str] = ""
    """Beginning of the text by which it reports an upload to every station; empty if there is none."""
    kind_remedy: ClassVar[str]
    """How it is told what kind of vehicle it is."""
    crash_texts: ClassVar[re.Pattern[str]] = re.compile(r"\bcrash", re.IGNORECASE)
    """Its text after a crash."""

    @abstractmethod
    def to_wire(self, mission: Mission, *, current: int = 0) -> tuple[WireItem, ...]:
        """Return the items to upload, in the autopilot's numbering; `current` is a number of ours."""

    @abstractmethod
    def from_wire(self, items: Sequence[WireItem]) -> Mission:
        """Return the mission of downloaded items, in our numbering."""

    @abstractmethod
    def meaning(self, item: MissionItem) -> Meaning:
        """Return the fields of an item that the autopilot keeps and acts on, in one form for all equivalent encodings."""

    def relies_on_fence(self, values: Mapping[str, float]) -> bool:  # noqa: ARG002
        """Whether values of its settings, by their keys, make it act on the areas of a fence, and on nothing else."""
        return False

    @abstractmethod
    def disarm(self) -> tuple[MissionItem, ...]:
        """Return the items that disarm on the ground after a landing; empty where landing or its end does so."""

    @abstractmethod
    def leave_armed_hold(self, above: MissionItem) -> tuple[MissionItem, ...]:
        """Return the items that leave a pad after a hold with turning propellers, to the waypoint above it."""

    @abstractmethod
    def cannot_fly(self, document: MissionDocument) -> Iterator[Finding]:
        """Return the items that this autopilot refuses, drops or interprets differently."""

    @abstractmethod
    def parameters(self, needs: FlightNeeds) -> tuple[Parameter, ...]:
        """Return the parameters that a mission with these needs requires."""

    def parameter_file(self, parameters: Sequence[Parameter], firmware: str) -> str:
        """Return the text of a parameter file for a version of its firmware, such as ``4.6`` or ``main``."""
        version = version_of(firmware)
        words = f"{self.name} {firmware} (another version: --firmware)"
        return dumps(parameters, firmware=words, way=lambda need: self.settings.in_version(need, version))

    def refusals(self, texts: Sequence[str]) -> list[str]:  # noqa: ARG002  of a family that says nothing
        """The texts of a vehicle that refuse the mission that it has accepted."""
        return []

    def items_refused(self, texts: Sequence[str]) -> tuple[int, ...]:  # noqa: ARG002
        """Our numbers of the items concerned by such texts."""
        return ()
