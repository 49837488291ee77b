"""Named worlds to be judged in: each deviates from the product's assumptions in something that it names."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

Clock = Literal["hour", "observed"]
Between = Literal["steps", "lines", "spectrum"]
Space = Literal["inverse-distance", "field"]
Gust = Literal["relaxing", "harmonics"]
Profile = Literal["fixed", "stability"]
Energy = Literal["flat", "momentum", "plant"]
Battery = Literal["new", "old", "cold"]
Charging = Literal["exponential", "lognormal"]


@dataclass(frozen=True)
class World:
    """What is true in a world; the defaults are what the product assumes.

    Attributes
    ----------
    name : str
    kept_back : str
        Site whose reports are withheld, though the wind passes through them.
    clock : str
        ``hour``: a report is known from the beginning of its hour on; ``observed``: it is a METAR, observed 9 min before its end.
    between, space : str
        The wind between reports, and between sites: see `series` and `wind`.
    gusts, profile, energy, battery, charging : str
        See `turbulence`, `profile`, `energy`, `battery`, `pads`.
    strangers : (float, float)
        Arrivals of others are the profile's times a factor drawn between these.
    broken_pads : bool
        One pad of ten is out of order.
    """

    name: str
    kept_back: str = ""
    clock: Clock = "hour"
    between: Between = "steps"
    space: Space = "inverse-distance"
    gusts: Gust = "relaxing"
    profile: Profile = "fixed"
    energy: Energy = "flat"
    battery: Battery = "new"
    charging: Charging = "exponential"
    strangers: tuple[float, float] = (1.0, 1.0)
    broken_pads: bool = False

    @property
    def deviations(self) -> frozenset[str]:
        """Names of what is otherwise than the product assumes."""
        return frozenset(f.name for f in fields(self) if f.name != "name" and getattr(self, f.name) != f.default)

    @property
    def counted_on(self) -> bool:
        """Whether a plan counts on everything in which this world deviates: there its promises must hold."""
        return self.deviations <= COUNTED_ON


COUNTED_ON: frozenset[str] = frozenset()
"""Deviations that the product says its promises count on; today none. What is counted on moves here."""

OURS = World("ours")
WEATHER = World("weather", clock="observed", between="spectrum", space="field", gusts="harmonics", profile="stability")
ALL = replace(
    WEATHER,
    name="all",
    energy="momentum",
    battery="cold",
    charging="lognormal",
    strangers=(0.5, 1.5),
    broken_pads=True,
)


def worlds(sites: tuple[str, ...]) -> dict[str, World]:
    """The worlds of a record with some sites, by name."""
    found = [OURS]
    if len(sites) > 1:
        found += [World(f"without-{site}", kept_back=site) for site in sites]
    found += [
        World("observed-steps", clock="observed"),
        World("observed-lines", clock="observed", between="lines"),
        World("observed-spectrum", clock="observed", between="spectrum"),
        World("field", space="field"),
        World("harmonics", gusts="harmonics"),
        World("profile", profile="stability"),
        World("momentum", energy="momentum"),
        World("plant", energy="plant"),
        World("old-battery", battery="old"),
        World("cold-battery", battery="cold"),
        World("strangers", charging="lognormal", strangers=(0.5, 1.5)),
        World("broken-pads", broken_pads=True),
        WEATHER,
        ALL,
    ]
    if len(sites) > 1:
        found += [replace(ALL, name=f"all-without-{site}", kept_back=site) for site in sites]
    return {world.name: world for world in found}
