"""Small services: heartbeats, time, signing, streams, and the old requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.protocols.telemetry import ON_REQUEST, VERSION
from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_GROUND_STATION = 6
_MAX_STATIONS = 32


class LinkServices:
    """Heartbeats heard, time, version, signing, streams requested."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "HEARTBEAT": self.heartbeat,
            "TIMESYNC": self.timesync,
            "PING": self.ping,
            "SETUP_SIGNING": self.setup_signing,
            "REQUEST_DATA_STREAM": self.request_data_stream,
            "AUTOPILOT_VERSION_REQUEST": lambda port, _: port.write(ON_REQUEST[VERSION](self.vehicle)),
            "SET_MODE": self.set_mode,
            "SET_POSITION_TARGET_GLOBAL_INT": self.set_position_target,
        }

    def heartbeat(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Remember when each ground station was heard."""
        if message.type != _GROUND_STATION:
            return
        heard = self.vehicle.ground_heard
        if message.get_srcSystem() in heard or len(heard) < _MAX_STATIONS:
            if message.get_srcSystem() not in heard:
                self.vehicle.event(f"ground station {message.get_srcSystem()} heard")
            heard[message.get_srcSystem()] = self.vehicle.sim_s

    def timesync(self, port: Port, message: Any) -> None:
        """Answer a request with our time; answers to others are none of our business."""
        if message.tc1 == 0:
            port.reply("TIMESYNC", tc1=int(self.vehicle.boot_us * 1000), ts1=message.ts1)

    def ping(self, port: Port, message: Any) -> None:
        """Send a ping back."""
        if message.target_system == 0:
            Partner.of(port, message).tell("PING", time_usec=message.time_usec, seq=message.seq)

    def setup_signing(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Set a key for every link; a key of zeros ends signing."""
        key = bytes(message.secret_key)
        self.vehicle.radio.set_signing(key if any(key) else None, message.initial_timestamp)

    def request_data_stream(self, port: Port, message: Any) -> None:
        """Start or stop a group of messages, where the family knows this request."""
        if not self.vehicle.autopilot.OBEYS_STREAM_GROUPS:
            return
        self.vehicle.radio.stream_group(
            port, message.req_stream_id, message.req_message_rate if message.start_stop else 0
        )

    def set_mode(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Obey the old SET_MODE; it is not acknowledged."""
        pilot = self.vehicle.autopilot
        mode = pilot.MODE_NUMBERS.get(message.custom_mode) if message.base_mode & 1 else None
        if mode is not None:
            pilot.request_mode(mode, f"station {message.get_srcSystem()}")

    def set_position_target(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Fly to a position in GUIDED; in any other mode it is ignored."""
        pilot = self.vehicle.autopilot
        if pilot.mode != Mode.GUIDED or pilot.landed or message.type_mask & 7:
            return
        lat, lon = message.lat_int * 1e-7, message.lon_int * 1e-7
        if abs(lat) > 90.0 or abs(lon) > 180.0 or message.coordinate_frame not in (0, 3, 5, 6):
            return
        relative = message.coordinate_frame in (3, 6)
        height = message.alt + (pilot.home_alt_m if relative else 0.0)
        if -1000.0 < height < 20_000.0 and pilot.outside_fence(lat, lon, height) is None:
            pilot.fly_to(lat, lon, height, None)
