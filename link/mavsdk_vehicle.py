"""The second driver: MAVSDK, at wall time only, unsigned and unrecorded; a check on the first one.

What MAVSDK cannot do says so: it has no setting of time-outs, does not sign, and does not give its bytes away.
"""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from dataclasses import astuple
from typing import TYPE_CHECKING, Any

from link.address import Address, parse_address
from link.autopilots import family_named
from link.mission_words import MissionKind
from link.parameters import ParameterCheck, ParameterValue, check_parameters, same_value
from link.vehicle import Identity
from link.verified import UploadOutcome, UploadState, compare, decode, encode, kind_of
from missions.dialects.wire import WireItem
from models.errors import (
    CommandRefusedError,
    Fault,
    InputError,
    LinkError,
    LinkLostError,
    UploadMismatchError,
    VehicleTimeoutError,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from link.verified import Part
    from missions.comparison import Difference
    from missions.mission import Mission
    from missions.parameters import Parameter
    from models.telemetry import TelemetrySample

FIND_S = 10.0
ATTEMPTS = 3
_WHOLE, _REAL = 6, 9
_RETRY_ARM_S = 1.0


class MavsdkVehicle:
    """One vehicle by MAVSDK.

    Parameters
    ----------
    connect : str
        Connection string, as everywhere.
    key : bytes or None
        Must be None: MAVSDK does not sign.

    Raises
    ------
    InputError
        A signing key, or a connection that MAVSDK does not know.
    VehicleTimeoutError
        No vehicle is heard.
    """

    def __init__(self, connect: str, *, autopilot: str, key: bytes | None = None, find_s: float = FIND_S) -> None:
        if key is not None:
            remedy = "use the default driver for signed links"
            raise InputError(Fault("the mavsdk driver does not sign", field="--driver", remedy=remedy))
        import mavsdk
        from mavsdk.plugins.action import Action
        from mavsdk.plugins.info import Info
        from mavsdk.plugins.mission_raw import MissionRaw
        from mavsdk.plugins.param import Param

        self.family = family_named(autopilot)
        station = mavsdk.ComponentType.GROUND_STATION
        self._sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(station))
        result = self._sdk.add_any_connection(_url(parse_address(connect)))
        if getattr(result, "name", "SUCCESS") != "SUCCESS":
            self._sdk.destroy()
            raise LinkLostError(f"MAVSDK cannot open {connect}: {result.name}")
        found = self._sdk.first_autopilot(find_s)
        if found is None:
            self._sdk.destroy()
            raise VehicleTimeoutError("no heartbeat", find_s)
        self.system: int = found.get_system_id()
        self.blocked: UploadOutcome | None = None
        self._action, self._info = Action(found), Info(found)
        self._missions, self._parameters = MissionRaw(found), Param(found)

    def close(self) -> None:
        """Close the connection."""
        self._sdk.destroy()

    def identify(self) -> Identity:
        """Tell who it is, as far as MAVSDK tells."""
        with _named("identify"):
            version = self._info.get_version()
        text = f"{version.flight_sw_major}.{version.flight_sw_minor}.{version.flight_sw_patch}"
        return Identity(self.system, self.family.name, 2, text)

    # Parameters

    def parameter(self, name: str) -> ParameterValue:
        """Read a parameter: as a real number, or else as a whole one."""
        try:
            with _named(f"read {name}"):
                return ParameterValue(name, float(self._parameters.get_param_float(name)), _REAL)
        except CommandRefusedError:
            with _named(f"read {name}"):
                return ParameterValue(name, float(self._parameters.get_param_int(name)), _WHOLE)

    def set_parameter(self, name: str, value: float) -> ParameterValue:
        """Set a parameter, and read it back."""
        kind = self.parameter(name).kind
        with _named(f"set {name}"):
            if kind == _WHOLE:
                self._parameters.set_param_int(name, round(value))
            else:
                self._parameters.set_param_float(name, value)
        after = self.parameter(name)
        if not same_value(value, after.value, kind):
            raise CommandRefusedError(f"set {name} to {value:g}", f"it is {after.value:g}")
        return after

    def check_required(self, wanted: Sequence[Parameter]) -> tuple[ParameterCheck, ...]:
        """Read the parameters that a mission relies on."""
        actual = {}
        for parameter in wanted:
            try:
                actual[parameter.name] = self.parameter(parameter.name).value
            except CommandRefusedError:
                continue  # it has none of that name, and the check says so
        return check_parameters(wanted, actual)

    # Commands

    def arm(self, patience_s: float = 0.0) -> None:
        """Arm; try again for so long while it is not ready."""
        end = time.monotonic() + patience_s
        while True:
            try:
                with _named("arm"):
                    self._action.arm()
            except CommandRefusedError:
                if time.monotonic() >= end:
                    raise
                time.sleep(_RETRY_ARM_S)
            else:
                return

    def disarm(self) -> None:
        """Disarm."""
        with _named("disarm"):
            self._action.disarm()

    def start(self, patience_s: float = 0.0) -> None:
        """Arm and fly the mission from its beginning; blocked while it is not known what the vehicle holds."""
        if self.blocked is not None:
            raise UploadMismatchError(f"start blocked, what the vehicle holds is not known: {self.blocked.holds}")
        self.set_current(0)
        self.arm(patience_s)
        with _named("start the mission"):
            self._missions.start_mission()

    def pause(self) -> None:
        """Stop on the way."""
        with _named("pause"):
            self._missions.pause_mission()

    def resume(self) -> None:
        """Go on with the mission."""
        if self.blocked is not None:
            raise UploadMismatchError(f"not resumed, what the vehicle holds is not known: {self.blocked.holds}")
        with _named("continue"):
            self._missions.start_mission()

    def set_mode(self, name: str) -> None:
        """Switch to ``hold``, ``mission``, ``return`` or ``land``; MAVSDK knows no others."""
        switches = {"hold": self._action.hold, "return": self._action.return_to_launch, "land": self._action.land}
        switch = (switches | {"mission": self._missions.start_mission}).get(name)
        if switch is None:
            raise _missing(f"switch to {name}")
        with _named(f"switch to {name}"):
            switch()

    def go_to(self, lat_deg: float, lon_deg: float, height_m: float) -> None:  # noqa: ARG002
        """Refuse: MAVSDK wants heights above sea level, and does not say which home it has."""
        raise _missing("fly to heights above home")

    def release(self) -> None:
        """Refuse."""
        raise _missing("release the package")

    def reset_battery(self, soc: float) -> None:  # noqa: ARG002
        """Refuse."""
        raise _missing("reset the battery's counter")

    def samples(self, duration_s: float = math.inf) -> Iterator[TelemetrySample]:  # noqa: ARG002
        """Refuse: what it tells comes without the vehicle's time."""
        raise _missing("give telemetry with the vehicle's time")

    def change_in_flight(self, mission: Mission, current: int) -> UploadOutcome:
        """Hold, upload, read back, set the current item, resume; stay in hold where it is not verified."""
        self.set_mode("hold")
        outcome = self.upload(mission, current=current)
        if outcome.verified:
            self.set_current(current)
            self.resume()
        return outcome

    def return_home(self) -> None:
        """Return as the vehicle's parameters say."""
        with _named("return"):
            self._action.return_to_launch()

    def land(self) -> None:
        """Land here."""
        with _named("land"):
            self._action.land()

    # Missions

    def upload(
        self, part: Part, *, current: int = 0, progress: Callable[[str, int, int], None] | None = None
    ) -> UploadOutcome:
        """Upload, read back and compare; a few times. MAVSDK's own answer decides nothing."""
        kind, wire = kind_of(part), encode(part, self.family.name, current)
        differences: tuple[Difference, ...] = ()
        reason, holds = "", "what it held before, or parts of what was sent"
        for attempt in range(1, ATTEMPTS + 1):
            reason = self._send(kind, wire)
            if progress is not None:
                progress("sending", len(wire), len(wire))
            try:
                differences = self.verify(part)
            except LinkError as error:
                reason = f"it cannot be read back: {error}"
                continue
            if not differences:
                self.blocked = None
                return UploadOutcome(UploadState.VERIFIED, kind, "what was sent", attempts=attempt)
            holds = f"something else: {len(differences)} differences, the first {differences[0]}"
        self.blocked = UploadOutcome(UploadState.UNKNOWN, kind, holds, reason, (), differences, ATTEMPTS)
        return self.blocked

    def _send(self, kind: MissionKind, wire: Sequence[WireItem]) -> str:
        from mavsdk.plugins.mission_raw import MissionItem

        items = [MissionItem(*astuple(item)) for item in wire]
        try:
            with _named(f"take a {kind.word}"):
                if not items and kind is MissionKind.MISSION:
                    self._missions.clear_mission()
                elif kind is MissionKind.MISSION:
                    self._missions.upload_mission(items)
                elif kind is MissionKind.FENCE:
                    self._missions.upload_geofence(items)
                else:
                    self._missions.upload_rally_points(items)
        except CommandRefusedError as error:
            return str(error)
        return ""

    def download(self, kind: MissionKind) -> Part:
        """Read what it holds, in our numbering."""
        return decode(self._items(kind), kind, self.family.name)

    def _items(self, kind: MissionKind) -> list[WireItem]:
        with _named(f"give its {kind.word}"):
            if kind is MissionKind.MISSION:
                found = self._missions.download_mission()
            elif kind is MissionKind.FENCE:
                found = self._missions.download_geofence()
            else:
                found = self._missions.download_rallypoints()
        return [_wire_item(item) for item in found]

    def verify(self, part: Part) -> tuple[Difference, ...]:
        """Tell how what it holds differs in meaning."""
        return compare(part, self._items(kind_of(part)), self.family.name)

    def clear(self, kind: MissionKind) -> None:
        """Clear the mission; MAVSDK clears nothing else by itself."""
        if kind is not MissionKind.MISSION:
            raise _missing(f"clear {kind.word}")
        with _named("clear its mission"):
            self._missions.clear_mission()

    def set_current(self, item: int) -> None:
        """Make one of our items the next to be flown."""
        with _named(f"make item {item} the current one"):
            self._missions.set_current_mission_item(item + int(self.family.name == "ardupilot"))


def _wire_item(item: Any) -> WireItem:
    return WireItem(
        item.seq,
        item.frame,
        item.command,
        item.current,
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        item.mission_type,
    )


def _missing(what: str) -> LinkError:
    return LinkError(f"the mavsdk driver cannot {what}: use the default driver")


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Make MAVSDK's errors ours."""
    from mavsdk import MavsdkError

    try:
        yield
    except MavsdkError as error:
        raise CommandRefusedError(what, str(error)) from None


def _url(address: Address) -> str:
    if address.kind == "serial":
        return f"serial://{address.host}:{address.port}"
    return f"{ {'tcp': 'tcpout'}.get(address.kind, address.kind) }://{address.host}:{address.port}"
