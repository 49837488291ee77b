"""Changes of a network and its fleet in a study: an additional pad, station or drone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario

PADS_OF_NEW = 2
"""Pads of an added station."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Additions; repeated names are added repeatedly."""

    pads: tuple[str, ...] = ()
    """Stations with an additional pad."""
    stations: tuple[tuple[str, float, float], ...] = ()
    """Name, latitude and longitude of new stations; other drones do not charge there."""
    drones: tuple[str, ...] = ()
    """Stations with an additional drone at home."""

    def __str__(self) -> str:
        named = [f"a pad more at {one}" for one in self.pads]
        named += [f"a station with {PADS_OF_NEW} pads at {lat:.4f},{lon:.4f}" for _, lat, lon in self.stations]
        named += [f"a drone more at {one}" for one in self.drones]
        return ", ".join(named) or "as it is"


NOTHING = Change()


def changed(scenario: Scenario, change: Change) -> Scenario:
    """Return a scenario with the additions; an `InputError` means that a station cannot be at its place."""
    for name, lat, lon in change.stations:
        scenario = scenario.with_target(lat, lon, id=name)
    more = {one: change.pads.count(one) for one in change.pads} | {name: PADS_OF_NEW for name, _, _ in change.stations}
    if not more:
        return scenario
    stations = tuple(
        replace(one, pads=one.pads + more.get(one.id, 0)) if one.id in more else one
        for one in scenario.network.stations
    )
    return replace(scenario, network=replace(scenario.network, stations=stations))
