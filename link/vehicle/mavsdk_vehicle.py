"""The second driver, based on MAVSDK: unsigned and in real time only; a check of the default driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.vehicle.mavsdk_runner import MavsdkRunner
from skyway.link.vehicle.vehicle import Vehicle
from skyway.models.base.clock import WallClock
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from skyway.link.protocol.connection import Connection


class MavsdkVehicle(Vehicle):
    """One vehicle on a connection, spoken with by MAVSDK; arguments and errors as of `VehicleMonitor`.

    Missions, parameters and commands are transferred by MAVSDK; what to command when, and what to believe of an upload,
    is the same as with the default driver. One such vehicle per connection, since MAVSDK speaks with our only id.

    Raises
    ------
    InputError
        A signing key (MAVSDK does not sign), a clock other than the wall's, or a second one on this connection.
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
