"""Actions at a pad: request one until it is free, charge, and set the vehicle's battery counter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.pads import ManualPads
from skyway.link.supervisor.journal.entries import CounterSet, PadAnswered
from skyway.link.supervisor.observed.link_watch import ask, rest, wake
from skyway.link.supervisor.states import State
from skyway.models.base.errors import CommandRefusedError
from skyway.models.base.formatting import duration, percent
from skyway.models.queues.pad_service import DroneOnPad, PadServiceError

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

POLL_S = 10.0
DOUBT_SOC, FASTER = 0.1, 0.5
"""A reported charge that is higher by more than the first value is doubted until the second share of the modelled
charging time has passed."""
SHORT_SOC = 0.01
"""A charge that is lower than requested by less than this counts as reached."""
REDECIDE_S = 600.0
"""Interval, s, at which a drone that waits for a pad, or has long to charge, decides again: other drones arrive and
leave, and new hours of the forecast begin."""


def waiting(ctx: Context) -> After:
    """Request a pad until one is free."""
    begun_s = ctx.now_s
    said = ""
    rest(ctx)
    while True:
        try:
            on_pad = ctx.pads.charge(ctx.delivery.station or "", ctx.observed.system, ctx.delivery.charge_to or 1.0)
        except PadServiceError as error:
            if str(error) != said:
                said = str(error)
                ctx.note(PadAnswered(answer="refused"), said)
                ctx.tell(f"no pad at {ctx.delivery.station} yet: {said}. Asking again every {duration(POLL_S)}")
        else:
            if on_pad.state in ("charging", "done"):
                _note_pad(ctx, on_pad)
                return State.CHARGING, f"on a pad at {ctx.delivery.station}"
            line = f"waiting for a pad at {ctx.delivery.station}, {on_pad.place_in_line} drones ahead in line. Nothing to do"
            if line != said:
                said = line
                _note_pad(ctx, on_pad)
                ctx.tell(line)
        if ctx.now_s > begun_s + REDECIDE_S:
            return State.REPLANNING, f"no pad was free for {duration(REDECIDE_S)}: deciding again"
        ctx.wait_until(ctx.now_s + POLL_S)


def charging(ctx: Context) -> After:
    """Wait until the battery is charged."""
    target = ctx.delivery.charge_to or 1.0
    compared = ctx.delivery.charged
    job = ctx.job
    thinks = job.replanning and not job.dispatched and job.work is None and not isinstance(ctx.pads, ManualPads)
    begun_s, soc = ctx.now_s, ctx.battery.soc
    rest(ctx)
    while True:
        _hear_charged(ctx)
        if isinstance(ctx.pads, ManualPads) and not ctx.conversation.attended:
            return (
                State.STOPPED,
                f"charge the battery at {ctx.delivery.station}, then start again with --resume: nobody can type charged here",
            )
        try:
            on_pad = ctx.pads.charge(ctx.delivery.station or "", ctx.observed.system, target)
        except PadServiceError as error:
            ctx.note(PadAnswered(answer="refused"), str(error))
            return State.REPLANNING, f"charging was interrupted, deciding again: {error}"
        if on_pad.state == "waiting":
            return State.WAITING, "the pad was given to another drone: waiting for a free one"
        if on_pad.soc is not None and not 0.0 <= on_pad.soc <= 1.0:
            on_pad = _doubted(ctx, on_pad, "not a state of charge")
        if on_pad.soc is not None and ctx.now_s < begun_s + _least_s(ctx, soc, on_pad.soc):
            on_pad = _doubted(ctx, on_pad, "faster than any charger")
        if on_pad.soc is not None:
            if not compared:
                compared = True
                ctx.battery.compare(ctx, on_pad.soc)
            ctx.battery.measured(on_pad.soc)
        if on_pad.state == "done" or (on_pad.soc is not None and on_pad.soc >= target - 1e-6):
            break
        left = POLL_S if on_pad.done_s is None else on_pad.done_s - ctx.now_s
        if thinks and on_pad.soc is not None and left > REDECIDE_S and ctx.now_s > begun_s + REDECIDE_S:
            break
        ctx.wait_until(ctx.now_s + min(max(left + 0.5, 1.0), 60.0))
        if on_pad.soc is not None:
            ctx.battery.measured(on_pad.soc)
    _note_pad(ctx, on_pad)
    wake(ctx)
    _reset_counter(ctx, on_pad.soc)
    ctx.delivery.charge_done()
    reached = f"charged to {percent(ctx.battery.soc)}"
    ctx.tell(f"{reached} at {ctx.delivery.station}")
    return (
        State.REPLANNING,
        reached if ctx.battery.soc >= target - SHORT_SOC else f"{reached} of {percent(target)}: deciding again",
    )


def _least_s(ctx: Context, before: float, after: float) -> float:
    """Least time to charge from one SoC to another, s."""
    curve = ctx.job.scenario.drone(ctx.job.request.drone or "").charging_curve()
    return FASTER * float(curve.duration_s(before, np.float64(after))) if after > before + DOUBT_SOC else 0.0


def _doubted(ctx: Context, on_pad: DroneOnPad, why: str) -> DroneOnPad:
    """Replace an implausible answer of a pad: the drone is on the pad and charges, its SoC is unknown."""
    ctx.note(PadAnswered(answer="doubted", soc=on_pad.soc), f"the pad reports {on_pad.soc}: {why}; asking again")
    return DroneOnPad(drone=on_pad.drone, state="charging", to_soc=on_pad.to_soc)


def _hear_charged(ctx: Context) -> None:
    """Process the input ``charged``, or ``charged 83`` for 83 %, where people charge batteries."""
    while isinstance(ctx.pads, ManualPads) and (said := ctx.conversation.next_word()) is not None:
        word, _, percent = said.partition(" ")
        if word != "charged":
            ctx.operator.ask("not understood. Type charged when the battery is charged, or charged 83 for 83 %")
            continue
        known = percent.strip(" %").replace(".", "", 1).isdigit()
        ctx.pads.charged(
            ctx.observed.system, float(percent.strip(" %")) / 100.0 if known else ctx.delivery.charge_to or 1.0
        )


def _reset_counter(ctx: Context, soc: float | None) -> None:
    """Set the battery counter of an autopilot that counts charge; one that estimates charge refuses this, which is correct."""
    if soc is None:
        return
    ctx.battery.forget()
    try:
        reported = ask(ctx, lambda: ctx.vehicle.reset_battery(soc))
    except CommandRefusedError:
        ctx.wait(2.0)
        return
    ctx.note(CounterSet(soc=soc, reported=reported), f"the battery counter of the drone was set to {percent(soc)}")
    if math.isfinite(reported):
        ctx.battery.counter_set(ctx.now_s, reported)


def _note_pad(ctx: Context, on_pad: DroneOnPad) -> None:
    answer = PadAnswered(
        answer=on_pad.state,
        soc=on_pad.soc,
        to_soc=on_pad.to_soc,
        place_in_line=on_pad.place_in_line,
        pad_free_s=on_pad.pad_free_s,
        done_s=on_pad.done_s,
    )
    ctx.note(answer, f"{on_pad.state} at {ctx.delivery.station}")
