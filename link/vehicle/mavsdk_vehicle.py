"""The second driver, based on MAVSDK over one of our connections: unsigned and in real time only; a check of the default driver.

MAVSDK is fed over its raw connection: what comes in on our transport is handed to it, what it wants to say goes out on
our transport, and both are recorded. So everything that a `Connection` sees (telemetry, texts, other stations) is seen
all the same, and one thread alone, the caller's, touches the connection: MAVSDK's blocking calls run in another one
while the caller's keeps the bytes flowing.

Our own state machines (`Exchange`) watch along: they hear every answer and say nothing. What they find is what the
driver above goes by; for what only MAVSDK knows, such as the items of a download, its result is taken.
"""

from __future__ import annotations

import json
import logging
import math
import queue
import threading
from dataclasses import astuple
from typing import TYPE_CHECKING, Any, TypeVar

from skyway.link.protocol.command import AskFor, Command, SetCurrent
from skyway.link.protocol.download import Download
from skyway.link.protocol.exchange import Carrier
from skyway.link.protocol.mission_words import ITEM_FIELDS
from skyway.link.protocol.parameters import REAL32, ListParameters, ParameterValue, SetParameter
from skyway.link.protocol.upload import Upload, UploadEnd
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.layout import MAGIC_2
from skyway.missions.autopilots.wire import WireItem
from skyway.models.base.clock import WallClock
from skyway.models.base.errors import Fault, InputError, LinkLostError, VehicleTimeoutError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.link.protocol.connection import Connection, Peer
    from skyway.link.protocol.exchange import Exchange
    from skyway.link.wire.messages import Message

T = TypeVar("T")
FIND_S = 10.0
_ASKS, _ASKED_S, _DOWNLOADS = 3, 1.0, 6
_INT32 = 6
_HEARTBEAT = b"\0\0\0"
_ERRORS = {"TIMEOUT": UploadEnd.SILENT, "TRANSFER_CANCELLED": UploadEnd.BROKEN, "BUSY": UploadEnd.BROKEN}


