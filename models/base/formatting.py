"""Formatting of times, probabilities and figures, with no more digits than are certain."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, TypeGuard

if TYPE_CHECKING:
    from datetime import tzinfo
    from zoneinfo import ZoneInfo

    from skyway.models.base.statistics import Figure
    from skyway.models.composition.composition import Composition

STEPS_S = (1, 2, 5, 10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600)
"""Times are rounded to one of these."""
UNKNOWN = "unknown"
"""Text for a figure that is unknown or not finite."""
SURE = 0.25
"""A figure is rounded to a step of at least this share of its interval's half width,"""
FINE = 0.1
"""but of no more than this share of a time: what is known within a factor of four has two digits, too."""


def is_known(value: float | None) -> TypeGuard[float]:
    """Whether a figure is known, and a finite number."""
    return value is not None and math.isfinite(value)


def natural(text: str) -> tuple[tuple[str, int], ...]:
    """Return the key by which people sort names: numbers in them by their values, ``d2`` before ``d10``."""
    return tuple((word, int(number or -1)) for word, number in re.findall(r"([^0-9]*)([0-9]{0,18})", text))


def step_for(half_width_s: float, time_s: float = math.inf) -> int:
    """Return the rounding step of a time, given the half width of its interval; only a time above 0 limits it."""
    wanted = next((step for step in STEPS_S if step >= SURE * half_width_s), STEPS_S[-1])
    most_s = FINE * time_s if time_s > 0.0 else math.inf
    return max((step for step in STEPS_S if step <= min(wanted, most_s)), default=STEPS_S[0])


def step_of(figure: Figure) -> int:
    """Return the rounding step of a time with its interval."""
    return step_for(figure.half_width, figure.value)


def duration(seconds: float | None, *, signed: bool = False) -> str:
    """Return a duration for people: ``1 h 12 min``, ``17 min``, ``4.5 min``, ``20 s``; signed ``+4.5 min``."""
    if not is_known(seconds):
        return UNKNOWN
    length = abs(seconds)
    if length < 59.5:
        text = f"{length:.0f} s"
    elif length < 597.0:
        text = f"{length / 60.0:.1f}".removesuffix(".0") + " min"
    else:
        text = _hours(round(length / 60.0))
    return ("-" if seconds <= -0.5 else "+" if signed else "") + text


def counter(seconds: float | None) -> str:
    """Return a running time to the second, hours first: ``0:04:09``, ``1:02:35``."""
    if not is_known(seconds):
        return UNKNOWN
    minutes, rest = divmod(abs(round(seconds)), 60)
    return f"{'-' * (seconds < -0.5)}{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def about(figure: Figure) -> str:
    """Return a delivery time with as many digits as are certain: ``1 h 35 min``, ``19 min 30 s``."""
    if not _known(figure):
        return UNKNOWN
    return _stepped(figure.value, step_of(figure))


def between(figure: Figure) -> str:
    """Return its interval, rounded outwards: ``1 h 20 min to 1 h 50 min``; empty if nothing was sampled.

    Each end is rounded by its own distance from the value, so that the step of a long upper tail does not hide the lower end.
    """
    if not _known(figure):
        return ""
    below = step_for(figure.value - figure.low, figure.low)
    above = step_for(figure.high - figure.value, figure.high)
    low, high = below * math.floor(figure.low / below + 1e-9), above * math.ceil(figure.high / above - 1e-9)
    low_s, high_s = min(low, rounded_s(figure)), max(high, rounded_s(figure))  # with the value, as `about` writes it
    step = 1 if min(below, above) < 60 else 60
    return f"{_stepped(low_s, step)} to {_stepped(high_s, step)}" if high_s > low_s else ""


def rounded_s(figure: Figure) -> float:
    """Return the value in seconds as rounded by `about`."""
    step = step_of(figure)
    return float(step * round(figure.value / step))


def promised(*quantiles: Figure) -> list[Figure]:
    """Return quantiles of a delivery time, ascending, as they are promised: rounded up, and none before the one before it."""
    found: list[Figure] = []
    least_s = 0.0
    for one in quantiles:
        if _known(one):
            due_s = max(one.value, least_s)
            step = step_of(_moved(one, due_s - one.value))
            found.append(_moved(one, step * math.ceil(due_s / step - 1e-9) - one.value))
            least_s = found[-1].value
        else:
            found.append(one)
    return found


