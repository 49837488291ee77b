"""Remote ID over MAVLink: sends the operator's data to the module of a vehicle, and reads whether it is ready.

The module (``MAV_TYPE_ODID``) sends heartbeats, and OPEN_DRONE_ID_ARM_STATUS with what it lacks. ArduRemoteID wants the system message every 3 s and the
others every 22 s, ArduPilot likewise: all are sent once a second, as QGroundControl does. https://mavlink.io/en/services/opendroneid.html
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import LinkError

if TYPE_CHECKING:
    from skyway.link.protocol.connection import Connection, Peer
    from skyway.models.scenario.remote_id import RemoteId

ARM_STATUS = "OPEN_DRONE_ID_ARM_STATUS"
MODULE = "HEARTBEAT 34"
"""Key of `Peer.beside` of heartbeats of MAV_TYPE_ODID."""
SILENT_S = 5.0
"""A module that says nothing for so long is absent; its messages come once a second."""
_EPOCH_S = 1_546_300_800
"""1 January 2019, from which the time of OPEN_DRONE_ID_SYSTEM counts."""
_TAKE_OFF, _FIXED = 0, 2
_NO_HEIGHT = -1000.0


@dataclass(frozen=True, slots=True)
class ModuleStatus:
    """The Remote ID module of a vehicle."""

    heard: bool
    """It is there."""
    ready: bool | None
    """It broadcasts all that it must; None where it does not say."""
    lacks: str = ""
    """What it says that it lacks."""

    def __str__(self) -> str:
        if not self.heard:
            return "no Remote ID module is heard"
        if self.ready is None:
            return "the Remote ID module does not say whether it is ready"
        return "Remote ID is broadcast" if self.ready else f"Remote ID is not ready: {self.lacks or 'no reason given'}"


def module_status(peer: Peer, now_s: float) -> ModuleStatus:
    """Return the known status of a vehicle's module at a time of the connection's clock."""
    told = {name: found for name in (MODULE, ARM_STATUS) if (found := peer.beside.get(name)) is not None}
    fresh = {name: message for name, (at_s, message) in told.items() if now_s <= at_s + SILENT_S}
    if ARM_STATUS in fresh:
        said = fresh[ARM_STATUS]
        lacks = "".join(one for one in str(said["error"]) if one.isprintable()).strip()
        return ModuleStatus(heard=True, ready=said["status"] == 0, lacks=lacks)
    return ModuleStatus(heard=bool(fresh), ready=None)


class RemoteIdSender:
    """Sends the operator data of one vehicle continuously."""

    def __init__(self, connection: Connection, peer: Peer, who: RemoteId) -> None:
        self.connection, self.peer, self.who = connection, peer, who
        self._take_off: tuple[int, int, float] | None = None

    def begin(self) -> None:
        """Send from now on, once a second."""
        self.connection.every_second.append(self.send)

    def end(self) -> None:
        """Send no more."""
        if self.send in self.connection.every_second:
            self.connection.every_second.remove(self.send)

    def send(self) -> None:
        """Send what is known."""
        try:
            self.connection.refuse_conflict()
        except LinkError:
            return
        if self.who.operator_id:
            self._tell("OPEN_DRONE_ID_OPERATOR_ID", operator_id_type=0, operator_id=self.who.operator_id)
        if self.who.self_id:
            self._tell("OPEN_DRONE_ID_SELF_ID", description_type=0, description=self.who.self_id)
        place = self._place()
        if place is not None:
            kind, lat, lon, alt_m = place
            self._tell(
                "OPEN_DRONE_ID_SYSTEM", operator_location_type=kind, operator_latitude=lat, operator_longitude=lon,
                operator_altitude_geo=alt_m, area_count=1, area_ceiling=_NO_HEIGHT, area_floor=_NO_HEIGHT,
                timestamp=max(int(self.connection.clock.posix_s()) - _EPOCH_S, 0),
            )  # fmt: skip

    def _tell(self, name: str, **fields: float | str) -> None:
        # component 0: for the autopilot, which hands it on, and for the module itself
        self.connection.send(name, self.peer.system, target_system=self.peer.system, target_component=0, **fields)

    def _place(self) -> tuple[int, int, int, float] | None:
        """Return kind and place of the operator: as given, else where the vehicle stood last."""
        if math.isfinite(self.who.lat_deg):
            return _FIXED, round(self.who.lat_deg * 1e7), round(self.who.lon_deg * 1e7), _NO_HEIGHT
        beat, at = self.peer.latest.get("HEARTBEAT"), self.peer.latest.get("GLOBAL_POSITION_INT")
        armed = beat is not None and bool(beat["base_mode"] & 128)
        if at is not None and (at["lat"] or at["lon"]) and (not armed or self._take_off is None):
            self._take_off = at["lat"], at["lon"], _NO_HEIGHT
        return None if self._take_off is None else (_TAKE_OFF, *self._take_off)
