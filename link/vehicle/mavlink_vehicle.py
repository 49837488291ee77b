"""The default driver: pymavlink's message definitions and our own protocol state machines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol, TypeVar

from skyway.link.protocol.command import RESULTS, AskFor, Command, Place
from skyway.link.protocol.download import Clear, Download
from skyway.link.protocol.mission_words import ACCEPTED, MissionKind, in_words
from skyway.link.protocol.parameters import (
    GIVE_UP_S,
    PARAMETER_ERRORS,
    ListParameters,
    ParameterCheck,
    ParameterValue,
    ReadParameters,
    SetParameter,
    check_parameters,
    same_value,
)
from skyway.link.protocol.set_current import SetCurrent
from skyway.link.protocol.verified import (
    UploadJob,
    UploadOutcome,
    UploadState,
    compare,
    decode,
    kind_of,
    upload_verified,
)
from skyway.link.telemetry.live import RATES_HZ
from skyway.link.telemetry.vehicle_monitor import INTERVAL, Home, VehicleMonitor
from skyway.link.vehicle.vehicle import Identity, version_text
from skyway.missions.items.parameters import UNITS
from skyway.models.base.errors import (
    CommandRefusedError,
    Fault,
    InputError,
    LinkError,
    ParameterAbsentError,
    UploadMismatchError,
    VehicleTimeoutError,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from skyway.link.protocol.connection import Connection
    from skyway.link.protocol.exchange import Exchange, Steps
    from skyway.link.protocol.verified import Part
    from skyway.missions.autopilots.read_back import Difference
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.items.mission import Mission
    from skyway.missions.items.parameters import Parameter

E_ = TypeVar("E_", bound="Exchange")
T = TypeVar("T")
_ARM, _LAND, _RETURN, _GRIPPER, _REPOSITION = 400, 21, 20, 211, 192
_SET_MODE, _PAUSE, _START, _BATTERY_RESET = 176, 193, 300, 42651
_SPEED, _GROUND_SPEED, _SAME_THROTTLE = 178, 1.0, -1.0
_MODE_S, _RETRY_ARM_S, _BATTERY_S = 8.0, 1.0, 3.0
_REQUEST_MESSAGE, _VERSION, _ANSWERS_S = 512, 148.0, 3.0
SETS = 4
"""Tries to set a parameter before the value it keeps is its answer."""
_PERCENT = 0.0101
_ORDERS, _BEATS_S = 3, 3.0
_ABOVE_HOME, _ABOVE_SEA = 6, 0
"""MAV_FRAME_GLOBAL_RELATIVE_ALT_INT and MAV_FRAME_GLOBAL."""


class ExchangeRunner(Protocol):
    """Who carries exchanges with a vehicle out: the connection itself, or another library on it."""

    def perform(self, steps: Steps[T]) -> T:
        """Carry a procedure out."""
        ...


class MavlinkVehicle(VehicleMonitor):
    """One vehicle on a connection, commanded.

    Parameters
    ----------
    connection : Connection
        The link; several vehicles may share it.
    system : int or None
        Which one; None is the only one heard.
    autopilot : str or None
        Name of its family where its heartbeat shall not decide.

    Raises
    ------
    VehicleTimeoutError
        No such vehicle is heard.
    InputError
        Several are heard, or its autopilot is none that we know.

    Attributes
    ----------
    own_names : dict
        Name and unit of settings, by their key, for firmware that calls them by a name that skyway does not know.
    """

    def __init__(self, connection: Connection, system: int | None = None, autopilot: str | None = None) -> None:
        super().__init__(connection, system, autopilot)
        self._blocked: dict[MissionKind, UploadOutcome] = {}
        self._runner: ExchangeRunner = connection
        self.own_names: dict[str, tuple[str, str]] = {}

    @property
    def blocked(self) -> UploadOutcome | None:
        """An upload after which it is not started: what the vehicle holds is not known, or it will not fly it."""
        return next(iter(self._blocked.values()), None)

    def _refuse_while_blocked(self, what: str) -> None:
        if self.blocked is not None:
            raise UploadMismatchError(f"{what}: after the last upload of its {self.blocked}")

    def close(self) -> None:
        """End what speaks with it besides the connection, which stays open."""

    def _do(self, exchange: E_) -> E_:
        def steps() -> Steps[None]:
            yield exchange

        self._runner.perform(steps())
        return exchange

    def identify(self) -> Identity:
        """Tell who it is; what it does not tell stays unknown."""
        found = self._do(AskFor(self.peer.target, "AUTOPILOT_VERSION", 148, round_trip=self.peer.round_trip)).message
        identity = Identity(self.system, self.family.name, self.peer.kind)
        if found is None:
            return identity
        version, capabilities, uid = (found[name] for name in ("flight_sw_version", "capabilities", "uid"))
        return Identity(self.system, self.family.name, self.peer.kind, version_text(version), capabilities, uid)

    def answers(self) -> bool:
        """Ask whether it hears us: any answer to a request that changes nothing will do."""
        asked = Command(
            self.peer.target, _REQUEST_MESSAGE, _VERSION, round_trip=self.peer.round_trip, give_up_s=_ANSWERS_S
        )
        return self._do(asked).result is not None

    def request_telemetry(self, rates_hz: Mapping[int, float] = RATES_HZ) -> tuple[int, ...]:
        """Ask for the messages that telemetry is made of; returns the ids of those refused.

        Raises
        ------
        VehicleTimeoutError
            No answer; what was not asked for yet is asked for again as long as it does not come.
        """
        wanted, refused = self.its_messages(rates_hz), []
        for number, rate in wanted.items():
            asked = Command(self.peer.target, INTERVAL, float(number), 1e6 / rate, round_trip=self.peer.round_trip)
            result = self._do(asked).result
            if result is None:
                self.rates.want(wanted, self.connection.clock.now_s())
                raise VehicleTimeoutError("its telemetry", asked.give_up_s)
            if result != ACCEPTED:
                refused.append(number)
        taken = {number: rate for number, rate in wanted.items() if number not in refused}
        self.rates.want(taken, self.connection.clock.now_s())
        return tuple(refused)

    def read_parameters(self, names: Sequence[str]) -> ReadParameters:
        """Read parameters by name, and tell which of them the vehicle does not have."""
        bytewise, trip = self.family.bytewise_parameters, self.peer.round_trip
        return self._do(ReadParameters(self.peer.target, names, bytewise=bytewise, round_trip=trip))

    def parameter(self, name: str) -> ParameterValue:
        """Read a parameter.

        Raises
        ------
        ParameterAbsentError
            The vehicle answers, and has none of that name.
        VehicleTimeoutError
            It does not answer.
        """
        read = self.read_parameters((name,))
        if name in read.found:
            return read.found[name]
        if name in read.absent:
            raise ParameterAbsentError((name,))
        raise VehicleTimeoutError(f"parameter {name}", GIVE_UP_S)

    def set_parameter(self, name: str, value: float) -> ParameterValue:
        """Set a parameter, and read it back.

        A late answer to an earlier question tells the old value as a refusal does: only one that is told after each of
        `SETS` tries is a refusal.
        """
        if not math.isfinite(value):
            raise InputError(Fault("not a finite number", field=name, value=value))
        kind = self.parameter(name).kind
        bytewise, trip = self.family.bytewise_parameters, self.peer.round_trip
        for _ in range(SETS):
            given = SetParameter(self.peer.target, name, value, kind, bytewise=bytewise, round_trip=trip)
            refused = self._do(given).refused
            after = self.parameter(name)
            if same_value(value, after.value, kind):
                return after
            if refused is not None:
                break
        reason = "" if refused is None else f" ({PARAMETER_ERRORS.get(refused, f'error {refused}')})"
        raise CommandRefusedError(f"set {name} to {value:g}", f"it is {after.value:g}{reason}", self.texts()[-1:])

    def parameters(self) -> dict[str, ParameterValue]:
        """Read all parameters, by name."""
        found = self._do(
            ListParameters(self.peer.target, bytewise=self.family.bytewise_parameters, round_trip=self.peer.round_trip)
        )
        if not found.complete:
            raise VehicleTimeoutError(f"all parameters: {len(found.found)} of {found.total or 'unknown'} came", 8.0)
        return {value.name: value for value in found.found.values()}

    def check_required(self, wanted: Sequence[Parameter]) -> tuple[ParameterCheck, ...]:
        """Read the parameters that a mission relies on, under whichever of their names this firmware has.

        Raises
        ------
        VehicleTimeoutError
            The link is away: what did not come is not known to be absent.
        """
        wanted = [p.called(*self.own_names[p.key]) if p.key in self.own_names else p for p in wanted]
        read = self.read_parameters(tuple(dict.fromkeys(name for parameter in wanted for name in parameter.names)))
        checks = check_parameters(wanted, {name: found.value for name, found in read.found.items()}, read.absent)
        silent = [check.wanted.name for check in checks if check.actual is None and not check.absent]
        if silent and not self.answers():
            raise VehicleTimeoutError(f"parameter {', '.join(silent)}", GIVE_UP_S)
        return checks

    def read_settings(self, keys: Sequence[str]) -> dict[str, float]:
        """Read settings by their keys (`missions.autopilots.settings`), in our units; what this firmware has not is left out.

        Raises
        ------
        VehicleTimeoutError
            It did not tell one, and may have it.
        """
        settings = self.family.settings
        checks = self.check_required([settings[key].need("read", None, "") for key in keys])
        silent = [check.wanted.name for check in checks if check.actual is None and not check.absent]
        if silent:
            raise VehicleTimeoutError(f"parameters {', '.join(silent)}", GIVE_UP_S)
        return {c.wanted.key: c.actual / UNITS[c.wanted.unit] for c in checks if c.actual is not None and c.ok}

    def check_ground_station(self) -> None:
        """Make sure that the vehicle's failsafe counts our heartbeat: some count only that of one system.

        In newer versions it may be a range of systems. A vehicle that has no such parameter is taken as it is.

        Raises
        ------
        StationConflictError, CommandRefusedError
            Another station has our id, or the vehicle minds another one's heartbeat.
        VehicleTimeoutError
            It does not tell whose it minds.
        """
        self.connection.refuse_conflict()
        if not self.family.ground_station_settings:
            return
        needs = [self.family.settings[key].need("read", None, "") for key in self.family.ground_station_settings]
        first, last = self.check_required(needs)
        if first.absent:
            return
        if first.actual is None:
            raise VehicleTimeoutError(f"parameter {' or '.join(first.wanted.names)}", GIVE_UP_S)
        ours = self.connection.system
        highest = first.actual if last.actual is None else max(first.actual, last.actual)
        if not first.actual <= ours <= highest:
            mine = f"its failsafe counts only the heartbeat of system {first.actual:g} ({first.wanted.name}), ours is {ours}"
            raise CommandRefusedError("be watched by us", f"{mine}: use --gcs-system {first.actual:g}")

    def command(self, what: str, number: int, *parameters: float, place: Place | None = None) -> None:
        """Give a command.

        Raises
        ------
        CommandRefusedError
            With the vehicle's answer and what it said.
        VehicleTimeoutError
            No answer.
        """
        said = self.peer.said
        given = Command(self.peer.target, number, *parameters, place=place, round_trip=self.peer.round_trip)
        result = self._do(given).result
        if result is None:
            raise VehicleTimeoutError(what, 6.0)
        if result != ACCEPTED:
            self.connection.run_for(0.2)  # its reasons may come after the answer
            raise CommandRefusedError(what, RESULTS.get(result, f"answer {result}"), self.peer.texts_since(said)[-3:])

    def arm(self, patience_s: float = 0.0) -> None:
        """Arm, until a heartbeat says so; try again for so long while it is not ready."""
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
        """Disarm, until a heartbeat says so."""
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
        """Switch the mode, and wait until a heartbeat says so."""
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
        """Go on with the mission."""
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

    def reset_battery(self, soc: float) -> float:
        """Tell the counter of its battery what that holds; a vehicle without such a command refuses it.

        Returns
        -------
        float
            The state of charge that it reports within 3 s, 0-1; NaN where it reports none.
        """
        if not 0.0 <= soc <= 1.0:
            raise InputError(Fault("out of range", field="soc", value=soc, remedy="0 to 1"))
        self.command("reset the battery's counter", _BATTERY_RESET, 1.0, 100.0 * soc)
        self.connection.wait(lambda: abs(self.live.latest("soc") - soc) <= _PERCENT, _BATTERY_S)
        return self.live.latest("soc")

    def home(self) -> Home:
        """Ask where it counts heights from now; it moves when the vehicle arms."""
        said = self._do(AskFor(self.peer.target, "HOME_POSITION", 242, round_trip=self.peer.round_trip)).message
        said = said or self.peer.latest.get("HOME_POSITION")
        if said is None:
            raise VehicleTimeoutError("its home (it may have no position yet)", 6.0)
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
            self.peer.round_trip,
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

    def change_in_flight(self, mission: Mission, current: int) -> UploadOutcome:
        """Hold, upload, read back, set the current item, resume; stay in hold where it is not verified."""
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
        down = self._do(Download(self.peer.target, kind, round_trip=self.peer.round_trip))
        if down.items is None:
            raise VehicleTimeoutError(f"download of its {kind.word}: {down.problem}", 10.0)
        return down.items

    def download(self, kind: MissionKind) -> Part:
        """Read what it holds, in our numbering."""
        return decode(self._download(kind), kind, self.family)

    def verify(self, part: Part) -> tuple[Difference, ...]:
        """Return how what it holds differs in meaning."""
        return compare(part, self._download(kind_of(part)), self.family)

    def clear(self, kind: MissionKind) -> None:
        """Clear one kind, and read back that it is gone."""
        self._refuse_lists_of_version_1(kind)
        self.expect(kind.word)
        cleared = self._do(Clear(self.peer.target, kind, round_trip=self.peer.round_trip))
        down = self._do(Download(self.peer.target, kind, round_trip=self.peer.round_trip))
        left = None if down.items is None else len(down.items)
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
        if not self._do(SetCurrent(self.peer.target, number, round_trip=self.peer.round_trip)).confirmed:
            raise CommandRefusedError(f"make item {number} (its own number) the current one", "it does not say so")
