"""How much charge there is: what the vehicle says as far as it is believed, corrected by what pads measured and by its voltage."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.states import IN_AIR
from skyway.models.drones.airspeed_load import BLADE_SHARE, INFLOW_MPS

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.telemetry import TelemetrySample

MIN_GAUGE_SOC = 0.08
"""A flight that used less tells nothing of the gauge."""
EVERY_S = 0.5
"""Batteries are told of once a second; samples repeat it."""
CONFIRMING_S = 6.0
"""So long a report that is being confirmed by the voltage is not also taken for what the voltage lost."""


def read_gauge(ctx: Context, sample: TelemetrySample) -> None:
    """Take a state of charge that the vehicle tells."""
    told, leg = ctx.told, ctx.leg
    if sample.time_s < ctx.gauged_s + EVERY_S and sample.time_s >= ctx.gauged_s:
        return
    ctx.gauged_s = sample.time_s
    flies = leg is not None and ctx.state in IN_AIR
    rate = (
        leg.modelled.per_s * ctx.belief.factor if leg is not None and leg.modelled is not None and ctx.in_air else 0.0
    )
    open_v = sample.voltage_v + sample.current_a * ctx.voltage.ohm
    was_contradicted = told.contradicted
    fell = told.hear(sample.time_s, sample.soc, open_v, rate, flies=ctx.in_air)
    if not math.isfinite(told.soc):
        return
    if told.contradicted and not was_contradicted:
        ctx.say("gauge", f"the vehicle says {100 * sample.soc:.0f} %, its voltage says otherwise: not believed")
    ctx.told_soc = told.line(sample.time_s, rate)
    if leg is not None and flies and fell != 0.0:
        leg.told_start -= fell
        _lost(ctx, fell, f"the charge fell by {100 * fell:.0f} % at once, and the voltage with it: lost, not used")
    if told.contradicted or not sample.time_s < told.held_s + CONFIRMING_S:
        doubted = ctx.voltage.doubtful()
        given = (sample.time_s, sample.voltage_v, sample.current_a, ctx.told_soc)
        fell = ctx.voltage.hear(*given, load=_load(ctx, sample), flies=flies and ctx.in_air)
        if doubted and ctx.voltage.lost > 0.0 and not ctx.voltage.doubtful():
            ctx.lost_s = ctx.now_s
        if flies and fell != 0.0:
            said = f"the vehicle says {100 * sample.soc:.0f} %, that is not believed"
            _lost(ctx, fell, f"the voltage fell as if {100 * fell:.0f} % were lost at once; {said}")
    soc, source = ctx.told_soc - ctx.voltage.lost, "the vehicle"
    if leg is not None and math.isfinite(leg.soc_start) and (ctx.gauge != 1.0 or ctx.voltage.lost > 0.0):
        soc, source = leg.soc_start - ctx.gauge * (leg.told_start - ctx.told_soc), "the vehicle, corrected"
    ctx.soc, ctx.soc_source = max(soc, 0.0), source


def _load(ctx: Context, sample: TelemetrySample) -> float:
    """Power at the airspeed and climb of now, over that of hover: momentum theory, blades as they are."""
    use = None if ctx.leg is None else ctx.leg.modelled
    wind = ctx.wind.estimate
    blown = (
        ctx.wind.expected(sample.time_s, sample.lat_deg, sample.lon_deg)
        if wind is None
        else (wind.north_mps, wind.east_mps)
    )
    airspeed = math.hypot(sample.vel_north_mps - blown[0], sample.vel_east_mps - blown[1])
    level = 1.0 if use is None or use.load is None else float(use.load.factor(airspeed))
    half = -0.5 * sample.vel_down_mps / INFLOW_MPS
    return level * (BLADE_SHARE + (1.0 - BLADE_SHARE) * (half + math.sqrt(half * half + 1.0)))


def _lost(ctx: Context, fell: float, reason: str) -> None:
    """Take charge that is gone from what the flight began with: it was not used. What was never gone is given back."""
    if ctx.leg is not None:
        ctx.leg.soc_start -= fell
    ctx.flown_from = (math.nan, math.nan)
    if fell > 0.0:
        ctx.lost_s = ctx.now_s
    else:
        reason = f"the {100 * -fell:.0f} % that seemed lost are there again: a wrong measurement"
    ctx.say("gauge", reason, fell_soc=fell)


def learn_gauge(ctx: Context, told_before: float, pad_soc: float) -> None:
    """Compare what the vehicle said it used in a flight with what the pad finds missing."""
    said, used = ctx.flown_from[0] - told_before, ctx.flown_from[1] - pad_soc
    if not (said > MIN_GAUGE_SOC and math.isfinite(used)):
        return
    ratio = min(max(used / said, 0.7), 1.5)
    ctx.gauge += 0.5 * (ratio - ctx.gauge)
    reason = f"the pad finds {100 * pad_soc:.0f} %, the vehicle says {100 * told_before:.0f} %"
    ctx.note("gauge", reason, used_soc=used, said_soc=said, factor=ctx.gauge)
