"""What a dialect is: everything about missions in which one autopilot differs from another."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.dialects.settings import Settings
    from skyway.missions.dialects.wire import WireItem
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.mission import Mission, MissionItem
    from skyway.missions.items.parameters import FlightNeeds, Parameter

Meaning = dict[str, float | str | None]
"""What an item means to an autopilot, field by field; None is "not given"."""


class Dialect(Protocol):
    """One autopilot's way with missions."""

    @property
    def name(self) -> str:
        """``px4`` or ``ardupilot``."""

    @property
    def firmware(self) -> int:
        """MAV_AUTOPILOT."""

    @property
    def stays_in_mission_after_landing(self) -> bool:
        """Whether a mission goes on after a landing that disarms."""

    @property
    def zero_means_as_it_is(self) -> bool:
        """Whether a TAKEOFF climbs where the vehicle stands, whatever its place, and an altitude of 0 keeps the height."""

    @property
    def open_yaw_deg(self) -> float:
        """What the yaw of an item says where the vehicle shall choose it."""

    @property
    def settings(self) -> Settings:
        """What its parameters are called in each version."""

    @property
    def firmwares(self) -> tuple[str, ...]:
        """Versions of its firmware that are known, the oldest first."""

    @property
    def released(self) -> str:
        """The newest of them that is released."""

    def to_wire(self, mission: Mission, *, current: int = 0) -> tuple[WireItem, ...]:
        """Return the items to upload, in the autopilot's numbering; `current` is a number of ours."""

    def from_wire(self, items: Sequence[WireItem]) -> Mission:
        """Return the mission of downloaded items, in our numbering."""

    def meaning(self, item: MissionItem) -> Meaning:
        """Return the fields of an item that the autopilot keeps and acts on, in one form for all its spellings."""

    def disarm(self) -> tuple[MissionItem, ...]:
        """Return the items that disarm on the ground after a landing; empty where landing or its end does so."""

    def leave_armed_hold(self, above: MissionItem) -> tuple[MissionItem, ...]:
        """Return the items that leave a pad after a hold with turning propellers, to the waypoint above it."""

    def cannot_fly(self, document: MissionDocument) -> Iterator[Finding]:
        """Tell what this autopilot refuses, drops or takes otherwise than meant."""

    def parameters(self, needs: FlightNeeds) -> tuple[Parameter, ...]:
        """Return the parameters that a mission with these needs relies on."""
