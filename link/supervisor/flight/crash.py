"""Detection of a crash of a disarmed vehicle: it lies on its side or upside down, or reports a crash."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.states import State

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

LIES_DEG = 50.0
"""Least tilt of a crashed vehicle, degrees: no pad is as steep."""
LOOK_S = 120.0
"""Time over which the attitude is observed, s: longer than it may be reported wrongly."""


def leans_deg(ctx: Context) -> float:
    """Tilt in degrees; NaN where it is unknown."""
    s = ctx.observed.sample
    if s is None:
        return math.nan
    return math.degrees(math.acos(max(-1.0, min(1.0, math.cos(s.roll_rad) * math.cos(s.pitch_rad)))))


def lies(ctx: Context) -> str:
    """Attitude after a fall, in words; empty if the vehicle is upright or its attitude unknown."""
    end = ctx.clock.now_s() + LOOK_S
    while leans_deg(ctx) > LIES_DEG:
        if ctx.clock.now_s() >= end:
            return f"it leans {leans_deg(ctx):.0f}°"
        ctx.tick()
    return ""


def crashed(ctx: Context, since_s: float) -> str:
    """Why a crash is assumed, from messages since an instant of the clock; empty if none is."""
    said = ctx.texts.saying(ctx.vehicle.family.crash_texts, since_s)
    return f'it reports "{said}"' if said else lies(ctx)


def crash_end(ctx: Context, since_s: float) -> After | None:
    """Outcome of the delivery, with the place, if the drone has crashed since an instant (see `crashed`); None if it has not."""
    crash = crashed(ctx, since_s)
    if not crash:
        return None
    station = ctx.here_station()
    ctx.delivery.stand_at(station)
    where = station or ("an unknown place" if ctx.place is None else "no station")
    return State.CRASHED, f"the drone has crashed, at {where}: {crash}. Disconnect its battery before you handle it"
