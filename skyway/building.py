"""Scenarios from Python objects instead of files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError, refuse
from skyway.models.base.ranges import kind_faults
from skyway.models.drones.drone import M200_V2, Drone
from skyway.models.drones.fleet import read_fleet
from skyway.models.flight.rules import FlightRules
from skyway.models.network.sources import network_of
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.air import fleet_in_air
from skyway.models.scenario.checks import fit_warnings
from skyway.models.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.network.station import ConnectionRule
    from skyway.models.scenario.tariff import Tariff
    from skyway.models.wind.history import WindHistory


def build_scenario(
    stations: Any,
    *,
    segments: Iterable[tuple[str, str]] | ConnectionRule | None = None,
    drones: Sequence[Drone] | str | PathLike[str] = (M200_V2,),
    rules: FlightRules | None = None,
    load: PadLoad | None = None,
    history: WindHistory | None = None,
    tariff: Tariff | None = None,
    zones: Airspace | None = None,
    name: str = "scenario",
    timezone: str = "UTC",
) -> Scenario:
    """Build a scenario from objects.

    Parameters
    ----------
    stations : Network, sequence of Station or of mappings, DataFrame, GeoDataFrame or networkx graph
        See `models.network.sources.network_of`.
    segments : pairs of station ids, ConnectionRule or None
        Directed segments, or the rule that makes them; None: the edges of a graph, else all pairs within 10 km.
    drones : sequence of Drone, or path of a fleet file
        The fleet; without it, one type, the DJI M200 V2.
    rules : FlightRules or None
        How every flight is flown.
    load : PadLoad or None
        Other drones at the stations; None: there are none.
    history : WindHistory or None
        Wind record; without it `skyway.plan` needs a forecast (`skyway.constant_wind` makes one).
    tariff : Tariff or None
        Prices of energy and pads; None without costs.
    zones : Airspace or None
        Segments that are closed at all times are omitted.
    name, timezone : str
        What people call it; IANA name of local time.

    Returns
    -------
    Scenario

    Raises
    ------
    InputError
        With every fault found.

    Examples
    --------
    >>> import skyway
    >>> a, b = skyway.Station("a", "A", 40.70, -74.00), skyway.Station("b", "B", 40.75, -73.95)
    >>> skyway.build_scenario([a, b])
    Scenario(scenario: 2 stations, 2 segments, 1 drone, no wind record)
    """
    rules = rules or FlightRules()
    if zones is not None:
        zones = replace(zones, cruise_height_m=rules.cruise_height_m)
    network = network_of(stations, segments=segments, zones=zones)
    fleet = read_fleet(Path(drones)) if isinstance(drones, str | PathLike) else _fleet(drones)
    sites = () if history is None else history.sites
    load = PadLoad.none(len(network), timezone) if load is None else load
    bends = sum(station.flyover for station in network.stations)
    if bends and len(load.arrivals_per_s) == len(network) - bends:
        load = load.extended(bends)
    if len(load.arrivals_per_s) != len(network):
        shape = f"{len(load.arrivals_per_s)} stations"
        raise InputError("does not fit the network", field="load", value=shape, remedy=f"{len(network)} stations")
    built = Scenario(
        name=name,
        network=network,
        drones=fleet,
        rules=rules,
        load=load,
        history=history,
        wind_sites=sites,
        tariff=tariff,
        measured_at_m=10.0 if history is None else history.measured_at_m,
        timezone=timezone,
        warnings=tuple(fit_warnings(network, sites)),
    )
    return fleet_in_air(built)


def _fleet(drones: Any) -> tuple[Drone, ...]:
    remedy = "a sequence of Drone, or the path of a fleet file"
    refuse(kind_faults("drones", drones, Iterable, remedy))
    fleet = tuple(drones)
    refuse(
        [fault for number, one in enumerate(fleet) for fault in kind_faults(f"drones[{number}]", one, Drone, remedy)]
    )
    if not fleet:
        raise InputError("the fleet is empty", field="drones", remedy="give at least one Drone")
    return fleet
