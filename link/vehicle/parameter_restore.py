"""Restoring sets of parameters on a vehicle: one by one, each read back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.errors import CommandRefusedError, LinkError, ParameterAbsentError, VehicleTimeoutError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.protocol.parameter_set import SetChange
    from skyway.link.vehicle.vehicle import Vehicle

_TRIES = 3
"""Of a parameter to which no answer comes; each takes some 5 s."""
_REFRESH_S = 1.5
"""Longer than the time between two heartbeats."""


def restore_set(vehicle: Vehicle, changes: Sequence[SetChange], tell: Callable[[SetChange, str], None]) -> str:
    """Set the parameters of a set on a disarmed vehicle; returns why not all were, or nothing.

    `tell` takes each and what was done: ``set`` (and read back), ``refused``, ``gone``, ``unknown`` (sent, and not read back) or
    ``not reached``. After a refusal it continues with the next; where the vehicle is armed, or no longer answers, it stops.
    """
    vehicle.connection.run_for(_REFRESH_S)  # whether it is armed may be old: somebody has thought about a question
    vehicle.refuse_other_supervisor()
    problems: list[str] = []
    for number, change in enumerate(changes):
        try:
            if vehicle.armed:
                raise LinkError("the vehicle is armed: parameters are not restored in flight")  # noqa: TRY301
            _set(vehicle, change)
        except ParameterAbsentError:
            problems.append(f"{change.name} is no longer there")
            tell(change, "gone")
        except CommandRefusedError as error:
            problems.append(str(error))
            tell(change, "refused")
        except LinkError as error:
            problems.append(str(error))
            asked = isinstance(error, VehicleTimeoutError)
            for left in changes[number:]:
                tell(left, "unknown" if asked and left is change else "not reached")
            break
        else:
            tell(change, "set")
    return "; ".join(problems)


def _set(vehicle: Vehicle, change: SetChange) -> None:
    """Set one, again where no answer comes."""
    for _ in range(_TRIES - 1):
        try:
            vehicle.set_parameter(change.name, change.then)
        except VehicleTimeoutError:
            continue
        return
    vehicle.set_parameter(change.name, change.then)
