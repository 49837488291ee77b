"""Phase of a leg: whether the vehicle cruises, by its place and its height."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.legs import cross_track_m

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.telemetry import TelemetrySample

LANDS_M, AWAY_M = 30.0, 100.0
"""So near to the end of its leg a vehicle is about to land; so far from the beginning it no longer climbs."""
CLIMBED_SHARE = 0.6
"""Nor does it above this share of the cruise height."""


def cruises(ctx: Context, s: TelemetrySample) -> bool:
    """Whether the vehicle neither climbs at the beginning of its leg nor lands at the end.

    Height alone does not tell: it is above the take-off point, and a leg downhill may be flown below that.
    """
    leg, place = ctx.delivery.leg, ctx.place
    climbed = s.height_m > CLIMBED_SHARE * ctx.job.scenario.rules.cruise_height_m
    if leg is None or place is None:
        return climbed
    begin, end = leg.mission.way[0], leg.mission.way[-1]
    if cross_track_m([end, end], *place) < LANDS_M:
        return False
    return climbed or cross_track_m([begin, begin], *place) > AWAY_M