def _moved(figure: Figure, more: float) -> Figure:
    """Return a later time of the same uncertainty."""
    return replace(figure, value=figure.value + more, low=figure.low + more, high=figure.high + more)


def minutes(figure: Figure) -> str:
    """Return a time or a difference for a table in minutes: ``95 ± 15``, ``33.0 ± 0.5``, ``17.5`` where nothing was sampled."""
    if not _known(figure):
        return UNKNOWN
    step = step_of(figure) if figure.low > 0.0 else step_for(figure.half_width)
    digits = 0 if step >= 60 else 1
    value = step * round(figure.value / step) / 60.0
    if figure.high <= figure.low:
        return f"{figure.value / 60.0:z.1f}"
    unit = 10.0**-digits
    off = max(unit * math.ceil(figure.half_width / 60.0 / unit - 1e-9), unit)
    return f"{value:z.{digits}f} ± {off:.{digits}f}"


def share(figure: Figure) -> str:
    """Return a probability with as many digits as are certain: ``92 %``, ``99.8 %``, ``>99.8 %``, ``<0.2 %``."""
    if not _known(figure):
        return UNKNOWN
    value, low, high = figure.value, figure.low, figure.high
    if high <= low:
        return probability(value, 1)
    if value >= 1.0:
        return f">{math.floor(1000.0 * low + 1e-9) / 10.0:g} %"
    if value <= 0.0:
        return f"<{math.ceil(1000.0 * high - 1e-9) / 10.0:g} %"
    return probability(value, 0 if figure.half_width >= 0.005 else 1)


def percent(fraction: float | None, digits: int | None = 0, *, signed: bool = False) -> str:
    """Return a share as a percentage: ``87 %``; without `digits`, three significant ones, for given values: ``0.05 %``."""
    if not is_known(fraction):
        return UNKNOWN
    return f"{100 * fraction:{'+' if signed else ''}{'.3g' if digits is None else f'.{digits}f'}} %"


def probability(fraction: float | None, digits: int = 0) -> str:
    """Return a probability as a percentage: just below 1 it does not round up to it, just above 0 not down."""
    if not is_known(fraction):
        return UNKNOWN
    text = f"{100 * fraction:.{digits}f}"
    if fraction < 1.0 and float(text) >= 100.0:
        return f">{100.0 - 10.0**-digits:g} %" if digits else ">99 %"
    if fraction > 0.0 and float(text) == 0.0:
        return f"<{10.0**-digits:g} %"
    return f"{text} %"


def modelled(fraction: float | None, digits: int = 1) -> str:
    """Return a probability that a model states, which is never certain: ``>99.9 %`` and ``<0.1 %`` also for 1 and 0."""
    return probability(min(max(fraction, 1e-12), 1.0 - 1e-12) if is_known(fraction) else None, digits)


def kept_share(p_kept: float | None, runs: int | None) -> str:
    """Return the probability that a landing keeps the reserve; so many runs cannot show fewer than three failures in their number."""
    if p_kept is not None and runs and p_kept >= 1.0 - 0.5 / runs:
        return f">{100.0 - int(3000.0 / runs + 0.999) / 10.0:g} %"
    return probability(p_kept)


def spent(seconds: float) -> str:
    """Return computing time such as ``4.1 ms`` or ``12.3 s``."""
    if not is_known(seconds):
        return UNKNOWN
    return f"{1000 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


def distance_text(metres: float | None) -> str:
    """Return a distance: ``850 m``, ``12.3 km``."""
    if not is_known(metres):
        return UNKNOWN
    return f"{metres:.0f} m" if abs(metres) < 999.5 else f"{metres / 1000.0:.1f} km"


def height_text(metres: float | None) -> str:
    """Return a height in whole metres: ``60 m``."""
    return with_unit(metres, "m", 0)


def speed_text(mps: float | None) -> str:
    """Return a speed: ``7.4 m/s``."""
    return with_unit(mps, "m/s")


