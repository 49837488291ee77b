"""Release in the air: the mission lowers or places the package over the target and flies on; this module monitors it and collects evidence.

Nothing is commanded: with a lost link the vehicle does the same. The current mission item gives the stage of the release; the line length reported by a winch, and what ArduPilot
reports of a payload place, are evidence. From the last of these items on the drone flies back, and its mass is estimated.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import ReleaseNote
from skyway.link.supervisor.onward import flies_on
from skyway.missions.builder.release_items import release_range
from skyway.models.base.errors import LinkError
from skyway.models.base.formatting import with_unit
from skyway.models.composition.release import WINCH_HEIGHT_M, hovers

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context

_OPENED = re.compile(r"PayloadPlace:.*(releas|landed)|Gripper load releas", re.IGNORECASE)
_KEPT = re.compile(r"PayloadPlace:.*(maximum descent|abort|rangefinder)", re.IGNORECASE)
HANGS_S = 9.0
"""Time after the start of the release during which the package still hangs on the drone, s: it is weighed in the
hover, or the slow descent."""
ASK_S, SAME_M = 3.0, 0.1
"""Interval of requests for the line length while a winch unwinds, s; and the difference below which two lengths are
the same, m."""
LINE_M = 0.5
"""A line shorter than the hover height by more than this has not lowered the package to the ground, m."""


@dataclass(slots=True)
class ReleaseWatch:
    """Progress of the release on one leg; written only by `watch_release`."""

    begun_s: float | None = None
    """Time at which its first item was seen to be flown, by the clock."""
    line_m: float | None = None
    """Line length as last reported while it was unwound; None if never reported."""
    stands: bool = False
    """Two successive reports were the same: the drum has stopped."""
    requested_s: float = -math.inf
    seen_before: bool = False
    """It was monitored from the beginning of the release: a program restarted over the target does not know how
    long the package hangs."""
    weighed: bool = False

    def take(self, line_m: float | None) -> None:
        """Take a reported line length."""
        if line_m is not None:
            self.stands = self.line_m is not None and abs(line_m - self.line_m) < SAME_M
            self.line_m = line_m


def watch_release(ctx: Context, watch: ReleaseWatch) -> None:
    """Determine the stage of the release; once it is over, the drone is on its way back."""
    leg = ctx.delivery.leg
    if leg is None or not hovers(ctx.job.options.release) or not ctx.delivers_at(leg.destination):
        return
    items, number = release_range(leg.mission.document.mission.items), _item(ctx)
    if items is None or number is None:
        return
    if number < items[0]:
        watch.seen_before = True
        return
    now_s = ctx.clock.now_s()
    if number <= items[1]:
        if watch.begun_s is None:
            watch.begun_s = now_s
            ctx.proof.begins_release(watched=watch.seen_before)
            ctx.say(ReleaseNote(), f"over {leg.destination}: the package is released by {ctx.job.options.release}")
        if watch.seen_before and not watch.weighed and now_s >= watch.begun_s + HANGS_S:
            watch.weighed = True
            ctx.proof.before_release(ctx)
        if ctx.job.options.release == "winch" and number == items[0] + 1 and now_s >= watch.requested_s + ASK_S:
            watch.requested_s = now_s
            watch.take(_line_m(ctx))
        return
    acknowledged, how = _said(ctx, watch)
    ctx.note(ReleaseNote(), how)
    ctx.proof.released(ctx, acknowledged=acknowledged, how=how)
    ctx.proof.leaves(ctx, hovered=ctx.job.options.release == "winch")
    flies_on(ctx, leg, delivered=acknowledged is not False, why=how)


def _item(ctx: Context) -> int | None:
    """Number of the current item in our numbering; None if not reported."""
    said = ctx.vehicle.peer.latest.get("MISSION_CURRENT")
    return None if said is None else int(said["seq"]) - ctx.vehicle.family.home_items


def _line_m(ctx: Context) -> float | None:
    try:
        return ctx.vehicle.winch_line_m()
    except LinkError:
        return None


def _said(ctx: Context, watch: ReleaseWatch) -> tuple[bool | None, str]:
    """Report of the vehicle on the release: true, false or None; and in words."""
    since_s = ctx.status.entered_s if watch.begun_s is None else watch.begun_s - 1.0
    if ctx.job.options.release == "place":
        if kept := ctx.texts.saying(_KEPT, since_s):
            return False, f"the package was not placed: {kept}"
        if opened := ctx.texts.saying(_OPENED, since_s):
            return True, f"the package was placed: {opened}"
        return None, "the payload place ended, and the drone did not report the result"
    if watch.line_m is None:
        return None, "the winch reported nothing"
    if watch.line_m < WINCH_HEIGHT_M - LINE_M:
        if not watch.stands:
            return None, "the winch did not report the end"
        return (
            False,
            f"the winch let out {with_unit(watch.line_m, 'm')} of line, and the drone hovered at {WINCH_HEIGHT_M:g} m",
        )
    return True, f"the winch let out {with_unit(watch.line_m, 'm')} of line"
