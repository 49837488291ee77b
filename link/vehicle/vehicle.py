"""A vehicle on a link: its identity, its control, and its stored lists."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.logs.common.vehicle_kind import MAV_KINDS
from skyway.link.protocol.command import RESULTS, AskFor, Place, SetCurrent
from skyway.link.protocol.download import Clear, Download
from skyway.link.protocol.mission_words import ACCEPTED, MissionKind, in_words
from skyway.link.protocol.verified import (
    UploadJob,
    UploadOutcome,
    UploadState,
    compare,
    decode,
    encode,
    kind_of,
    upload_verified,
)
from skyway.link.telemetry.vehicle_monitor import Home
from skyway.link.vehicle import operator_control
from skyway.link.vehicle.questions import AskedVehicle
from skyway.models.base.errors import (
    CommandRefusedError,
    Fault,
    InputError,
    LinkError,
    ListUnreadError,
    ListUnsupportedError,
    UploadMismatchError,
    VehicleTimeoutError,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.protocol.connection import Connection
    from skyway.link.protocol.verified import Part
    from skyway.missions.autopilots.read_back import Difference
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.items.mission import Mission

_ARM, _LAND, _RETURN, _GRIPPER, _REPOSITION = 400, 21, 20, 211, 192
_WINCH_STATUS = 9005
_SET_MODE, _PAUSE, _START, _BATTERY_RESET = 176, 193, 300, 42651
_SPEED, _GROUND_SPEED, _SAME_THROTTLE = 178, 1.0, -1.0
_MODE_S, _RETRY_ARM_S, _BATTERY_S = 8.0, 1.0, 3.0
_PERCENT = 0.0101
_ORDERS, _BEATS_S = 3, 3.0
_ABOVE_HOME, _ABOVE_SEA = 6, 0
"""MAV_FRAME_GLOBAL_RELATIVE_ALT_INT and MAV_FRAME_GLOBAL."""
CAPABILITIES = {
    1: "missions (float)",
    4: "missions",
    8: "commands with places",
    2048: "flight termination",
    8192: "MAVLink 2",
    16384: "fences",
    32768: "rally points",
}
TYPES: dict[int, str] = {
    **MAV_KINDS, 1: "plane", 2: "quadrotor", 3: "coaxial", 4: "helicopter", 13: "hexarotor", 14: "octorotor",
}  # fmt: skip
"""MAV_TYPE in words."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a vehicle."""

    system: int
    """MAVLink system id."""
    autopilot: str
    """Name of its family."""
    kind: int
    """MAV_TYPE."""
    version: str = ""
    """Of the flight software, such as ``4.6.0``; empty where it does not tell."""
    capabilities: int = 0
    """MAV_PROTOCOL_CAPABILITY bits; 0 where it does not tell."""
    uid: int = 0
    """Hardware id; 0 where it does not tell."""

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