class MavsdkRunner(Carrier):
    """Speaks with one vehicle by MAVSDK, which sends the heartbeats of the connection meanwhile.

    Raises a `LinkLostError` if MAVSDK takes no raw connection, a `VehicleTimeoutError` if it does not find the
    vehicle.
    """

    def __init__(self, connection: Connection, peer: Peer) -> None:
        import mavsdk
        from mavsdk.logging import log_subscribe

        log_subscribe(_log)
        self.connection, self.peer = connection, peer
        self._out: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        ours = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        ours.system_id, ours.component_id = connection.system, connection.component
        self._sdk = mavsdk.Mavsdk(ours)
        self._sdk.subscribe_raw_bytes_to_be_sent(self._out.put)
        result = self._sdk.add_any_connection("raw://")
        if result.name != "SUCCESS":
            self._sdk.destroy()
            raise LinkLostError(f"MAVSDK takes no raw connection: {result.name}")
        connection.shared_client = self
        self._ways: dict[type[Exchange], Callable[[Any], None]] = {
            Upload: self._upload,
            Download: self._download,
            Command: self._command,
            AskFor: self._ask,
            SetParameter: self._set_parameter,
            ListParameters: self._list,
            SetCurrent: self._set_current,
        }
        self._plugins = self._find()

    def _find(self) -> _Plugins:
        beat = self.peer.latest["HEARTBEAT"]  # heard before MAVSDK was there, which waits for one
        again = FrameWriter(self.peer.system, self.peer.component).frame("HEARTBEAT", beat.fields, beat.version)
        self._sdk.pass_received_raw_bytes(again)
        found: list[Any] = []

        def there() -> bool:
            found.extend(s for s in self._sdk.get_systems() if s.get_system_id() == self.peer.system)
            return bool(found) and found[-1].is_connected()

        if not self.connection.wait(there, FIND_S):
            self.close()
            raise VehicleTimeoutError("MAVSDK receives no heartbeat", FIND_S)
        return _Plugins(found[-1])

    def close(self) -> None:
        """Send our own heartbeats again, and end MAVSDK."""
        self.connection.shared_client = None
        self._sdk.destroy()

    def hear(self, frame: bytes) -> None:
        """Hand a frame of the vehicle to MAVSDK; other vehicles are none of its business."""
        if frame[5 if frame[0] == MAGIC_2 else 3] == self.peer.system:
            self._sdk.pass_received_raw_bytes(frame)

    def frames(self) -> Iterator[tuple[int, bytes]]:
        """Yield what MAVSDK wants to say."""
        while True:
            try:
                frame = self._out.get_nowait()
            except queue.Empty:
                return
            yield 0 if frame[7:10] == _HEARTBEAT else self.peer.system, frame

    def _carry_out(self, exchange: Exchange) -> None:
        speak = None if isinstance(exchange, Upload) and not exchange.items else self._ways.get(type(exchange))

        def watch(peer: Peer, message: Message) -> None:
            if peer is self.peer and not exchange.done:
                exchange.hear(message, self.connection.clock.now_s())
                if speak is not None:
                    exchange.outbox.clear()

        self.connection.refuse_conflict()
        exchange.begin(self.connection.clock.now_s())
        self.connection.listeners.append(watch)
        try:
            if speak is None:
                self._by_hand(exchange)
            else:
                exchange.outbox.clear()
                speak(exchange)
        finally:
            self.connection.listeners.remove(watch)

    def _set_current(self, asked: SetCurrent) -> None:
        self._call(lambda: self._plugins.missions.set_current_mission_item(asked.number))

    def _call(self, work: Callable[[], T]) -> tuple[T | None, str]:
        """Do what blocks in another thread, and keep the bytes flowing; returns its result, and MAVSDK's error."""
        from mavsdk import MavsdkError

        ended: list[tuple[T | None, str, BaseException | None]] = []

        def run() -> None:
            try:
                ended.append((work(), "", None))
            except MavsdkError as error:
                ended.append((None, error.result.name, None))
            except BaseException as error:  # noqa: BLE001  raised again where somebody sees it
                ended.append((None, "", error))

        threading.Thread(target=run, daemon=True, name="mavsdk").start()
        self._until(lambda: bool(ended), math.inf)
        result, problem, error = ended[0]
        if error is not None:
            raise error
        return result, problem

    def _until(self, condition: Callable[[], bool], longest_s: float) -> None:
        def over() -> bool:
            self.connection.refuse_conflict()
            return condition()

        self.connection.wait(over, longest_s)

    def _upload(self, up: Upload) -> None:
        from mavsdk.plugins.mission_raw import MissionItem

        missions = self._plugins.missions
        send = (missions.upload_mission, missions.upload_geofence, missions.upload_rally_points)[up.kind]
        items = [MissionItem(*astuple(item)) for item in up.items]
        _, problem = self._call(lambda: send(items))
        if not up.done:
            up.end = _ERRORS.get(problem, UploadEnd.BROKEN) if problem else UploadEnd.ACCEPTED
            up.finish()

    def _download(self, down: Download) -> None:
        missions = self._plugins.missions
        ask = (missions.download_mission, missions.download_geofence, missions.download_rallypoints)[down.kind]
        for _ in range(_DOWNLOADS):  # MAVSDK asks six times for an item; a bad radio loses more
            found, problem = self._call(ask)
            if not problem and found is not None:
                down.items, down.problem = tuple(map(_wire_item, found)), ""
                return
            down.items, down.problem = None, f"MAVSDK says {problem}"

    def _command(self, given: Command) -> None:
        given.ask()
        message = self._message(*given.outbox.pop())
        answer, problem = self._call(lambda: self._plugins.direct.send_command(message))
        given.result = None if problem or answer is None else int(json.loads(answer.fields_json)["result"])

    def _message(self, name: str, fields: dict[str, Any]) -> Any:
        from mavsdk.plugins.mavlink_direct import MavlinkMessage

        ours, theirs = (self.connection.system, self.connection.component), (self.peer.system, self.peer.component)
        return MavlinkMessage(name, *ours, *theirs, json.dumps({key: _json(value) for key, value in fields.items()}))

    def _ask(self, asked: AskFor) -> None:
        for _ in range(_ASKS):
            request = Command(asked.target, 512, float(asked.number))
            self._command(request)
            self._until(lambda: asked.done, _ASKED_S)
            if asked.done or request.result not in (None, 0):
                return

    def _set_parameter(self, given: SetParameter) -> None:
        plugin = self._plugins.parameters
        if given.kind >= REAL32:
            self._call(lambda: plugin.set_param_float(given.name, given.value))
        else:
            self._call(lambda: plugin.set_param_int(given.name, round(given.value)))

    def _list(self, asked: ListParameters) -> None:
        found, problem = self._call(self._plugins.parameters.get_all_params)
        if problem or found is None:
            return
        every = [(p, _INT32) for p in found.int_params] + [(p, REAL32) for p in found.float_params]
        asked.found = {n: ParameterValue(p.name, float(p.value), kind) for n, (p, kind) in enumerate(every)}
        asked.total = len(every) or None

    def _by_hand(self, exchange: Exchange) -> None:
        """What MAVSDK has no call for: our state machine speaks, by MAVSDK's sending of any message."""
        self._say(exchange)
        while not exchange.done:
            clock = self.connection.clock
            self._until(lambda: exchange.done or bool(exchange.outbox), exchange.next_s - clock.now_s())
            if not exchange.done and clock.now_s() >= exchange.next_s:
                exchange.tick(clock.now_s())
            self._say(exchange)

    def _say(self, exchange: Exchange) -> None:
        for name, fields in exchange.outbox:
            message = self._message(name, fields)
            self._call(lambda said=message: self._plugins.direct.send_message(said))  # type: ignore[misc]
        exchange.outbox.clear()


