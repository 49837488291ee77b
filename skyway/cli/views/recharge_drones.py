"""Output of a mission that several drones share: drones, the use of the pads over time, and the end of the last drone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import duration, modelled, percent, with_unit

if TYPE_CHECKING:
    from skyway.recharge.shared_summary import DronesSummary

DRONES = (
    Column("drone"),
    Column("parts"),
    Column("batteries"),
    Column("ends", "after the first"),
    Column("keeps reserve"),
    Column("to fly", justify="left"),
)
PADS = (
    Column("pad", justify="left"),
    Column("drone"),
    Column("from", "after the first"),
    Column("until", "after the first"),
)


def print_drones(summary: DronesSummary) -> None:
    """Print the drones and the pads as tables, and the results."""
    sheet = Sheet(list(DRONES))
    for one in summary.drones:
        told = one.summary
        sheet.add(
            str(one.number),
            str(one.units),
            str(len(told.flights)),
            duration(told.ends_s[0]),
            modelled(told.p_reserve),
            one.folder,
        )
    sheet.show()
    if summary.pads:
        say("")
        pads = Sheet(list(PADS))
        for stay in summary.pads:
            pads.add(f"{stay.pad} {stay.number}", str(stay.drone), duration(stay.from_s), duration(stay.until_s))
        pads.show()
    say("")
    mean, _, late = summary.ends_s
    say(
        f"all have ended {duration(mean)} after the first take-off (half by {duration(summary.end_p50_s)}, 95 % by {duration(late)}, of"
        f" {summary.runs} simulations)"
    )
    alone = "" if summary.alone_s is None else f"; one drone alone {duration(summary.alone_s)}"
    say(f"as planned {duration(summary.end_s)}; lower bound for any sharing {duration(summary.bound_s)}{alone}")
    say(
        f"every landing of every drone keeps the reserve of {percent(summary.reserve_soc)} with probability"
        f" {modelled(summary.p_reserve)}"
    )
    if summary.pictures:
        say(
            f"{summary.pictures} pictures, none lost, none twice, at most {with_unit(summary.pictures_off_m, 'm', 2)} from where they were"
        )
    for note in summary.notes:
        say(f"note: {note}")
