"""Stations of a skyway network, and the rule that connects them."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Station:
    """A node of the network.

    Attributes
    ----------
    id, name : str
        Unique id, name for people.
    lat, lon : float
        Degrees, WGS-84.
    elevation_m : float or None
        Ground above mean sea level; None is unknown.
    pads : int
        Recharging pads; 0 for a delivery target.
    holding_spots : int
        Drones that may stand beside the pads while they wait.
    recharge_power_w : float or None
        Maximum power of one pad; None: no limit.
    energy_price_per_kwh, pad_fee : float or None
        Price of a kWh there at all hours, and the fee of each charge besides, in the scenario's currency; None: as in the scenario.
    open_hours : str
        When pads can be used, see `models.queues.opening_hours`; empty: always.
    flyover : bool
        Not a station but a bend of a route around a zone, or the begin or end of a route over one: landing is not possible.
    least_m, least_agl_m : float
        Least heights of the route between two such places, above mean sea level and above the ground: the lower values of the two apply.
    """

    id: str
    name: str
    lat: float
    lon: float
    elevation_m: float | None = None
    pads: int = 5
    holding_spots: int = 4
    recharge_power_w: float | None = None
    energy_price_per_kwh: float | None = None
    pad_fee: float | None = None
    open_hours: str = ""
    flyover: bool = False
    least_m: float = -math.inf
    least_agl_m: float = -math.inf


@dataclass(frozen=True, slots=True)
class ConnectionRule:
    """Rule by which segments are generated if none are given.

    Attributes
    ----------
    kind : str
        ``max-length``, ``nearest`` or ``gabriel`` (see `models.network.builders`).
    max_length_m : float
        Maximum length of a segment.
    nearest : int
        Neighbours of each station, for ``nearest``.
    """

    kind: str = "max-length"
    max_length_m: float = 10_000.0
    nearest: int = 6
