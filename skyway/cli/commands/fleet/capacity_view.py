"""Capacity of a network as tables: shares of orders by rate, promise and fleet, capacities, and the best additions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import duration, percent, probability, spent, with_unit
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from skyway.planner.capacity.study import Capacity, CapacityFound, CaseDone

SHOWN = 12
"""Changes that are shown; all are in the JSON."""


def print_capacity(found: CapacityFound, wall_s: float) -> None:
    """Print the answer of a study."""
    names = (
        "promise",
        "drones",
        "orders/h",
        "as promised",
        "95 %",
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
        say(f"{_whose(capacity, found.study.demand.hours)}: {_capacity(capacity, found.level)}")
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
                with_unit(effect.half_per_h, "", 2).strip(),
                "yes" if effect.sure else "",
            )
        effects.show()
        count = len(found.effects)
        say(
            f"If none of these {counted(count, 'change')} had an effect, about {math.ceil(count / 40)} would be a sure gain by chance."
        )
    say("")
    hours = f"{found.study.demand.hours:g} h"
    say(
        f"{found.days_simulated:,} days of {hours} simulated in the wind of {counted(found.winds, 'day')} of the record, in {spent(wall_s)}."
    )


def _whose(capacity: Capacity, hours: float) -> str:
    """Fleet, promise and hours that a capacity is of."""
    fleet = counted(capacity.drones, "drone")
    return f"{fleet}, due {duration(capacity.promise_s)} after they are ready, {hours:g} h of orders a day"


def _capacity(capacity: Capacity, level: float) -> str:
    """Describe a capacity, and what the days tell of it."""
    if not capacity.orders:
        return "no orders came on these days; simulate more --days, or higher --rates."
    low, high = capacity.low_per_h, capacity.high_per_h
    if math.isinf(high):
        between = "too few days to tell" if math.isnan(low) else f"at least {low:.1f}"
    else:
        between = f"at most {high:.1f}" if math.isnan(low) else f"{low:.1f} to {high:.1f}"
    if math.isnan(capacity.rate_per_h):
        return f"{percent(level, None)} as promised is not reached even at the lowest rate (95 %: {between})."
    more = " or more" if capacity.beyond else ""
    return f"{capacity.rate_per_h:.1f} orders an hour{more} (95 %: {between})."


def _figures(one: CaseDone) -> list[str]:
    low, high = one.served_between
    between = "unknown" if math.isnan(low) else f"{percent(low)} to {percent(high)}"
    shares = [probability(one.served), between, probability(one.kept), probability(one.stated)]
    times = [with_unit(at, "min", 0) for at in (one.wait_min, one.delivery_min)]
    return [*shares, *times, probability(one.below, 1)]
