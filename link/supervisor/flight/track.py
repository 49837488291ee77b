"""Where the vehicle is, written into the journal from time to time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context

TRACK_EVERY_S, GROUND_TRACK_EVERY_S = 5.0, 120.0


@dataclass(slots=True)
class Track:
    """The track of one delivery.

    Attributes
    ----------
    written_s : float
        When it was last written, POSIX seconds.
    """

    written_s: float = -math.inf

    def write(self, ctx: Context) -> None:
        """Write where it is, from time to time."""
        every_s = TRACK_EVERY_S if ctx.in_air else GROUND_TRACK_EVERY_S
        s = ctx.observed.sample
        if s is None or ctx.now_s < self.written_s + every_s:
            return
        self.written_s = ctx.now_s
        estimate = ctx.wind.estimate if ctx.in_air else None
        expected = ctx.wind.expected(s.time_s, s.lat_deg, s.lon_deg)
        data: dict[str, Any] = {
            "lat": s.lat_deg, "lon": s.lon_deg, "height_m": s.height_m, "alt_msl_m": s.alt_msl_m, "soc": s.soc,
            "ground_speed_mps": s.ground_speed_mps, "power_w": s.power_w, "mode": ctx.vehicle.mode,
            "armed": s.armed == 1.0, "landed": s.landed == 1.0,
            "forecast_north_mps": expected[0], "forecast_east_mps": expected[1],
        }  # fmt: skip
        for name, updated in (("forecast", False), ("believed", True)):
            told = ctx.wind.forecast_at(s.time_s, s.lat_deg, s.lon_deg, updated=updated).as_data() if ctx.place else {}
            data |= {f"{name}_{key}": value for key, value in told.items()}
        if estimate is not None:
            data |= {
                "wind_north_mps": estimate.north_mps, "wind_east_mps": estimate.east_mps,
                "wind_sigma_mps": estimate.sigma_mps, "wind_source": estimate.source,
            }  # fmt: skip
        leg = ctx.delivery.leg
        if leg is not None and ctx.in_air:
            data |= {} if leg.lookahead is None else leg.lookahead.as_data()
            data |= {"modelled_soc": None if leg.modelled is None else leg.modelled.soc}
        ctx.note("track", None, **data)
