"""Output of weather files, and of comparisons of forecasts with observations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import date_clock, distance_text, duration, percent, speed_text
from skyway.models.base.units import from_posix, iso
from skyway.models.weather.lags import Lag, lags
from skyway.models.weather.weather import EAST, FROM, GUST, NORTH, SPEED, UNITS, FieldKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.weather.lead_error import LeadError
    from skyway.models.weather.verification import LeadScore
    from skyway.models.weather.weather import Weather

SHOWN_OTHERS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldReport:
    """One quantity at one height."""

    quantity: str
    height_m: float
    unit: str
    least: float
    mean: float
    greatest: float
    missing: float
    """Share of its values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IssueReport:
    """One issue of one model."""

    files: tuple[str, ...]
    form: str
    model: str
    observed: bool
    issued: str | None
    places: str
    spacing_m: float
    box: tuple[float, float, float, float] | None
    """South, west, north, east."""
    members: tuple[str, ...]
    times: tuple[str, ...]
    step_s: float
    gaps_in_time: tuple[tuple[str, str], ...]
    fields: tuple[FieldReport, ...]
    others: tuple[str, ...]
    notes: tuple[str, ...]
    unusable: str | None
    """Reason why it cannot be used for planning; None: it can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeatherReport:
    """Contents of weather files."""

    schema: str = "skyway.weather/1"
    issues: tuple[IssueReport, ...]
    lags: tuple[Lag, ...]


def weather_report(weathers: Sequence[Weather]) -> WeatherReport:
    """Make the report of the files read."""
    return WeatherReport(issues=tuple(_issue(one) for one in weathers), lags=tuple(lags(weathers)))


def _issue(one: Weather) -> IssueReport:
    box = one.places.box
    try:
        one.needs_wind()
        unusable = None
    except InputError as error:
        unusable = error.faults[0].problem
    steps = np.diff(one.times_s)
    regular = len(steps) > 0 and not one.holds and not one.observed
    wide = np.flatnonzero(steps > 1.5 * one.step_s).tolist() if regular else []
    return IssueReport(
        files=one.files,
        form=one.form,
        model=one.model,
        observed=one.observed,
        issued=iso(from_posix(one.issued_s)) if math.isfinite(one.issued_s) else None,
        places=one.places.kind,
        spacing_m=one.places.spacing_m,
        box=None if box is None else (box.south, box.west, box.north, box.east),
        members=one.members,
        times=tuple(iso(from_posix(time)) for time in one.times_s),
        step_s=one.step_s,
        gaps_in_time=tuple((iso(from_posix(one.times_s[at])), iso(from_posix(one.times_s[at + 1]))) for at in wide),
        fields=tuple(_field(one, key) for key in sorted(one.fields) if key.quantity != NORTH or not _pair(one, key)),
        others=one.others,
        notes=one.notes,
        unusable=unusable,
    )


def _pair(one: Weather, key: FieldKey) -> bool:
    return FieldKey(EAST, key.height_m) in one.fields


def _field(one: Weather, key: FieldKey) -> FieldReport:
    values, quantity = one.fields[key], key.quantity
    if quantity == EAST and key.height_m in one.wind_heights_m:
        values, quantity = np.hypot(values, one.fields[FieldKey(NORTH, key.height_m)]), "wind"
    missing = float(np.isnan(values).mean()) if values.size else 1.0
    known = values[np.isfinite(values)] if missing < 1.0 else np.array([math.nan])
    least, mean, greatest = float(known.min()), float(known.mean()), float(known.max())
    return FieldReport(
        quantity=quantity, height_m=key.height_m, unit=UNITS.get(quantity, "m/s"), least=least, mean=mean, greatest=greatest, missing=missing
    )  # fmt: skip


def print_weather(weathers: Sequence[Weather], report: WeatherReport) -> None:
    """Print the files read, for people."""
    for one, told in zip(weathers, report.issues, strict=True):
        issued = "issue time unknown" if told.issued is None else f"issued {_stamp(one.issued_s)}"
        kind = "observed" if told.observed else issued
        count = len(told.members)
        courses = "single forecast" if count == 1 else f"{count} members ({told.members[0]} to {told.members[-1]})"
        say(f"{one.name}: {told.form}, {told.model}, {kind}, {courses}")
        spacing = f", {distance_text(told.spacing_m)} apart" if math.isfinite(told.spacing_m) else ""
        where = "place unknown" if one.places.box is None else str(one.places.box)
        say(f"  where: {told.places}{spacing}; {where}")
        say(f"  when: {_when(one)}")
        for begin, end in told.gaps_in_time:
            say(f"  gap: nothing between {begin} and {end}")
        if told.fields:
            _print_fields(told)
        if told.others:
            more = f", and {len(told.others) - SHOWN_OTHERS} more" if len(told.others) > SHOWN_OTHERS else ""
            say(f"  not used: {', '.join(told.others[:SHOWN_OTHERS])}{more}")
        for note in told.notes:
            say(f"  Note: {note}")
        if told.unusable:
            say(f"  Not for planning: {told.unusable}")
        say("")
    for lag in report.lags:
        apart = duration(lag.later_s - lag.earlier_s)
        say(
            f"{lag.model}: from the issue of {_stamp(lag.earlier_s)} to the next one, {apart} later, the wind at {lag.height_m:g} m changed by "
            f"{speed_text(lag.rms_mps)} (root mean square over {lag.times} common times)"
        )


def _when(one: Weather) -> str:
    times = one.times_s
    if len(times) == 1:
        return _stamp(times[0])
    return f"{_stamp(times[0])} to {_stamp(times[-1])}, {len(times)} times, usually every {duration(one.step_s)}"


def _stamp(posix_s: float) -> str:
    return date_clock(from_posix(float(posix_s)), named=True)


def _print_fields(told: IssueReport) -> None:
    sheet = Sheet(
        [
            Column("  field", justify="left"),
            Column("height", "m"),
            Column("least"),
            Column("mean"),
            Column("greatest"),
            Column("unit", justify="left"),
            Column("missing"),
        ]
    )
    for one in told.fields:
        shown = {
            SPEED: "speed, no direction",
            FROM: "direction",
            GUST: "gust",
            EAST: "east wind",
            NORTH: "north wind",
        }.get(one.quantity, one.quantity)
        digits = [
            f"{value:.1f}" if math.isfinite(value) else "unknown" for value in (one.least, one.mean, one.greatest)
        ]
        sheet.add(f"  {shown}", f"{one.height_m:g}", *digits, one.unit, percent(one.missing))
    sheet.show()


@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationReport:
    """Forecasts compared with observations."""

    schema: str = "skyway.weather-verification/1"
    pairs: int
    leads: tuple[LeadScore, ...]
    learnt: LeadError


def print_verification(report: VerificationReport) -> None:
    """Print the scores by lead for people."""
    several = bool(report.learnt.spread_factor)
    sheet = Sheet(
        [
            Column("lead", "h", words="lead {} h"), Column("pairs"), Column("bias", "m/s"), Column("RMSE", "m/s"), Column("CRPS", "m/s"),
            Column("calibrated", "m/s"), Column("RMSE comp.", "m/s"), Column("spread", "m/s"),
        ]
    )  # fmt: skip
    for one in report.leads:
        better = f"{one.calibrated_crps_mps:.2f}" if math.isfinite(one.calibrated_crps_mps) else "unknown"
        sheet.add(
            f"{one.lead_h:.1f}", f"{one.pairs}", f"{one.speed_bias_mps:+.2f}", f"{one.speed_rmse_mps:.2f}", f"{one.crps_mps:.2f}", better,
            f"{one.component_rmse_mps:.2f}", f"{one.spread_mps:.2f}" if several else "none",
        )  # fmt: skip
    sheet.show()
    say("")
    say(
        "bias, RMSE, CRPS: of the speed; calibrated: CRPS with what was learnt from the other half of the issues, or places"
    )
    say("RMSE comp. and spread: of a component of the wind; a good ensemble has as much spread as error")
    say(f"{report.pairs:,} pairs; errors fade within {duration(report.learnt.tau_s)}")