def wind_text(mps: float, from_deg: float, sigma_mps: float | None = None) -> str:
    """Return a wind by speed and the direction it blows from: ``7.4 ± 0.8 m/s from 031°``."""
    sure = "" if sigma_mps is None else f" ± {sigma_mps:.1f}"
    return f"{mps:.1f}{sure} m/s from {direction_text(from_deg)}" if math.isfinite(mps + from_deg) else UNKNOWN


def direction_text(degrees: float, step: int = 1) -> str:
    """Return a direction clockwise from north as three digits, to a step: ``031°``."""
    return f"{round(degrees / step) * step % 360:03d}°"


def energy_text(joule: float | None) -> str:
    """Return an energy in watt-hours: ``41.3 Wh``, ``612 Wh``."""
    if not is_known(joule):
        return UNKNOWN
    return f"{watt_hours(joule)} Wh"


def watt_hours(joule: float) -> str:
    """Return an energy for a column in watt-hours."""
    return f"{joule / 3600.0:.{1 if abs(joule) < 359_820.0 else 0}f}"


def money(amount: float) -> str:
    """Return an amount of money with two or more digits after the point: ``12.40``, ``0.043``."""
    return f"{amount:,.2f}" if abs(amount) >= 0.1 or amount == 0.0 else f"{amount:.2g}"


def kilometres(metres: float) -> str:
    """Return a distance for a column in kilometres."""
    return f"{metres / 1000.0:.1f}"


def from_to(first: float, last: float) -> str:
    """Return two shares for a column in percent: ``95 > 41``."""
    return f"{100 * first:.0f} > {100 * last:.0f}"


def mass_text(kg: float | None) -> str:
    """Return a mass to the gram: ``2.35 kg``."""
    return f"{round(kg, 3):g} kg" if is_known(kg) else UNKNOWN


def bytes_text(count: float | None) -> str:
    """Return an amount of data: ``812 bytes``, ``46.2 kB``, ``13.0 MB``."""
    if not is_known(count):
        return UNKNOWN
    if count < 1000.0:
        return f"{count:.0f} bytes"
    return f"{count / 1e3:.1f} kB" if count < 999_950.0 else f"{count / 1e6:.1f} MB"


def place_text(lat_deg: float, lon_deg: float) -> str:
    """Return a place to about a metre: ``40.71234,-74.00123``."""
    return f"{lat_deg:.5f},{lon_deg:.5f}"


def stored_degrees(lat_deg: float, lon_deg: float) -> tuple[str, str]:
    """Return latitude and longitude of an item as vehicles store them: 1e-7 degree, about a centimetre."""
    return f"{lat_deg:.7f}", f"{lon_deg:.7f}"


def with_unit(value: float | None, unit: str, digits: int = 1) -> str:
    """Return a figure of any other quantity, rounded, with its unit: ``412 W``."""
    return f"{value:.{digits}f} {unit}" if is_known(value) else UNKNOWN


def zone_clock(instant: datetime, zone: tzinfo) -> str:
    """Return the time of day in a zone, with the zone's name: ``14:03:22 EDT``."""
    local = instant.astimezone(zone)
    return f"{local:%H:%M:%S} {local:%Z}"


def minute_clock(instant: datetime, zone: tzinfo) -> str:
    """Return the minute that has begun by an expected instant, with the zone's name: ``14:04 EDT``."""
    local = (instant + timedelta(minutes=1) - timedelta(microseconds=1)).astimezone(zone)
    return f"{local:%H:%M} {local:%Z}"


def local_clock(at_s: float | None, zone: tzinfo) -> str:
    """Return the time of day in a zone of POSIX seconds: ``14:03:22``."""
    return UNKNOWN if at_s is None else f"{datetime.fromtimestamp(at_s, zone):%H:%M:%S}"


def zone_name(at_s: float, zone: tzinfo) -> str:
    """Return the name of a zone at POSIX seconds: ``EDT``."""
    return f"{datetime.fromtimestamp(at_s, zone):%Z}"


