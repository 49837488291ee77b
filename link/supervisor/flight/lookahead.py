"""What is expected of the flight under way: kept with its leg for the live view and the journal's tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.journal.parts import Expected
from skyway.link.supervisor.legs import cross_track_m

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context


def look_ahead(ctx: Context, figures: Mapping[str, Any]) -> None:
    """Keep with the leg what a decision expects of it."""
    leg, place = ctx.delivery.leg, ctx.place
    if leg is None or place is None:
        return
    left_s = figures.get("left_s")
    leg.expect(
        Expected(
            destination=leg.destination,
            left_s=left_s,
            late_s=None if left_s is None else ctx.now_s - leg.start_s + float(left_s) - leg.planned_s,
            soc_land=figures.get("soc_land"),
            planned_soc_land=leg.planned_soc,
            p_below_reserve=figures.get("p_below_reserve"),
            cross_track_m=cross_track_m(leg.mission.way, *place),
            commanded_mps=leg.commanded_mps,
            believed_north_mps=figures.get("wind_north_mps"),
            believed_east_mps=figures.get("wind_east_mps"),
            energy_factor=figures.get("energy_factor"),
            limited=ctx.lean.said(leg.commanded_mps) if ctx.lean.limited else None,
        )
    )
