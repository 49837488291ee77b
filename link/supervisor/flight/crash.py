"""Detection of a crash of a disarmed vehicle: it lies on its side or its back, or reports it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.states import State

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

LIES_DEG = 50.0
"""No pad leans as far."""
LOOK_S = 120.0
"""So long an attitude is looked at: longer than it may be told wrongly."""


def leans_deg(ctx: Context) -> float:
    """Tilt in degrees; NaN where it is unknown."""
    s = ctx.observed.sample
    if s is None:
        return math.nan
    return math.degrees(math.acos(max(-1.0, min(1.0, math.cos(s.roll_rad) * math.cos(s.pitch_rad)))))


def lies(ctx: Context) -> str:
    """Its attitude after a fall, in words; empty where it stands upright or that is unknown."""
    end = ctx.clock.now_s() + LOOK_S
    while leans_deg(ctx) > LIES_DEG:
        if ctx.clock.now_s() >= end:
            return f"it leans {leans_deg(ctx):.0f}°"
        ctx.tick()
    return ""


def crashed(ctx: Context, since_s: float) -> str:
    """Why it is taken for crashed, by what it has said since an instant of the clock; nothing where it is not."""
    said = ctx.texts.saying(ctx.vehicle.family.crash_texts, since_s)
    return f'it reports "{said}"' if said else lies(ctx)


def crash_end(ctx: Context, since_s: float) -> After | None:
    """How the delivery ends if the drone has crashed since an instant, see `crashed`, with the place; None where it has not."""
    crash = crashed(ctx, since_s)
    if not crash:
        return None
    station = ctx.here_station()
    ctx.delivery.stand_at(station)
    where = station or ("an unknown place" if ctx.place is None else "no station")
    return State.CRASHED, f"the drone has crashed, at {where}: {crash}. Disconnect its battery before you handle it"