def date_clock(instant: datetime, zone: tzinfo = UTC, *, named: bool = False) -> str:
    """Return day and time of day in a zone: ``2013-07-10 14:00``; with the zone named: ``2013-07-10 14:00 EDT``."""
    local = instant.astimezone(zone)
    return f"{local:%Y-%m-%d %H:%M}" + (f" {local:%Z}" if named else "")


def weekday_clock(instant: datetime, zone: tzinfo) -> str:
    """Return weekday and time of day in a zone, for the hours of a forecast: ``Wed 14:00``."""
    return f"{instant.astimezone(zone):%a %H:%M}"


def clock(instant: datetime, zone: tzinfo, since: datetime, *, seconds: bool = False, named: bool = True) -> str:
    """Local time of day, with the days since another instant where it is not the same day.

    With the zone's name where the clock was changed since then, if it is to be `named`.
    """
    local, before = instant.astimezone(zone), since.astimezone(zone)
    days = (local.date() - before.date()).days
    name = f" {local:%Z}" if named and local.utcoffset() != before.utcoffset() else ""
    return f"{local:%H:%M:%S}"[: 8 if seconds else 5] + name + (f" {days:+d}d" if days else "")


def later_text(later: Figure) -> str:
    """Return the mean delay of an arrival against another, or that there is no measurable difference."""
    if not _known(later):
        return UNKNOWN
    if later.low == later.high == 0.0:
        return "no difference on average"
    if later.low < 0.0 < later.high:
        found = f"{minutes(later)} min" if later.value >= 0.0 else f"{minutes(later.scaled(-1.0))} min earlier"
        return f"no clear difference on average ({found})"
    word = "later" if later.value > 0.0 else "earlier"
    return f"{minutes(later if later.value > 0.0 else later.scaled(-1.0))} min {word} on average"


def headline(c: Composition, zone: ZoneInfo) -> str:
    """The promise in a line: expected delivery time, mean, median and 95 %."""
    figures = c.arrival.delivery_mean, c.arrival.delivery_p50, c.arrival.delivery_p95
    name = c.depart.astimezone(zone).tzname()
    mean, middle, late = figures
    if mean is None or middle is None or late is None:
        at = f"{clock(c.arrive, zone, c.depart, named=False)} {c.arrive.astimezone(zone):%Z}"
        return f"Delivery in {duration(c.delivery_time_s)}, at {at}, if wind and queues are as given"
    times = promised(middle, late)
    names = [_due(one, c).astimezone(zone).tzname() if _known(one) else name for one in times]
    half, most = (by(one, c, zone, named=False) for one in times)
    changed = f" {names[0]}" if names[0] != names[1] else ""  # the clock is changed between them
    return f"Delivery in {about(mean)} on average: half of the deliveries by {half}{changed}, 95 % by {most} {names[1]}"


def by(figure: Figure, c: Composition, zone: ZoneInfo, *, named: bool = True) -> str:
    """Clock time of a delivery time, with its precision: with seconds only if they are certain to the second, else the minute that has begun by then."""
    if not _known(figure):
        return UNKNOWN
    return clock(_due(figure, c), zone, c.depart, seconds=step_of(figure) == 1, named=named)


def _due(figure: Figure, c: Composition) -> datetime:
    at = c.depart + timedelta(seconds=rounded_s(figure))
    into_s = 0.0 if step_of(figure) == 1 else at.second + at.microsecond / 1e6
    return at + timedelta(seconds=60.0 - into_s) if into_s > 0.0 else at


def _known(figure: Figure) -> bool:
    return all(map(math.isfinite, (figure.value, figure.low, figure.high)))


def _stepped(seconds: float, step: int) -> str:
    whole = step * round(seconds / step)
    if step >= 60:
        return _hours(whole // 60)
    hours, rest = divmod(whole, 3600)
    minute, second = divmod(rest, 60)
    parts = [f"{hours} h"] * (hours > 0) + [f"{minute} min"] * (minute > 0 or (hours > 0 and second > 0))
    return " ".join(parts + [f"{second} s"] * (second > 0 or not parts))


def _hours(minutes_: int) -> str:
    hours, rest = divmod(minutes_, 60)
    return " ".join([f"{hours} h"] * (hours > 0) + [f"{rest} min"] * (rest > 0 or not hours))
