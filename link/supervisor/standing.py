"""What a resume needs besides the plan: written with each plan, take-off and landing, and read again."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context


def standing(ctx: Context) -> dict[str, Any]:
    """Return it as the journal has it."""
    delivery = ctx.delivery
    return {
        "station": delivery.station,
        "visited": sorted(delivery.visited),
        "belief": asdict(ctx.energy.belief),
        "diverts": list(delivery.diverts),
        "charge_to": delivery.charge_to,
        "asked_once": ctx.conversation.asked_once,
        "gauge": ctx.battery.gauge,
        "lost_soc": ctx.battery.lost_soc,
        "observations": ctx.wind.as_data(),
    }


def restore_standing(ctx: Context, data: dict[str, Any]) -> None:
    """Bring it back."""
    ctx.delivery.restore(
        data.get("station"), data.get("visited", ()), data.get("diverts", ()), data.get("charge_to")
    )  # fmt: skip
    if belief := data.get("belief"):
        ctx.energy.restore({key: float(value) for key, value in belief.items()})
    ctx.conversation.allow(once=bool(data.get("asked_once")))
    ctx.battery.restore(gauge=float(data.get("gauge", 1.0)), lost_soc=float(data.get("lost_soc", 0.0)))
    ctx.wind.restore(data.get("observations", ()))
