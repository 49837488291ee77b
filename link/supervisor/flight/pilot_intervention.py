"""What somebody else does to the vehicle: then nothing more is commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.states import IN_AIR, State, Turn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import Context
    from skyway.link.telemetry.vehicle_monitor import Change


def follows_a_landing(ctx: Context, change: Change) -> bool:
    """Whether a change is what an autopilot does by itself at the end of a flight: it disarms, and leaves the mission's mode."""
    s = ctx.observed.sample
    down = s is not None and s.landed == 1.0 and not ctx.in_air
    ends = (change.what == "armed" and change.after == "disarmed") or (change.what == "mode" and not ctx.vehicle.armed)
    return down and ends and ctx.state in (*IN_AIR, State.LANDED)


def landed(ctx: Context) -> bool:
    """Whether the flight is over: disarmed, and on the ground as far as it tells."""
    return ctx.on_ground and not ctx.vehicle.armed


def refuse_foreign(ctx: Context, changes: Sequence[Change], own_modes: tuple[str, ...]) -> None:
    """Hold (a `Turn`) in the air where something is not ours: a mode, a mission, a restart."""
    for change in changes:
        if change.ours:
            continue
        # the end of a mission changes the mode too, and so does one that has been changed back already
        lasts = ctx.vehicle.mode == change.after and ctx.in_air
        if change.what == "mode" and change.after not in own_modes and lasts:
            said = "; ".join(ctx.vehicle.texts()[-2:])
            words = f"; it reports: {said}" if said else ""
            raise Turn(State.HOLDING, f"the drone is in mode {change.after}, which this program did not command{words}")
        if change.what == "mission" and ctx.in_air:
            raise Turn(
                State.HOLDING, f"somebody else changed the mission of the drone ({change.before} to {change.after})"
            )
        if change.what == "boot" and ctx.in_air:
            raise Turn(State.HOLDING, "the autopilot restarted in the air")


def refuse_on_ground(ctx: Context, changes: Sequence[Change]) -> None:
    """Hold (a `Turn`) on the ground where somebody else arms it, or changes what it is about to fly."""
    for change in changes:
        if change.ours:
            continue
        if change.what == "armed" and change.after == "armed":
            raise Turn(State.HOLDING, "somebody else armed the drone")
        if change.what in ("mission", "fence") and ctx.state is State.READY:
            raise Turn(State.HOLDING, f"somebody else changed the {change.what} of the drone before the take-off")
