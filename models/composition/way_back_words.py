"""The drone after the delivery, in words: for tables, briefings and reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.formatting import clock, distance_text, duration, energy_text, percent
from skyway.models.composition.release import hovers

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from skyway.models.composition.composition import Composition


def delivered_text(composition: Composition) -> str:
    """Describe the delivery of the package, and the drone's actions after it."""
    way = composition.way_back
    if way is None:
        return "delivered"
    if hovers(way.release):
        how = "lowered by winch" if way.release == "winch" else "placed on the ground"
        return f"delivered, {how} in {duration(way.dwell_s)} of hover; the drone does not land there"
    stays = f", {duration(way.dwell_s)} there" if way.dwell_s else ""
    if way.plan is not None:
        return f"delivered{stays}"
    return f"delivered{stays}; the drone stays at its pads" if _has_pads(composition) else f"delivered{stays}"


def end_text(back: Composition) -> str:
    """Describe where the way back ends."""
    return "the drone is back, at its pads" if _has_pads(back) else "the drone is back"


def way_back_lines(composition: Composition, zone: ZoneInfo) -> list[str]:
    """Describe duration and energy of the way back, and the reserve for a package that cannot be delivered."""
    way, lines = composition.way_back, []
    if way is None:
        return []
    if way.plan is not None:
        back = way.plan
        until = clock(back.arrive, zone, composition.depart)
        lines.append(
            f"Way back ({way.asked}), without the package: to {back.destination} by {until}, flight {duration(back.flight_time_s)}"
            + (f", recharge {duration(back.recharge_time_s)}" if back.recharge_time_s else "")
            + f"; {distance_text(back.distance_m)}, {energy_text(back.energy_j)}, lowest charge {percent(back.min_soc)}"
        )
    if way.undelivered is not None:
        kept = way.undelivered
        lines.append(
            f"If it cannot be handed over, the package goes to {kept.destination}: {duration(kept.delivery_time_s)}, "
            f"{distance_text(kept.distance_m)}, lowest charge {percent(kept.min_soc)}"
        )
    elif way.undelivered_to is not None:
        lines.append(f"If it cannot be handed over, the package stays at {way.undelivered_to}")
    return lines


def _has_pads(composition: Composition) -> bool:
    return composition.stations[composition.destination].pads > 0
