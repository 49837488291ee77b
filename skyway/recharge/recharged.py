"""A mission cut at pads, in its original order or in the best one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.recharge.order.ordering import with_best_order
from skyway.recharge.pad_slack import cut
from skyway.recharge.preparing import prepared

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.models.network.station import Station
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.problem import RechargeOptions


def recharged(
    document: MissionDocument, pads: Sequence[Station], families: Sequence[Family], options: RechargeOptions
) -> Recharged:
    """Cut a mission so that it can be flown with charges on pads on the way, and check every flight.

    An `InputError` gives the obstacle: an unknown home, no pad in reach with the deficit, an item that cannot be cut, a
    flight that an autopilot does not fly.
    """
    ready = prepared(document, pads, families, options)
    return with_best_order(ready, options) if options.reorder else cut(ready, options)
