"""Orders, and the drones of a fleet with their state: the input of a dispatcher."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime  # noqa: TC003  the desk reads and writes orders by their annotations

from skyway.models.base.errors import Fault

MAX_PRIORITY = 9
NOWHERE = Fault("")
"""Source of values that were not read from a file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """One package to be carried.

    Attributes
    ----------
    id : str
        Unique.
    origin, destination : str
        Station id, part of its name, or ``lat,lon``; ids of nodes once they have been found in a scenario.
    mass_kg : float
        Of the package.
    kind : str
        Its contents, for people.
    ready, due : datetime
        It can be collected from `ready` on, and should be delivered by `due`.
    priority : int
        0 to `MAX_PRIORITY`; a higher one is served first.
    value : float or None
        Of the delivery, in any one currency; only compared.
    source : Fault
        File and line that it was read from, for messages.
    """

    id: str
    origin: str
    destination: str
    mass_kg: float
    ready: datetime
    due: datetime
    kind: str = ""
    priority: int = 0
    value: float | None = None
    source: Fault = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """One drone of a fleet, with its state.

    Attributes
    ----------
    id : str
        Unique.
    type : str
        Id of its model among the drones of the scenario.
    home, place : str
        Its base, and its present position: station id or part of its name; ids of nodes once found in a scenario.
    soc : float
        Charge, 0 to 1 of the battery's present capacity.
    available_from, available_to : datetime or None
        It flies between these times; None: no limit.
    battery_health : float
        The battery's present capacity, as a share of its nameplate energy.
    source : Fault
        File and line that it was read from, for messages.
    """

    id: str
    type: str
    home: str
    place: str
    soc: float = 1.0
    available_from: datetime | None = None
    available_to: datetime | None = None
    battery_health: float = 1.0
    source: Fault = field(default=NOWHERE, compare=False, repr=False)
