"""Capacity of a network as tables: shares of orders by rate, promise and fleet, capacities, and the best additions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import duration, percent, spent, with_unit
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from skyway.planner.capacity.study import CapacityFound, CaseDone

SHOWN, SURE = 12, 1.96
"""Changes that are shown (all are in the JSON), and how many standard errors a 95 % interval has on each side."""


def print_capacity(found: CapacityFound, wall_s: float) -> None:
    """Print the answer of a study."""
    names = (
        "promise",
        "drones",
        "orders/h",
        "as promised",
        "±",
        "of promises",
        "stated",
        "wait",
        "delivery",
        "below reserve",
    )
    sheet = Sheet([Column(one) for one in names])
    for one in found.cases:
        sheet.add(duration(one.case.promise_s), str(one.case.drones), f"{one.case.rate_per_h:g}", *_figures(one))
    sheet.show()
    say("")
    for capacity in found.capacities:
        fleet = f"{counted(capacity.drones, 'drone')}, due {duration(capacity.promise_s)} after they are ready"
        if math.isnan(capacity.rate_per_h):
            say(f"{fleet}: {percent(found.level)} as promised is not reached even at the lowest rate.")
        else:
            more = " or more" if capacity.beyond else ""
            low = f"{capacity.low_per_h:.1f}"
            between = f"at least {low}" if capacity.beyond else f"{low} to {capacity.high_per_h:.1f}"
            say(f"{fleet}: {capacity.rate_per_h:.1f} orders an hour{more} (95 %: {between}).")
    if found.base is not None:
        say("")
        case = found.base.case
        say(
            f"At {case.rate_per_h:g} orders an hour with {counted(case.drones, 'drone')}, one addition delivers this many more as promised:"
        )
        effects = Sheet(
            [Column("what", justify="left"), Column("orders/h"), Column("±"), Column("sure", justify="left")]
        )
        for effect in found.effects[:SHOWN]:
            effects.add(
                str(effect.change),
                f"{effect.per_h:+.2f}",
                with_unit(SURE * effect.sd_per_h, "", 2).strip(),
                "yes" if effect.sure else "",
            )
        effects.show()
        count = len(found.effects)
        say(
            f"{count} changes were tried; about {math.ceil(count / 40)} of them look this good by chance."
            if count
            else ""
        )
    say("")
    say(f"{found.days_simulated} days of {found.study.demand.hours:g} h simulated in {spent(wall_s)}.")


def _figures(one: CaseDone) -> list[str]:
    shares = [percent(one.served), percent(SURE * one.served_sd, 1), percent(one.kept), percent(one.stated)]
    return [*shares, *(with_unit(at, "min", 0) for at in (one.wait_min, one.delivery_min)), percent(one.below, 1)]
