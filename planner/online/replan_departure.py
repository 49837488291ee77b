"""What a leg needs before it is begun: charge that keeps the reserve, a divert station for every point of it, and wind that lets it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.units import S_PER_MIN

if TYPE_CHECKING:
    from skyway.models.composition.composition import DroneService
    from skyway.planner.online.diverts import Reach
    from skyway.planner.online.replan import Grounded, ReplanSettings

MORE_SOC = 0.05
"""Where divert stations are lacking, so much more charge is looked at."""


@dataclass(frozen=True, slots=True)
class Need:
    """What a leg needs.

    Attributes
    ----------
    soc : float or None
        Least charge; None where no charge does.
    diverts : tuple of str
        Divert stations that every point of it has one of.
    why : str
        Why no charge does.
    """

    soc: float | None
    diverts: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True)
class Held:
    """A leg that the wind does not let begin.

    Attributes
    ----------
    reason : str
        A sentence.
    figures : dict
        What it is told by.
    """

    reason: str
    figures: dict[str, Any] = field(default_factory=dict)


def charge_needed(
    service: DroneService, standing: Grounded, reach: Reach, settings: ReplanSettings, reserve_soc: float
) -> Need:
    """Find the least charge with which a leg keeps the reserve and always has a divert station."""
    way = reach.way(service.origin, service.via, service.destination)
    reach = reach.where_flown(way, standing.time_s)
    cost = reach.to_the_end(way, standing.time_s, climbs=True).soc[:, None]
    percent = range(100, -1, -1)
    least = None
    for soc in (0.01 * one for one in percent):
        if float(reach.p_below(soc, cost, reserve_soc)[0]) > settings.epsilon_depart:
            break
        least = soc
    if least is None:
        p = float(reach.p_below(1.0, cost, reserve_soc)[0])
        return Need(None, (), f"even fully charged it lands below {100 * reserve_soc:.0f} % with probability {p:.2f}")
    soc, gap_m = least, math.nan
    while soc <= 1.0 + 1e-9:
        cover = reach.cover(
            way, standing.time_s, soc, floor_soc=reserve_soc * settings.divert_share, epsilon=settings.epsilon_depart,
            destination=service.destination, not_at=standing.unusable,
        )  # fmt: skip
        if cover.gap_m is None:
            return Need(min(soc, 1.0), cover.stations, "")
        gap_m = cover.gap_m
        soc = soc + MORE_SOC if soc + MORE_SOC < 1.0 or soc >= 1.0 else 1.0
    return Need(None, (), f"from {gap_m / 1000:.1f} km on no divert station stays in reach, even fully charged")


def held_by_wind(service: DroneService, standing: Grounded, reach: Reach, wait_s: float) -> Held | None:
    """Return where the wind most probably forbids to leave now; None where it does not."""
    way = np.array(reach.way(service.origin, service.via, service.destination))
    north, east = reach.winds(way[:, 0], way[:, 1], np.full(len(way), standing.time_s))
    speed = np.hypot(north, east).max(axis=1)
    limit = reach.drone.wind_limit_mps
    p_over, mean = float(reach.wind.probability @ (speed > limit)), float(reach.wind.probability @ speed)
    if p_over <= 0.5:
        return None
    reason = (
        f"wait {wait_s / S_PER_MIN:.0f} min for the wind: {mean:.1f} m/s expected on the way to {service.destination}, above "
        f"{limit:g} m/s with probability {p_over:.2f}"
    )
    return Held(reason, {"p_wind_over_limit": p_over, "wind_mps": mean})
