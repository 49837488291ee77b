"""Events of a tlog: status texts, modes, arming, states; and the kind of each vehicle."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.log import MAX_EVENTS, LogEvent
from skyway.link.logs.common.messages import ARMED_FLAG, GROUND_TYPES, on_rotors
from skyway.link.logs.common.trust import DoubtedSpans, doubt_in
from skyway.link.logs.common.vehicle_kind import WATCHED, KindEvidence, Vehicle
from skyway.missions.autopilots.registry import family_of
from skyway.models.base.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import Kind
    from skyway.link.logs.tlog.tlog import Frames

    Times = NDArray[np.float64]
    Column = NDArray[Any]
    """A value of each message."""

AUTOPILOT_COMPONENT, NO_AUTOPILOT = 1, 8
TEXT_BYTES = 50
"""A longer status text of MAVLink 2 comes in pieces of this length."""
_STATES = {5: "failsafe", 6: "emergency", 8: "flight termination"}
"""MAV_STATE of HEARTBEAT that are shown to a person."""


class TlogEvents:
    """Collects events chunk by chunk; modes are named once the kind of the vehicle is known."""

    def __init__(self) -> None:
        self._told: list[tuple[float, int, str | Callable[[Kind], str]]] = []
        self._evidence: dict[int, KindEvidence] = defaultdict(KindEvidence)
        self._doubts: dict[int, DoubtedSpans] = defaultdict(DoubtedSpans)
        self._state: dict[tuple[int, str], int] = {}
        self._texts: dict[tuple[int, int], str] = {}

    def see(self, frames: Frames, times: NDArray[np.float64]) -> None:
        """Take the messages of a chunk."""
        for name, hear in (
            ("HEARTBEAT", self._heartbeats),
            ("EXTENDED_SYS_STATE", self._extended),
            ("STATUSTEXT", self._statustexts),
            ("MISSION_ITEM_REACHED", self._reached),
            ("PARAM_VALUE", self._parameters),
        ):
            rows = frames.rows_of(name)
            if len(rows):
                hear(times[rows], frames.system[rows], frames.component[rows], frames.decoded(name, rows))

    def vehicles(self) -> dict[int, Vehicle]:
        """Type of each system."""
        return {system: evidence.vehicle() for system, evidence in self._evidence.items()}

    def events(self) -> tuple[LogEvent, ...]:
        """Events in order of time."""
        kinds = {system: vehicle.kind for system, vehicle in self.vehicles().items()}
        found = [
            LogEvent(time_s, system, text if isinstance(text, str) else text(kinds.get(system, "unknown")))
            for time_s, system, text in self._told
        ]
        return tuple(sorted(found, key=lambda event: event.time_s))

    def doubted(self) -> dict[int, tuple[tuple[float, float], ...]]:
        """Spans in which each vehicle reported that it does not trust its position."""
        return {system: spans for system, doubts in self._doubts.items() if (spans := doubts.spans())}

    def _say(self, time_s: float, system: int, text: str | Callable[[Kind], str]) -> None:
        if len(self._told) < MAX_EVENTS:
            self._told.append((float(time_s), int(system), text))

    def _heartbeats(self, times: Times, systems: Column, components: Column, fields: Column) -> None:
        mine = (components == AUTOPILOT_COMPONENT) & (fields["autopilot"] != NO_AUTOPILOT)
        mine &= ~np.isin(fields["type"], GROUND_TYPES)
        for system in np.unique(systems[mine]).tolist():
            rows = np.flatnonzero(mine & (systems == system))
            beats = fields[rows]
            evidence = self._evidence[system]
            for kind in np.unique(beats["type"])[:8].tolist():
                evidence.types.setdefault(kind, None)
            if np.any((beats["type"] == 1) & on_rotors(beats["autopilot"], beats["custom_mode"])[1]):
                evidence.hovers = "its modes of flight"
            armed = ((beats["base_mode"] & ARMED_FLAG) != 0).astype(np.int64)
            self._changes(system, "armed", times[rows], armed, lambda _, now: "armed" if now else "disarmed")
            # the autopilot is the high part, so that a mode is named by its autopilot
            modes = (beats["autopilot"].astype(np.int64) << 32) | beats["custom_mode"]
            self._changes(system, "mode", times[rows], modes, _mode_text)
            self._changes(system, "state", times[rows], beats["system_status"].astype(np.int64), _state_text)

    def _extended(self, times: Times, systems: Column, components: Column, fields: Column) -> None:
        for system in np.unique(systems[components == AUTOPILOT_COMPONENT]).tolist():
            rows = np.flatnonzero((systems == system) & (components == AUTOPILOT_COMPONENT))
            landed = fields["landed_state"][rows].astype(np.int64)
            known = (landed == 1) | (landed == 2)
            ground = (landed[known] == 1).astype(np.int64)
            self._changes(system, "landed", times[rows][known], ground, _landed_text)
            vtol = fields["vtol_state"][rows].astype(np.int64)
            if np.any(vtol > 0):
                self._evidence[system].hovers = "EXTENDED_SYS_STATE.vtol_state"
                self._changes(system, "vtol", times[rows], vtol, _vtol_text)

    def _changes(
        self,
        system: int,
        name: str,
        times: NDArray[np.float64],
        values: NDArray[np.int64],
        words: Callable[[int | None, int], str | Callable[[Kind], str]],
    ) -> None:
        """Report changes of a state."""
        if not len(values):
            return
        before = self._state.get((system, name))
        first = np.array([before is None or before != values[0]])
        for row in np.flatnonzero(np.concatenate([first, np.diff(values) != 0]))[:MAX_EVENTS].tolist():
            text = words(before, int(values[row]))
            before = int(values[row])
            if text:
                self._say(times[row], system, text)
        self._state[system, name] = int(values[-1])

    def _statustexts(self, times: Times, systems: Column, _: Column, fields: Column) -> None:
        for row, values in enumerate(fields[:MAX_EVENTS]):
            system, number = int(systems[row]), int(values["id"])
            text = bytes(values["text"]).split(b"\0")[0].decode("utf-8", "replace")
            if number:
                text = (self._texts.pop((system, number), "") if values["chunk_seq"] else "") + text
                if len(bytes(values["text"]).split(b"\0")[0]) == TEXT_BYTES and len(text) < 20 * TEXT_BYTES:
                    self._texts[system, number] = text  # it continues
                    continue
            said = one_line(text)
            self._say(times[row], system, said)
            self._evidence[system].text(said)
            self._doubts[system].hear(float(times[row]), "position", doubts=doubt_in(said))

    def _reached(self, times: Times, systems: Column, _: Column, fields: Column) -> None:
        for row, number in enumerate(fields["seq"][:MAX_EVENTS].tolist()):
            if self._state.get((int(systems[row]), "reached")) != number:  # PX4 reports it ten times
                self._state[int(systems[row]), "reached"] = number
                self._say(times[row], systems[row], f"mission item {number} reached")

    def _parameters(self, _: Times, systems: Column, __: Column, fields: Column) -> None:
        names = fields["param_id"]
        for row in np.flatnonzero(np.isin(names, [name.encode() for name in WATCHED])).tolist():
            value = float(fields["param_value"][row])
            if fields["param_type"][row] in (1, 2, 3, 4, 5, 6) and 0.0 < abs(value) < 1e-30:
                value = float(
                    fields["param_value"][row : row + 1].view(np.int32)[0]
                )  # PX4 sends the bytes of a whole number
            self._evidence[int(systems[row])].parameter(names[row].decode("ascii", "replace"), value)


def mode_name(autopilot: int, kind: Kind, custom_mode: int) -> str:
    """Name of ``HEARTBEAT.custom_mode`` of a MAV_AUTOPILOT."""
    family = family_of(autopilot)
    return f"number {custom_mode}" if family is None else family.modes.log_name(kind, custom_mode)


def _mode_text(_: int | None, mode: int) -> Callable[[Kind], str]:
    return lambda kind: f"mode {mode_name(mode >> 32, kind, mode & 0xFFFFFFFF)}"


def _state_text(before: int | None, state: int) -> str:
    return _STATES.get(state, f"{_STATES[before]} over" if before in _STATES else "")


def _landed_text(before: int | None, landed: int) -> str:
    return "" if before is None else "landed" if landed else "has left the ground"


def _vtol_text(before: int | None, state: int) -> str:
    names = {
        1: "transition to wings begun",
        2: "transition to rotors begun",
        3: "stands on rotors",
        4: "flies on wings",
    }
    return "" if before is None else names.get(state, "")
