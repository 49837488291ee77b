"""The wind of a replayed flight, in a sentence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.formatting import counter, duration, modelled, wind_text
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from skyway.link.replay.replay import Replay


def wind_basis(found: Replay) -> str:
    """Return how the wind was measured, or why it is not known."""
    if not len(found.wind):
        if found.tally.doubted:
            return f"unknown: the filter is inconsistent for all {duration(found.tally.doubted)} of its measurements"
        why = f": {found.drag_reason}" if found.drag_source == "none" and found.drag_reason else ""
        return f"not measured{why}"
    later = "from the whole log, unlike in a live flight"
    return {
        "identified": f"drag identified {later}",
        "none": f"by airspeed, calibrated {later}" if found.airspeed_source == "identified" else "by airspeed",
        "given": "given drag",
        "nominal": "nominal drag",
    }[found.drag_source]


def wind_sentence(found: Replay) -> str:
    """Return the mean wind, for how much of the flight it was known, and the last known one, with its time if it is not that of the end."""
    if not len(found.known.last):
        return wind_basis(found)
    tally, known = found.tally, found.known
    speed, direction = speed_from(tally.mean(tally.north), tally.mean(tally.east))
    last_speed, last_direction = speed_from(*known.last.wind[0])
    last = wind_text(float(last_speed), float(last_direction), float(known.last.sigma_mps[0]))
    when = counter(float(known.last.time_s[0]) - found.summary.start_s)
    share = "" if math.isnan(known.share) else f", known for {_share(known.share)} of the flight"
    end = f"at its end {last}" if known.at_end else f"unknown at its end, last known at {when}: {last}"
    return f"{wind_text(float(speed), float(direction))} on average{share}; {end} ({wind_basis(found)})"


def _share(fraction: float) -> str:
    return "all" if fraction >= 1.0 else modelled(fraction, 0)
