"""Formatting of times, probabilities and figures, with no more digits than are certain."""

from __future__ import annotations

import math
from datetime import timedelta
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime
    from zoneinfo import ZoneInfo

    from skyway.models.base.figure import Figure
    from skyway.models.composition.composition import Composition

STEPS_S = (1, 2, 5, 10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600)
"""Times are rounded to one of these."""
UNKNOWN = "unknown"
"""What is said of a figure that is not known, or no finite number."""
SURE = 0.25
"""A figure is rounded to a step of at least this share of how far its interval reaches."""


def step_for(half_width_s: float) -> int:
    """Return the step to which a time is rounded whose interval reaches so far."""
    return next((step for step in STEPS_S if step >= SURE * half_width_s), STEPS_S[-1])


def duration(seconds: float) -> str:
    """Return a duration for people: ``1 h 12 min``, ``17 min``, ``4.5 min``, ``20 s``."""
    if not math.isfinite(seconds):
        return UNKNOWN
    if seconds < 59.5:
        return f"{seconds:.0f} s"
    minutes = seconds / 60.0
    if minutes < 9.95:
        return f"{minutes:.1f} min"
    return _hours(round(minutes))


def about(figure: Figure) -> str:
    """Return a delivery time with as many digits as it is sure: ``1 h 35 min``, ``19 min 30 s``."""
    if not _known(figure):
        return UNKNOWN
    return _stepped(figure.value, step_for(figure.half_width))


def between(figure: Figure) -> str:
    """Return its interval, rounded outwards: ``1 h 20 min to 1 h 50 min``; empty where nothing was sampled."""
    if not _known(figure):
        return ""
    step = step_for(figure.half_width)
    low, high = step * math.floor(figure.low / step + 1e-9), step * math.ceil(figure.high / step - 1e-9)
    return f"{_stepped(low, step)} to {_stepped(high, step)}" if high > low else ""


def rounded_s(figure: Figure) -> float:
    """Return the value in seconds as `about` says it."""
    step = step_for(figure.half_width)
    return float(step * round(figure.value / step))


def minutes(figure: Figure) -> str:
    """Return a time for a table in minutes: ``95 ± 15``, ``33.0 ± 0.5``, ``17.5`` where nothing was sampled."""
    if not _known(figure):
        return UNKNOWN
    step = step_for(figure.half_width)
    digits = 0 if step >= 60 else 1
    value = rounded_s(figure) / 60.0
    if figure.high <= figure.low:
        return f"{figure.value / 60.0:.1f}"
    unit = 10.0**-digits
    off = max(unit * math.ceil(figure.half_width / 60.0 / unit - 1e-9), unit)
    return f"{value:.{digits}f} ± {off:.{digits}f}"


def share(figure: Figure) -> str:
    """Return a probability with as many digits as it is sure: ``92 %``, ``99.8 %``, ``>99.8 %``, ``<0.2 %``."""
    if not _known(figure):
        return UNKNOWN
    value, low, high = figure.value, figure.low, figure.high
    if high <= low:
        return percent(value, 1)
    if value >= 1.0:
        return f">{_floor(100.0 * low)} %"
    if value <= 0.0:
        return f"<{_ceil(100.0 * high)} %"
    return percent(value, 0 if figure.half_width >= 0.005 else 1)


def percent(fraction: float | None, digits: int = 0) -> str:
    """Return a percentage; a probability just below 1 does not round up to it, nor one just above 0 down."""
    if fraction is None or not math.isfinite(fraction):
        return UNKNOWN
    text = f"{100 * fraction:.{digits}f}"
    if fraction < 1.0 and float(text) >= 100.0:
        return f">{100.0 - 10.0**-digits:g} %" if digits else ">99 %"
    if fraction > 0.0 and float(text) == 0.0:
        return f"<{10.0**-digits:g} %"
    return f"{text} %"


def spent(seconds: float) -> str:
    """Return computing time such as ``4.1 ms`` or ``12.3 s``."""
    if not math.isfinite(seconds):
        return UNKNOWN
    return f"{1000 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


def clock(instant: datetime, zone: ZoneInfo, since: datetime, *, seconds: bool = False) -> str:
    """Local time of day, with the days since another instant where it is not the same day."""
    local = instant.astimezone(zone)
    days = (local.date() - since.astimezone(zone).date()).days
    return f"{local:%H:%M:%S}"[: 8 if seconds else 5] + (f" +{days}d" if days else "")


def later_text(later: Figure) -> str:
    """Return how much later something arrives on average, or that no difference can be told."""
    if not _known(later):
        return UNKNOWN
    if later.low < 0.0 < later.high:
        return f"no clear difference on average ({minutes(later)} min)"
    word = "later" if later.value > 0.0 else "earlier"
    return f"{minutes(later if later.value > 0.0 else later.scaled(-1.0))} min {word} on average"


def headline(c: Composition, zone: ZoneInfo) -> str:
    """What to expect, in a line: delivered when, on average, half and 95 % of the times."""
    figures = c.arrival.delivery_mean, c.arrival.delivery_p50, c.arrival.delivery_p95
    name = c.depart.astimezone(zone).tzname()
    mean, middle, late = figures
    if mean is None or middle is None or late is None:
        at = f"{clock(c.arrive, zone, c.depart)} {name}"
        return f"Delivery in {duration(c.delivery_time_s)}, at {at}, if wind and queues are as given"
    half, most = (by(figure, c, zone) for figure in (middle, late))
    return f"Delivery in {about(mean)} on average: half of the deliveries by {half}, 95 % by {most} {name}"


def by(figure: Figure, c: Composition, zone: ZoneInfo) -> str:
    """Clock time of a delivery time, as sure as that is: with seconds only where they are sure to the second."""
    if not _known(figure):
        return UNKNOWN
    seconds = step_for(figure.half_width) == 1
    instant = c.depart + timedelta(seconds=rounded_s(figure) + (0.0 if seconds else 30.0))  # to the nearest minute
    return clock(instant, zone, c.depart, seconds=seconds)


def _known(figure: Figure) -> bool:
    return all(map(math.isfinite, (figure.value, figure.low, figure.high)))


def _stepped(seconds: float, step: int) -> str:
    whole = step * round(seconds / step)
    if step >= 60:
        return _hours(whole // 60)
    hours, rest = divmod(whole, 3600)
    minute, second = divmod(rest, 60)
    parts = [f"{hours} h"] * (hours > 0) + [f"{minute} min"] * (minute > 0 or hours > 0)
    return " ".join(parts + [f"{second} s"] * (second > 0 or not parts))


def _hours(minutes_: int) -> str:
    hours, rest = divmod(minutes_, 60)
    return " ".join([f"{hours} h"] * (hours > 0) + [f"{rest} min"] * (rest > 0 or not hours))


def _floor(value: float) -> str:
    return f"{math.floor(10.0 * value + 1e-9) / 10.0:g}"


def _ceil(value: float) -> str:
    return f"{math.ceil(10.0 * value - 1e-9) / 10.0:g}"
