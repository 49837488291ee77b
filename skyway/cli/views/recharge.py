"""Output of a cut mission: one row for each battery, and when it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import duration, modelled, percent, with_unit

if TYPE_CHECKING:
    from skyway.recharge.order.ordering import OrderTold
    from skyway.recharge.order.picture_audit import PictureAudit
    from skyway.recharge.summary import FlightTold, RechargeSummary

COLUMNS = (
    Column("battery"),
    Column("leaves", "after the first"),
    Column("work done as far as", justify="left"),
    Column("flight"),
    Column("energy", "Wh"),
    Column("charge", justify="left", words="charge {}"),
    Column("keeps reserve"),
    Column("lands on", justify="left"),
    Column("wait"),
    Column("charges", justify="left", words="charges {}"),
)


def print_recharge(summary: RechargeSummary) -> None:
    """Print the flights as a table, and the results."""
    sheet = Sheet(list(COLUMNS))
    for flight in summary.flights:
        stay = flight.stay
        sheet.add(
            str(flight.number),
            duration(flight.depart_s) if flight.number > 1 else "",
            _left(flight),
            duration(flight.flight_s),
            f"{flight.energy_wh:.0f}",
            f"{percent(flight.soc_start)} to {percent(flight.soc_end)}",
            modelled(flight.p_reserve),
            stay.pad if stay else "the end",
            duration(stay.wait_s) if stay and stay.wait_s >= 0.5 else "",
            f"{duration(stay.charge_s)} to {percent(stay.soc_to)}" if stay and stay.charge_s >= 0.5 else "",
        )
    sheet.show()
    say("")
    mean, early, late = summary.ends_s
    stops = len(summary.flights) - 1
    say(
        f"ends {duration(mean)} after the first take-off (5 % by {duration(early)}, half by {duration(summary.end_p50_s)}, 95 % by"
        f" {duration(late)}, of {summary.runs} simulations); with no stop the work would take {duration(summary.work_s)}"
    )
    say(
        f"{stops} stop{'' if stops == 1 else 's'}; every landing keeps the reserve of {percent(summary.reserve_soc)} with"
        f" probability {modelled(summary.p_reserve)}"
    )
    if summary.pictures.before or summary.pictures.after:
        say(_pictures(summary.pictures))
    if summary.order is not None:
        say(_order(summary.order))
    for line in summary.decided_on_the_way:
        say(f"skyway fly decides {line}")
    for note in summary.notes:
        say(f"note: {note}")


def _pictures(audit: PictureAudit) -> str:
    """Report whether the written missions take the pictures of the original one."""
    return (
        f"{audit.before} pictures, none lost, none twice, at most {with_unit(audit.off_m, 'm', 2)} from where they were"
    )


def _order(told: OrderTold) -> str:
    """Report the gain of another order of the parts, and its upper bound."""
    if not told.moved:
        first = f"{told.units} parts in the order of the mission"
        instead = ": no earlier end was found"
    else:
        first = f"{told.moved} of {told.units} parts moved or reversed (items are those of reordered.plan)"
        instead = (
            ""
            if told.before_s is None
            else f": ends {duration(told.end_s)} after the first take-off by the plan, not {duration(told.before_s)}"
        )
    return f"{first}{instead}; lower bound for any order {duration(told.bound_s)}"


def _left(flight: FlightTold) -> str:
    left = flight.left_at
    if left is None:
        return "its end"
    return f"{'on the way to ' if left.on_the_way else ''}item {left.item} ({left.command})"
