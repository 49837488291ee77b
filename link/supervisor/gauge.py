"""How much charge there is: what the vehicle says, corrected by what pads measured and by what its voltage gives away."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from link.supervisor.states import IN_AIR

if TYPE_CHECKING:
    from link.supervisor.context import Context
    from models.telemetry import TelemetrySample

JUMP_SOC = 0.05
"""A charge that falls by so much from one report to the next was not used by flying."""
MIN_GAUGE_SOC = 0.08
"""A flight that used less tells nothing of the gauge."""


def read_gauge(ctx: Context, sample: TelemetrySample) -> None:
    """Take a state of charge that the vehicle tells."""
    told, leg = sample.soc, ctx.leg
    if not math.isfinite(told):
        return
    flies = leg is not None and ctx.state in IN_AIR
    fell = ctx.told_soc - told
    ctx.told_soc = told
    if leg is not None and flies and fell > JUMP_SOC:
        leg.told_start -= fell
        _lost(ctx, fell, f"the charge fell by {100 * fell:.0f} % at once: lost, not used")
    fell = ctx.voltage.hear(sample.time_s, sample.voltage_v, sample.current_a, told)
    if flies and fell > 0.0:
        told_now = f"the vehicle says {100 * told:.0f} %"
        _lost(
            ctx, fell, f"the voltage fell as if {100 * fell:.0f} % were lost at once; {told_now}, that is not believed"
        )
    soc, source = told - ctx.voltage.lost, "the vehicle"
    if leg is not None and math.isfinite(leg.soc_start) and (ctx.gauge != 1.0 or ctx.voltage.lost > 0.0):
        soc, source = leg.soc_start - ctx.gauge * (leg.told_start - told), "the vehicle, corrected"
    ctx.soc, ctx.soc_source = max(soc, 0.0), source


def _lost(ctx: Context, fell: float, reason: str) -> None:
    """Take charge that is gone from what the flight began with: it was not used."""
    if ctx.leg is not None:
        ctx.leg.soc_start -= fell
    ctx.flown_from, ctx.lost_s = (math.nan, math.nan), ctx.now_s
    ctx.note("gauge", reason, fell_soc=fell)
    ctx.tell(reason)


def learn_gauge(ctx: Context, told_before: float, pad_soc: float) -> None:
    """Compare what the vehicle said it used in a flight with what the pad finds missing."""
    said, used = ctx.flown_from[0] - told_before, ctx.flown_from[1] - pad_soc
    if not (said > MIN_GAUGE_SOC and math.isfinite(used)):
        return
    ratio = min(max(used / said, 0.7), 1.5)
    ctx.gauge += 0.5 * (ratio - ctx.gauge)
    reason = f"the pad finds {100 * pad_soc:.0f} %, the vehicle says {100 * told_before:.0f} %"
    ctx.note("gauge", reason, used_soc=used, said_soc=said, factor=ctx.gauge)
