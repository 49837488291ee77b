"""The state that a resume needs besides the plan: written with each plan, take-off and landing, and read again."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import Landed, LegBegun, PlanTaken
from skyway.link.supervisor.journal.parts import Observation, Standing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.journal.file import Record


def standing(ctx: Context) -> Standing:
    """Return the state as a part of the journal."""
    delivery = ctx.delivery
    return Standing(
        station=delivery.station,
        visited=tuple(sorted(delivery.visited)),
        belief=asdict(ctx.energy.belief),
        diverts=delivery.diverts,
        charge_to=delivery.charge_to,
        asked_once=ctx.conversation.take_off_confirmed,
        gauge=ctx.energy.gauge,
        lost_soc=ctx.battery.lost_soc,
        observations=tuple(Observation(**asdict(one)) for one in ctx.wind.observations),
        booted_s=ctx.vehicle.live.clock.booted_s,
    )


def restore_standing(ctx: Context, stored: Standing) -> None:
    """Restore the state."""
    ctx.delivery.restore(stored.station, stored.visited, stored.diverts, stored.charge_to)
    belief = {key: float(value) for key, value in stored.belief.items()}
    ctx.energy.restore(belief, 1.0 if stored.gauge is None else stored.gauge)
    ctx.conversation.allow(once=bool(stored.asked_once))
    ctx.battery.restore(lost_soc=stored.lost_soc or 0.0)
    ctx.wind.restore(stored.observations)


def last_standing(records: Sequence[Record]) -> Standing | None:
    """Return the newest state in a journal; None where there is none yet."""
    for record in reversed(records):
        entry = record.entry(PlanTaken) or record.entry(LegBegun) or record.entry(Landed)
        if entry is not None:
            return entry.standing
    return None


def measured_winds(records: Sequence[Record]) -> tuple[Observation, ...]:
    """Return the winds at cruise height of the last record in a journal."""
    found = last_standing(records)
    return () if found is None else found.observations