class _Plugins:
    """MAVSDK's parts for one vehicle."""

    def __init__(self, system: Any) -> None:
        from mavsdk.plugins.mavlink_direct import MavlinkDirect
        from mavsdk.plugins.mission_raw import MissionRaw
        from mavsdk.plugins.param import Param

        self.missions, self.parameters, self.direct = MissionRaw(system), Param(system), MavlinkDirect(system)


def _wire_item(item: Any) -> WireItem:
    return WireItem(**{name: getattr(item, name) for name in ITEM_FIELDS})


def _json(value: Any) -> Any:
    """JSON knows no NaN: MAVSDK reads null as such."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _log(level: Any, text: str, _file: str | None, _line: int) -> bool:
    """What MAVSDK would print on the terminal goes to the log of that name."""
    logging.getLogger("mavsdk").debug("%s: %s", level.name, text)
    return True


class MavsdkVehicle(Vehicle):
    """One vehicle on a connection, spoken with by MAVSDK; arguments and errors as of `VehicleMonitor`.

    Missions, parameters and commands are transferred by MAVSDK; what to command when, and what to believe of an upload,
    is the same as with the default driver. One such vehicle per connection, since MAVSDK speaks with our only id. An
    `InputError` refuses a second one, a signing key (MAVSDK does not sign), and a clock other than the wall's.
    """

    def __init__(self, connection: Connection, system: int | None = None, autopilot: str | None = None) -> None:
        if connection.signed:
            raise _cannot("sign: a signing key needs the default driver")
        if not isinstance(connection.clock, WallClock):
            raise _cannot("run in virtual time")
        if connection.shared_client is not None:
            raise _cannot("speak with two vehicles on one connection")
        super().__init__(connection, system, autopilot)
        self._runner: MavsdkRunner = MavsdkRunner(connection, self.peer)

    def close(self) -> None:
        """End MAVSDK; the connection stays open."""
        self._runner.close()


def _cannot(what: str) -> InputError:
    return InputError(Fault(f"the mavsdk driver cannot {what}", field="--driver", remedy="use --driver pymavlink"))
