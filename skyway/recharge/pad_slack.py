"""Cutting at pads that are available for a limited time: stops end earlier by a slack, for the uncertainty of charging."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import probability
from skyway.recharge.cutting import cut_as_planned
from skyway.recharge.simulated import RUNS, simulated

if TYPE_CHECKING:
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeOptions

SLACKS_S = (60.0, 120.0, 240.0, 480.0, 960.0, 1920.0)
"""Slacks that are tried: stops end this long before the window of the pad, for the uncertainty of charging."""


def cut(ready: Prepared, options: RechargeOptions) -> Recharged:
    """Cut a mission as `recharged` does.

    A drone may arrive later, and charge longer, than planned. If a pad is available for a limited time, stops end earlier by a slack with
    which the simulated flights keep the reserve; a note reports if no slack does.
    """
    found = cut_as_planned(ready, options)
    if not options.windows or options.swap_s is not None:
        return found
    epsilon = options.epsilon
    enough = 1.0 - epsilon - 3.0 * math.sqrt(epsilon / RUNS)
    most = min(simulated(found).each_p_reserve)
    for slack_s in SLACKS_S:
        if most >= enough:
            return found
        try:
            other = cut_as_planned(ready, replace(options, window_slack_s=slack_s))
        except InputError:
            continue
        least = min(simulated(other).each_p_reserve)
        if least > most:
            found, most = other, least
    if most >= enough:
        return found
    note = (
        f"pads are not available long enough to charge for all uncertainty: as planned a landing keeps the reserve with {probability(most, 1)};"
        " if necessary, skyway fly leaves the work earlier"
    )
    return replace(found, notes=(*found.notes, note))
