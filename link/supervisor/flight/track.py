"""Position of the vehicle, written to the journal at intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import Tracked
from skyway.link.supervisor.journal.parts import Expected, Winds, winds

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.telemetry import TelemetrySample

TRACK_EVERY_S, GROUND_TRACK_EVERY_S = 5.0, 120.0


@dataclass(slots=True)
class Track:
    """The track of one delivery."""

    written_s: float = -math.inf
    """Time of the last record, POSIX seconds."""

    def write(self, ctx: Context) -> None:
        """Write the position, at intervals."""
        every_s = TRACK_EVERY_S if ctx.in_air else GROUND_TRACK_EVERY_S
        s = ctx.observed.sample
        if s is None or ctx.now_s < self.written_s + every_s:
            return
        self.written_s = ctx.now_s
        ctx.wind.catch_up()
        estimate = ctx.wind.estimate if ctx.in_air else None
        leg = ctx.delivery.leg if ctx.in_air else None
        north_mps, east_mps = ctx.wind.expected(s.time_s, s.lat_deg, s.lon_deg)
        ctx.note(
            Tracked(
                lat=s.lat_deg,
                lon=s.lon_deg,
                height_m=s.height_m,
                alt_msl_m=s.alt_msl_m,
                soc=s.soc,
                ground_speed_mps=s.ground_speed_mps,
                power_w=s.power_w,
                mode=ctx.vehicle.mode,
                armed=s.armed == 1.0,
                landed=s.landed == 1.0,
                forecast_north_mps=north_mps,
                forecast_east_mps=east_mps,
                forecast=_winds_here(ctx, s, updated=False),
                believed=_winds_here(ctx, s, updated=True),
                wind_north_mps=None if estimate is None else estimate.north_mps,
                wind_east_mps=None if estimate is None else estimate.east_mps,
                wind_sigma_mps=None if estimate is None else estimate.sigma_mps,
                wind_source=None if estimate is None else estimate.source,
                expected=Expected() if leg is None or leg.lookahead is None else leg.lookahead,
                modelled_soc=None if leg is None or leg.modelled is None else leg.modelled.soc,
            )
        )


def _winds_here(ctx: Context, s: TelemetrySample, *, updated: bool) -> Winds:
    """Summarise the first forecast, and the updated one, for here and now."""
    if ctx.place is None:
        return Winds()
    return winds(ctx.wind.forecast_at(s.time_s, s.lat_deg, s.lon_deg, updated=updated))
