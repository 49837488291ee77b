"""Interventions of somebody else on the vehicle: the supervisor then sends no commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.states import IN_AIR, State, Turn
from skyway.link.telemetry.stored_lists import KINDS
from skyway.models.base.errors import CommandRefusedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import Context
    from skyway.link.telemetry.vehicle_monitor import Change

ALONE_S = 2.5
"""Time to receive messages of other supervisors before the first command, s: each broadcasts its presence every
second."""


def follows_a_landing(ctx: Context, change: Change) -> bool:
    """Whether a change is the autopilot's own at the end of a flight: it disarms, and leaves mission mode."""
    s = ctx.observed.sample
    down = s is not None and s.landed == 1.0 and not ctx.in_air
    ends = (change.what == "armed" and change.after == "disarmed") or (change.what == "mode" and not ctx.vehicle.armed)
    return down and ends and ctx.state in (*IN_AIR, State.LANDED)


def landed(ctx: Context) -> bool:
    """Whether the flight has ended: disarmed, and on the ground as far as reported."""
    return ctx.on_ground and not ctx.vehicle.armed


def refuse_foreign(ctx: Context, changes: Sequence[Change], own_modes: tuple[str, ...]) -> None:
    """Hold (a `Turn`) in the air if something is not ours: a mode, a mission, a restart."""
    for change in changes:
        if change.ours:
            continue
        # the end of a mission changes the mode too, and so does a change that was already reverted
        lasts = ctx.vehicle.mode == change.after and ctx.in_air
        if change.what == "mode" and change.after not in own_modes and lasts:
            said = "; ".join(ctx.vehicle.texts()[-2:])
            words = f"; it reports: {said}" if said else ""
            raise Turn(State.HOLDING, f"somebody else switched the drone to mode {change.after}{words}")
        if ctx.in_air and (changed := _foreign(ctx, change)):
            raise Turn(State.HOLDING, changed)
        if change.what == "boot" and ctx.in_air:
            raise Turn(State.HOLDING, "the autopilot restarted in the air")


def refuse_on_ground(ctx: Context, changes: Sequence[Change]) -> None:
    """Hold (a `Turn`) on the ground if somebody else arms the drone, or changes the mission it is about to fly."""
    for change in changes:
        if change.ours:
            continue
        if change.what == "armed" and change.after == "armed":
            raise Turn(State.HOLDING, "somebody else armed the drone")
        if ctx.state is State.READY and (changed := _foreign(ctx, change)):
            raise Turn(State.HOLDING, f"{changed}, before the take-off")


def _foreign(ctx: Context, change: Change) -> str:
    """Describe what somebody else changed that a flight depends on, or who took control; empty if neither happened."""
    if change.what in KINDS:
        return f"somebody else changed the {change.what} of the drone ({change.before} to {change.after})"
    kind, _, name = change.what.partition(" ")
    if kind == "parameter" and name in ctx.vehicle.relied_on:
        return f"somebody else changed {name} of the drone from {change.before} to {change.after}"
    if kind == "control" and not ctx.vehicle.obeys_us:
        return f"ground station {change.after} has taken control of the drone"
    return ""


def must_be_alone(ctx: Context) -> None:
    """End a delivery (a `Turn`) while another skyway supervises the drone.

    Of two that have not commanded it yet the one with the lower system and component id continues; one that has, continues.
    """
    connection = ctx.vehicle.connection
    other = connection.stations.supervisor_of(ctx.vehicle.system, connection.clock.now_s())
    if other is None:
        return
    ours = not connection.commanded, connection.system, connection.component
    if (not other.under_way, other.system, other.component) < ours:
        reason = f"{other} supervises the drone: end one of the two deliveries"
        raise Turn(State.HOLDING if ctx.in_air else State.STOPPED, reason)


def first_order(ctx: Context) -> None:
    """Check before the first command that nobody else supervises the drone, and that it obeys us. Raises a `Turn` otherwise."""
    connection = ctx.vehicle.connection
    connection.supervise(ctx.vehicle.system, commanded=connection.commanded)
    end = ctx.clock.now_s() + ALONE_S
    while ctx.clock.now_s() < end:
        must_be_alone(ctx)
        ctx.tick(0.5)
    try:
        ctx.vehicle.take_control()
    except CommandRefusedError as error:
        raise Turn(State.HOLDING if ctx.in_air else State.STOPPED, str(error)) from error
    connection.supervise(ctx.vehicle.system, commanded=True)