class Vehicle(AskedVehicle):
    """One vehicle on a connection, commanded; arguments and errors as of `VehicleMonitor`.

    Every method may raise a `LinkError`; what moves the vehicle says so in words when it is refused.
    """

    def __init__(self, connection: Connection, system: int | None = None, autopilot: str | None = None) -> None:
        super().__init__(connection, system, autopilot)
        self._blocked: dict[MissionKind, UploadOutcome] = {}

    @property
    def blocked(self) -> UploadOutcome | None:
        """An upload after which it is not started: what the vehicle holds is unknown, or it will not fly it."""
        return next(iter(self._blocked.values()), None)

    def _refuse_while_blocked(self, what: str) -> None:
        if self.blocked is not None:
            raise UploadMismatchError(f"{what}: after the last upload of its {self.blocked}")

    def close(self) -> None:
        """End what speaks with it besides the connection, which stays open."""

    def identify(self) -> Identity:
        """Return its identity; parts that it does not report stay unknown."""
        found = self._do(AskFor(self.peer.target, "AUTOPILOT_VERSION", 148)).message
        identity = Identity(self.system, self.family.name, self.peer.kind)
        if found is None:
            return identity
        version, capabilities, uid = (found[name] for name in ("flight_sw_version", "capabilities", "uid"))
        return Identity(self.system, self.family.name, self.peer.kind, version_text(version), capabilities, uid)

    @property
    def controller(self) -> int | None:
        """System of the station that is in control of it; 0 for none, None where it does not say."""
        return operator_control.controller(self.peer)

    @property
    def obeys_us(self) -> bool:
        """Whether it obeys our orders, as far as it reports who is in control."""
        return operator_control.may_command(self.peer, self.connection.system)

    def take_control(self) -> None:
        """Request control where it reports who has it. Raises a `CommandRefusedError` if another station keeps it."""
        if self.controller in (None, self.connection.system):
            return
        result = self._do(operator_control.request(self.peer.target, self.connection.system)).result
        if result != ACCEPTED:
            told = f"ground station {self.controller} is in control, and was asked to give way"
            raise CommandRefusedError(
                "be controlled by us", told if self.controller else RESULTS.get(result or 4, "no answer")
            )
        self.connection.wait(lambda: self.controller == self.connection.system, _BEATS_S)

    def give_control_back(self) -> None:
        """Release control, where we have it."""
        if self.controller == self.connection.system:
            self._do(operator_control.release(self.peer.target, self.connection.system))

    def arm(self, patience_s: float = 0.0) -> None:
        """Arm, until a heartbeat confirms it; retry for so long while it is not ready."""
        self.check_ground_station()
        end = self.connection.clock.now_s() + patience_s
        while True:
            try:
                self._switch_motors("arm", on=True)
            except CommandRefusedError:
                if self.connection.clock.now_s() >= end:
                    raise
                self.connection.run_for(_RETRY_ARM_S)
            else:
                return

    def disarm(self) -> None:
        """Disarm, until a heartbeat confirms it."""
        self._switch_motors("disarm", on=False)

    def _switch_motors(self, what: str, *, on: bool) -> None:
        """Order it until it is so: the answer to arming, doubled and late, reads like one to disarming."""
        for _ in range(_ORDERS):
            self.expect("armed", f"{what}ed")
            self.command(what, _ARM, float(on))
            if self.connection.wait(lambda: self.armed == on, _BEATS_S):
                return
        raise CommandRefusedError(what, f"it agrees, and stays {'dis' if on else ''}armed", self.texts()[-2:])

    def set_mode(self, name: str) -> None:
        """Switch the mode, and wait until a heartbeat confirms it."""
        number = self.family.modes.numbers.get(name)
        if number is None:
            raise InputError(Fault("no such mode", value=name, remedy=f"one of {', '.join(self.family.modes.numbers)}"))
        self.expect("mode", self.family.modes.name(number))
        self.command(f"switch to {name}", _SET_MODE, 1.0, *self.family.modes.command(number))
        beats = self.peer.latest
        if not self.connection.wait(lambda: beats["HEARTBEAT"]["custom_mode"] == number, _MODE_S):
            raise CommandRefusedError(f"switch to {name}", f"it stays in {self.mode}")

    def start(self, patience_s: float = 0.0) -> None:
        """Arm and fly the mission from its beginning."""
        self._refuse_while_blocked("start blocked")
        self._set_current(0)
        if self.family.arms_in is not None:
            self.set_mode(self.family.arms_in)
            self.arm(patience_s)
            self.set_mode("mission")
        else:
            self.arm(patience_s)
        self.expect("mode", "mission")
        self.command("start the mission", _START)

    def pause(self) -> None:
        """Stop on the way."""
        if self.family.pauses_in_mission and self.mode == "mission":
            self.command("pause", _PAUSE, 0.0)
        else:
            self.set_mode("hold")

    def resume(self) -> None:
        """Continue with the mission."""
        self._refuse_while_blocked("not resumed")
        if self.family.pauses_in_mission and self.mode == "mission":
            self.command("continue", _PAUSE, 1.0)
        else:
            self.set_mode("mission")

    def change_speed(self, ground_speed_mps: float) -> None:
        """Fly the mission on at another ground speed; the vehicle's own limit caps it."""
        if not 0.0 < ground_speed_mps < math.inf:
            raise InputError(Fault("is not a speed", field="ground_speed_mps", value=ground_speed_mps))
        self.command("change its speed", _SPEED, _GROUND_SPEED, ground_speed_mps, _SAME_THROTTLE)

    def go_to(self, lat_deg: float, lon_deg: float, height_m: float) -> None:
        """Fly there, height above home, and stay."""
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and math.isfinite(height_m)):
            raise InputError(Fault("is not a place on Earth", value=(lat_deg, lon_deg, height_m)))
        relative = self.family.heeds_frames
        height_m += 0.0 if relative else self.home().alt_msl_m
        place = Place(round(lat_deg * 1e7), round(lon_deg * 1e7), height_m, _ABOVE_HOME if relative else _ABOVE_SEA)
        modes, yaw = self.family.modes, self.family.open_yaw_deg
        guided = modes.name(modes.numbers["guided"])
        self._order("go there", (guided,), _REPOSITION, -1.0, 1.0, 0.0, yaw, place=place)

    def _order(
        self, what: str, modes: Sequence[str], number: int, *parameters: float, place: Place | None = None
    ) -> None:
        """Give a command that changes the mode, until a heartbeat says so or it stands disarmed."""
        for _ in range(_ORDERS):
            self.expect("mode", *modes)
            self.command(what, number, *parameters, place=place)
            if self.connection.wait(lambda: self.mode in modes or not self.armed, _MODE_S):
                return
        raise CommandRefusedError(what, f"it agrees, and stays in {self.mode}", self.texts()[-2:])

    def return_home(self) -> None:
        """Return as the vehicle's parameters say."""
        self._order("return", ("return", "land"), _RETURN)

    def land(self) -> None:
        """Land here."""
        self._order("land", ("land",), _LAND)

    def release(self) -> None:
        """Let the package go."""
        self.command("release the package", _GRIPPER, 1.0, 0.0)

    def winch_line_m(self) -> float | None:
        """Line that its winch has out, m; None where it does not tell."""
        said = self._do(AskFor(self.peer.target, "WINCH_STATUS", _WINCH_STATUS)).message
        line_m = math.nan if said is None else float(said["line_length"])
        return line_m if math.isfinite(line_m) else None

    def reset_battery(self, soc: float) -> float:
        """Set its battery counter to the true charge; a vehicle without such a command refuses it.

        Returns the state of charge that it reports within 3 s, 0-1; NaN where it reports none.
        """
        if not 0.0 <= soc <= 1.0:
            raise InputError(Fault("out of range", field="soc", value=soc, remedy="0 to 1"))
        self.command("reset the battery's counter", _BATTERY_RESET, 1.0, 100.0 * soc)
        self.connection.wait(lambda: abs(self.live.latest("soc") - soc) <= _PERCENT, _BATTERY_S)
        return self.live.latest("soc")

    def home(self) -> Home:
        """Ask where it counts heights from now; it moves when the vehicle arms."""
        said = self._do(AskFor(self.peer.target, "HOME_POSITION", 242)).message
        said = said or self.peer.latest.get("HOME_POSITION")
        if said is None:
            raise VehicleTimeoutError("its home (it may have no position yet)", self.waited_s)
        return Home(said["latitude"] * 1e-7, said["longitude"] * 1e-7, said["altitude"] * 1e-3)

    def upload(
        self, part: Part, *, current: int = 0, progress: Callable[[str, int, int], None] | None = None
    ) -> UploadOutcome:
        """Upload a mission, a fence or rally points, and read them back."""
        self._refuse_lists_of_version_1(kind_of(part))
        said = self.peer.said
        job = UploadJob(
            self.peer.target,
            self.family,
            part,
            current,
            may_roll_back=lambda: not self.armed,
            texts=lambda: self.peer.texts_since(said),
            progress=progress,
        )
        broken = "parts of what was being sent: the upload was interrupted"
        self._blocked[job.kind] = UploadOutcome(UploadState.UNKNOWN, job.kind, broken)
        self.expect(job.kind.word, for_s=math.inf)
        try:
            outcome = self._runner.perform(upload_verified(job))
        finally:
            self.expect(job.kind.word)
        self._blocked[job.kind] = outcome
        if not outcome.blocks_start:
            del self._blocked[job.kind]
        return outcome

    def check_uploads(self, parts: Sequence[Part]) -> None:
        """Make sure, as far as it can be known before, that it takes these parts; nothing is changed on it.

        Raises an `InputError` for what MAVLink cannot hold, and a `CommandRefusedError` for lists that it does not have.
        """
        for part in parts:
            encode(part, self.family)
        for kind in map(kind_of, parts):
            if kind is not MissionKind.MISSION:
                self._download(kind)

    def change_in_flight(self, mission: Mission, current: int, *, holds: bool = True) -> UploadOutcome:
        """Hold, upload, read back, set the current item, resume; stay in hold where it is not verified.

        Without `holds` it flies on meanwhile: of a vehicle that takes uploads whole, where all up to the current item stays as it is.
        """
        if not holds:
            outcome = self.upload(mission, current=current)
            if not outcome.verified:
                self.set_mode("hold")
            return outcome
        self.set_mode("hold")
        outcome = self.upload(mission, current=current)
        if outcome.verified:
            self.set_current(current)
            self.resume()
        return outcome

    def _refuse_lists_of_version_1(self, kind: MissionKind) -> None:
        """MAVLink 1 has no word for other lists: it would take a fence for a mission."""
        if kind is not MissionKind.MISSION and self.peer.version == 1:
            raise CommandRefusedError(f"tell or take its {kind.word}", "it speaks MAVLink 1, which knows missions only")

    def _download(self, kind: MissionKind) -> tuple[WireItem, ...]:
        self._refuse_lists_of_version_1(kind)
        down = self._do(Download(self.peer.target, kind))
        if down.lacks:
            raise ListUnsupportedError(f"tell its {kind.word}", down.problem)
        if down.items is None:
            raise ListUnreadError(kind.word, down.problem, self.waited_s)
        return down.items

    def download(self, kind: MissionKind) -> Part:
        """Read what it holds, in our numbering."""
        return decode(self._download(kind), kind, self.family)

    def verify(self, part: Part) -> tuple[Difference, ...]:
        """Return how what it holds differs in meaning."""
        return compare(part, self._download(kind_of(part)), self.family)

    def clear(self, kind: MissionKind) -> None:
        """Clear one kind, and read back that it is gone; nothing is sent where the vehicle has no such lists."""
        self._refuse_lists_of_version_1(kind)
        self.expect(kind.word)
        if kind is not MissionKind.MISSION and self._do(Download(self.peer.target, kind)).lacks:
            self._blocked.pop(kind, None)  # one that ignores the kind would clear its mission
            return
        cleared = self._do(Clear(self.peer.target, kind))
        down = self._do(Download(self.peer.target, kind))
        left = 0 if down.lacks else None if down.items is None else len(down.items)
        home = self.family.home_items if kind is MissionKind.MISSION else 0
        if left is not None and left <= home:
            self._blocked.pop(kind, None)
            return
        if cleared.answer not in (None, ACCEPTED):
            raise CommandRefusedError(f"clear its {kind.word}", in_words(cleared.answer), self.texts()[-1:])
        raise LinkError(f"its {kind.word} may not be cleared: {'no answer' if left is None else f'{left} items left'}")

    def set_current(self, item: int) -> None:
        """Make one of our items the next to be flown."""
        self._set_current(item + self.family.home_items)

    def _set_current(self, number: int) -> None:
        if not self._do(SetCurrent(self.peer.target, number)).confirmed:
            raise CommandRefusedError(f"make item {number} (its own number) the current one", "it does not say so")
