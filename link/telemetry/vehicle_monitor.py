"""Monitor of one vehicle: its state, its telemetry, and changes that were not commanded."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.protocol.parameters import CHANGE_BY_THEMSELVES, read_value
from skyway.link.telemetry.batteries import MESSAGES, Batteries
from skyway.link.telemetry.live import RATES_HZ, WIND, LiveTelemetry
from skyway.link.telemetry.rates import RateKeeper
from skyway.link.telemetry.stored_lists import KINDS, StoredLists
from skyway.link.telemetry.traffic import Traffic
from skyway.missions.autopilots.registry import FAMILIES, family_named, family_of
from skyway.models.base.errors import Fault, InputError, VehicleTimeoutError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from skyway.link.protocol.connection import Connection, Peer
    from skyway.link.wire.messages import Message
    from skyway.models.drones.telemetry import TelemetrySample

FIND_S = 10.0
ALONE_S = 1.5
"""Listening time before anything is sent: heartbeats of other vehicles and stations come once a second."""
MISSION_STATES = ("unknown", "no mission", "not started", "active", "paused", "complete")
"""MISSION_STATE of MISSION_CURRENT; PX4 also reports ``no mission`` for one that it will not fly."""
INTERVAL = 511
"""MAV_CMD_SET_MESSAGE_INTERVAL."""
_EXPECTED_S = 5.0
"""A change within this time of a command of ours counts as its effect."""
CONFIRMED = 2
"""A change that was not commanded is accepted after this many consecutive reports."""
_WISHES = 2
_MAX_SAMPLES, _MAX_CHANGES = 1000, 200
_ARMED = 128
_MAX_PARAMETERS = 10_000
_UNTOLD = "untold"
_BYTEWISE, _AS_NUMBERS = 16, 131072
"""Of MAV_PROTOCOL_CAPABILITY: how whole numbers of parameters travel."""
_IDS = struct.Struct("<III")
_IDS_AT = 6
"""Fields of MISSION_CURRENT with the ids of stored lists (added to MAVLink in 2023; pymavlink's tables are older)."""


@dataclass(frozen=True, slots=True)
class Home:
    """Home of a vehicle: the zero of its heights, and the destination of a return."""

    lat_deg: float
    lon_deg: float
    """`lat_deg`, `lon_deg`: WGS-84."""
    alt_msl_m: float
    """Above mean sea level."""


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a vehicle's state."""

    what: str
    """``mode``, ``armed``, ``mission``, ``fence``, ``rally points`` (the stored lists), ``parameter NAME``, ``control``
    (system of the ground station in control) or ``boot``."""
    before: str
    after: str
    """`before`, `after`: for a person; of a mission its id and number of items. If a vehicle reports no ids, a
    different number of items is detected, and the text of a vehicle that sends one."""
    ours: bool
    """Whether a command of ours in the seconds before, or since the last different report, requests it. A change that is not
    ours was made by the vehicle itself (the end of a mission, a failsafe), its pilot, or another ground station: see the
    texts."""
    time_s: float
    """Time of its report, POSIX seconds."""

    def __str__(self) -> str:
        by = "" if self.ours else " (not commanded by this program)"
        return f"{self.what}: {self.before} -> {self.after}{by}"


class VehicleMonitor:
    """One vehicle on a connection that several may share, in its observed state.

    Without a system id it must be the only one; `autopilot` names its family, in place of the one in its heartbeat.
    Raises a `VehicleTimeoutError` if there is no such vehicle, an `InputError` if there are several, or if its
    autopilot is unknown.
    """

    def __init__(self, connection: Connection, system: int | None = None, autopilot: str | None = None) -> None:
        self.connection = connection
        self.peer: Peer = _find(connection, system)
        """State of the vehicle on the connection."""
        own = family_of(self.peer.autopilot)
        family = family_named(autopilot) if autopilot else own
        if autopilot and own is not None and own is not family:
            remedy = "leave it out, and the vehicle is asked"
            raise InputError(Fault(f"the vehicle is {own.name}", field="--autopilot", value=autopilot, remedy=remedy))
        if family is None:
            remedy = f"say which one it resembles with --autopilot {' or '.join(FAMILIES)}"
            raise InputError(Fault("an autopilot that skyway does not know", value=self.peer.autopilot, remedy=remedy))
        self.family = family
        """Its autopilot's."""
        self.resembles = own is None
        """Its autopilot is another one, of which a person says that it resembles this family."""
        self.live = LiveTelemetry(self.peer.system)
        """Its telemetry."""
        self.rates = RateKeeper(self.live)
        """Whether telemetry comes at the requested rates."""
        self._addressed = {"target_system": self.peer.system, "target_component": self.peer.component}
        self._new: list[TelemetrySample] = []
        self._changes: list[Change] = []
        self._expected: dict[str, tuple[frozenset[str], float]] = {}
        self._was: dict[str, str] = {}
        self._unconfirmed: dict[str, tuple[str, int]] = {}
        self._as_before_s: dict[str, float] = {}
        self.batteries = Batteries()
        """Its batteries."""
        self.traffic = Traffic()
        """Other aircraft that its receiver detects."""
        self._tells_ids = False
        self._lists: StoredLists | None = None
        self._lists_changed = False
        self._parameters: dict[str, float] = {}
        self.relied_on: set[str] = set()
        """Names of requested parameters, on which decisions depend."""
        self._told_texts = 0
        beat = self.peer.latest.get("HEARTBEAT")
        if beat is not None:
            self._note_state(beat)
        connection.listeners.append(self._hear)

    def _hear(self, peer: Peer, message: Message) -> None:
        if peer is not self.peer:
            return
        name = message.name
        boots = self.live.clock.reboots
        posix_s = self.connection.clock.posix_s()
        soc = math.nan
        if name in MESSAGES:
            now_s = self.connection.clock.now_s()
            self.batteries.hear(message, now_s)
            soc = self.batteries.soc(now_s)
        sample = self.live.hear(message, posix_s, soc)
        if sample is not None:
            self._new.append(sample)
            del self._new[:-_MAX_SAMPLES]
        if self.live.clock.reboots != boots:
            self._changed("boot", "up", "restarted")
        for number, rate in self.rates.heard(name, self.connection.clock.now_s()).items():
            for _ in range(_WISHES):  # no wait for an answer, and one may be lost
                self._wish(number, rate)
        asked_ns = self.live.clock.question(posix_s)
        if asked_ns is not None:
            self.connection.send("TIMESYNC", self.system, tc1=0, ts1=asked_ns, **self._addressed)
        if name == "HEARTBEAT":
            self._note_state(message)
        elif name == "MISSION_CURRENT":
            self._note_stored(message)
        elif name == "ADSB_VEHICLE":
            self.traffic.hear(message, self.live.sample, self.connection.clock.now_s())
        elif name == "CONTROL_STATUS":
            self._note("control", str(message["gcs_main"]))
        elif name == "PARAM_VALUE":
            self._note_parameter(message)
        elif name in ("MISSION_COUNT", "MISSION_ITEM_INT") and self._lists is not None:
            self._note_list(self._lists, message)
        elif name == "STATUSTEXT" and self._tells_taken(message) and not self._tells_ids:
            self._changed("mission", _UNTOLD, "accepted, as it reports")
        if self._lists is not None and not self._tells_ids and not self.connection.transferring:
            for asked, fields in self._lists.ask(self.connection.clock.now_s()):
                self.connection.send(asked, self.system, **fields, **self._addressed)

    @property
    def bytewise_parameters(self) -> bool:
        """Whether whole numbers of parameters travel as the bytes of a float: as in its family, or as it says itself if it only resembles it."""
        told = self.peer.latest.get("AUTOPILOT_VERSION") if self.resembles else None
        ways = 0 if told is None else told["capabilities"] & (_BYTEWISE | _AS_NUMBERS)
        return self.family.bytewise_parameters if ways in (0, _BYTEWISE | _AS_NUMBERS) else ways == _BYTEWISE

    def watch_lists(self, *, watched: bool) -> None:
        """Poll its stored lists regularly, if it does not report their ids itself."""
        self._lists = StoredLists(self.family.home_items) if watched else None

    def _note_list(self, lists: StoredLists, message: Message) -> None:
        ours = (message["target_system"], message["target_component"]) == (
            self.connection.system,
            self.connection.component,
        )
        found = lists.hear(message) if ours and not self.connection.transferring else None
        if found is not None:
            self._changed(*found)

    def _note_parameter(self, message: Message) -> None:
        """Compare a parameter with its last report."""
        told = read_value(message, bytewise=self.bytewise_parameters)
        before = self._parameters.get(told.name)
        if before is None and len(self._parameters) >= _MAX_PARAMETERS:
            return
        self._parameters[told.name] = told.value
        same = before is None or before == told.value or (math.isnan(before) and math.isnan(told.value))
        if not same and not told.name.startswith(CHANGE_BY_THEMSELVES):
            self._changed(f"parameter {told.name}", f"{before:g}", f"{told.value:g}")

    def _tells_taken(self, message: Message) -> bool:
        """Whether a text reports that a mission was uploaded, by any station."""
        begin = self.family.taken_text
        return bool(begin) and str(message["text"]).startswith(begin)

    def _note_state(self, beat: Message) -> None:
        self._note("mode", self.family.modes.name(beat["custom_mode"]))
        self._note("armed", "armed" if beat["base_mode"] & _ARMED else "disarmed")

    def _note_stored(self, message: Message) -> None:
        total = message["total"]
        items = "" if total == 0 else f", {0 if total == 0xFFFF else total} items"
        ids = _IDS.unpack(message.payload[_IDS_AT : _IDS_AT + _IDS.size].ljust(_IDS.size, b"\0"))
        self._tells_ids = self._tells_ids or any(ids)
        for kind, number in zip(KINDS, ids, strict=True):
            self._note(kind, f"id {number}{items if kind == 'mission' else ''}")

    def _note(self, what: str, now: str) -> None:
        before, now_s = self._was.setdefault(what, now), self.connection.clock.now_s()
        since_s = self._as_before_s.setdefault(what, now_s)
        if before == now:
            self._as_before_s[what] = now_s
            self._unconfirmed.pop(what, None)
            return
        told, times = self._unconfirmed.get(what, (now, 0))
        times = times + 1 if told == now else 1
        if times < CONFIRMED and not self._ours(what, now, since_s):
            self._unconfirmed[what] = now, times
            return
        self._unconfirmed.pop(what, None)
        self._was[what], self._as_before_s[what] = now, now_s
        self._changed(what, before, now, since_s)

    def _ours(self, what: str, after: str, since_s: float) -> bool:
        """Whether a command of ours requests a change that was made since the last different report."""
        wanted, until_s = self._expected.get(what, (frozenset(), -math.inf))
        return since_s <= until_s and (not wanted or after in wanted)

    def _changed(self, what: str, before: str, after: str, since_s: float | None = None) -> None:
        clock = self.connection.clock
        ours = self._ours(what, after, clock.now_s() if since_s is None else since_s)
        self._lists_changed = self._lists_changed or (what in KINDS and not ours)
        self._changes.append(Change(what, before, after, ours, clock.posix_s()))
        del self._changes[:-_MAX_CHANGES]

    def expect(self, what: str, *after: str, for_s: float = _EXPECTED_S) -> None:
        """Announce that a command of ours is about to change something, to one of these values; none means any value."""
        if self._lists is not None:
            self._lists.forget(what)
        self._expected[what] = (frozenset(after), self.connection.clock.now_s() + for_s)

    def changes(self) -> list[Change]:
        """Return the changes since the last call, the oldest first."""
        found, self._changes = self._changes, []
        return found

    def take_lists_changed(self) -> bool:
        """Whether another station has changed a stored list since the last call."""
        found, self._lists_changed = self._lists_changed, False
        return found

    @property
    def system(self) -> int:
        """Its system id."""
        return self.peer.system

    @property
    def armed(self) -> bool:
        """Whether its heartbeats report armed; a vehicle without a heartbeat counts as armed."""
        return self._was.get("armed") != "disarmed"

    @property
    def mode(self) -> str:
        """Its mode, for a person."""
        return self._was.get("mode", "unknown")

    @property
    def changing(self) -> bool:
        """Whether it has just reported a change that was not commanded, and that is not confirmed yet."""
        return bool(self._unconfirmed)

    @property
    def mission_state(self) -> str:
        """Its reported mission state: one of `MISSION_STATES`."""
        said = self.peer.latest.get("MISSION_CURRENT")
        number = 0 if said is None else said["mission_state"]
        return MISSION_STATES[number] if number < len(MISSION_STATES) else MISSION_STATES[0]

    @property
    def reboots(self) -> int:
        """Number of restarts since its first packet."""
        return self.live.clock.reboots

    @property
    def silent_s(self) -> float:
        """Time since its last packet."""
        return self.connection.clock.now_s() - self.peer.heard_s

    def texts(self) -> list[str]:
        """Its messages, newest last; only the last 200 are kept."""
        return [text for _, text in self.peer.texts]

    def new_texts(self) -> list[tuple[int, str]]:
        """Its messages since the last call: MAV_SEVERITY and text, oldest first.

        A long text comes in pieces: the newest one is held back as long as more pieces may come.
        """
        peer = self.peer
        kept_back = int(peer.text_unfinished(self.connection.clock.now_s()))
        fresh = peer.said - kept_back - self._told_texts
        if fresh <= 0:
            return []
        self._told_texts += fresh
        end = len(peer.texts) - kept_back
        return peer.texts[max(end - fresh, 0) : end]

    def its_messages(self, rates_hz: Mapping[int, float] = RATES_HZ) -> dict[int, float]:
        """Return the messages that telemetry is made of, for its autopilot: the message for the wind differs."""
        return {self.family.wind_message if number == WIND else number: rate for number, rate in rates_hz.items()}

    def nudge_telemetry(self) -> None:
        """Request telemetry without waiting for answers; to be repeated as long as nothing arrives."""
        wanted = self.its_messages()
        self.rates.want(wanted, self.connection.clock.now_s())
        self.connection.keep_rates(wanted)
        for number, rate in wanted.items():
            self._wish(number, rate)

    def _wish(self, number: int, rate_hz: float) -> None:
        wish = {"command": INTERVAL, "param1": float(number), "param2": 1e6 / rate_hz}
        self.connection.send("COMMAND_LONG", self.system, **wish, **self._addressed)

    def take_samples(self) -> list[TelemetrySample]:
        """Return the samples since the last call, at most a thousand; does not wait."""
        ready, self._new = self._new, []
        return ready

    @property
    def disturbed(self) -> bool:
        """Whether another station has changed something since the last call of `changes`."""
        return any(not change.ours for change in self._changes)

    def samples(self, duration_s: float = math.inf, *, undisturbed: bool = False) -> Iterator[TelemetrySample]:
        """Yield telemetry as it arrives.

        Ends after the time, when the vehicle is silent for 10 s, or, if requested, when it is `disturbed`.
        """
        clock = self.connection.clock
        end = clock.now_s() + duration_s
        while clock.now_s() < end:
            ready = self.take_samples()
            yield from ready
            if undisturbed and self.disturbed:
                return
            if not ready and not self.connection.wait(lambda: bool(self._new), min(FIND_S, end - clock.now_s())):
                return


def _find(connection: Connection, system: int | None) -> Peer:
    """Wait for a vehicle, and listen long enough to detect other stations."""
    known = connection.peers
    if not connection.wait(lambda: bool(known) if system is None else system in known, FIND_S):
        if connection.namesake:
            problem, remedy = (
                "the vehicle has this system id itself",
                f"another one, such as {255 - (connection.system == 255)}",
            )
            raise InputError(Fault(problem, field="--gcs-system", value=connection.system, remedy=remedy))
        rejected = connection.rejected
        doubted = rejected.unsigned + rejected.forged + rejected.replayed
        if doubted and doubted == rejected.unsigned:
            problem = f"the vehicle does not sign its packets: {doubted} were rejected"
            raise InputError(
                Fault(problem, field="--key-file", remedy="connect without a key, or set up signing on the vehicle")
            )
        if doubted:
            problem = f"no packet is signed with our key: {doubted} were rejected"
            raise InputError(Fault(problem, field="--key-file", remedy="the key that the vehicle has"))
        others = f" of system {system}, only of {', '.join(map(str, sorted(known)))}" if known else _others(connection)
        raise VehicleTimeoutError(f"no heartbeat{others}", FIND_S)
    heard_for_s = connection.clock.now_s() - min(peer.met_s for peer in known.values())
    connection.run_for(ALONE_S - heard_for_s)
    if system is not None:
        return known[system]
    if len(known) > 1:
        heard = ", ".join(map(str, sorted(known)))
        raise InputError(
            Fault("there are several vehicles on this connection", field="--system", remedy=f"one of {heard}")
        )
    return next(iter(known.values()))


def _others(connection: Connection) -> str:
    """Say who beats on a connection without a vehicle: it may be the wrong one."""
    heard = [f"ground station {system}" for system, _ in sorted(connection.stations.heard_s)]
    heard += [
        f"system {system} component {component} (type {kind}, autopilot {firmware})"
        for (system, component), (kind, firmware) in sorted(connection.strangers.items())
    ]
    return f" of an autopilot, only of {', '.join(dict.fromkeys(heard))}" if heard else ""
