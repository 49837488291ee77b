"""Picture of the state of charge over time, with its spread over simulated deliveries."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

from skyway.models.base.units import from_posix
from skyway.plots.pictures import CALM, INK, MUTED, MUTED_INK, ROUTE, plain_axes

if TYPE_CHECKING:
    from datetime import datetime
    from zoneinfo import ZoneInfo

    from skyway.models.composition.composition import Composition
    from skyway.plots.charge_band import ChargeBand

_Piece = tuple[str, "datetime", float, "datetime", float]


def draw_charge(axes: Any, composition: Composition, zone: ZoneInfo, band: ChargeBand | None) -> None:
    """State of charge over the time of day, by what the drone does; behind it how it differs over simulated deliveries."""
    whole = composition.there_and_back
    pieces = _pieces(whole)
    last = whole.arrive
    if band is not None:
        times = [from_posix(at_s) for at_s in band.time_s.tolist()]
        label = "8 of 10 simulated deliveries under way"
        axes.fill_between(times, 100 * band.low, 100 * band.high, color=MUTED, alpha=0.35, linewidth=0, label=label)
        last = max(last, from_posix(float(band.time_s[-1])))
    colours = {"fly": INK, "wait or hold": MUTED_INK, "charge": CALM}
    seen: set[str] = set()
    for what, start, soc_start, end, soc_end in pieces:
        if end <= start:
            continue
        name = what if what not in seen else None
        seen.add(what)
        charges = [100 * soc_start, 100 * soc_end]
        axes.plot([start, end], charges, "-", color=colours[what], linewidth=2, label=name)
    reserve = 100.0 * composition.reserve_soc
    axes.axhline(reserve, color=ROUTE, linewidth=1.0, linestyle="--", label=f"reserve, {reserve:.0f} %")
    axes.set_ylim(0, 103)
    axes.set_xlim(composition.depart, last + 0.01 * (last - composition.depart))
    short = last - composition.depart < timedelta(minutes=5)
    locator, formatter = _clock_ticks(zone, "%H:%M:%S" if short else "%H:%M")
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(formatter)
    local = composition.depart.astimezone(zone)
    axes.set_xlabel(f"time of day, {local:%Z} ({local:%Y-%m-%d})", fontsize=8)
    axes.set_ylabel("state of charge, %", fontsize=8)
    axes.set_title(
        "typical schedule" + (", and the spread of others" if band is not None else ""), fontsize=8, loc="left"
    )
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=7, ncols=3, loc="upper right", frameon=True, edgecolor="none", framealpha=0.8)
    plain_axes(axes)


def _pieces(composition: Composition) -> list[_Piece]:
    """What the drone does, from when with which charge, until when with which."""
    pieces: list[_Piece] = []
    at: datetime | None = None
    stops = list(composition.stops)
    for service in composition.services:
        stop = (
            stops.pop(0)
            if stops and stops[0].station == service.origin and (at is None or stops[0].arrive >= at)
            else None
        )
        at = service.arrive
        if stop is not None:
            pad = stop.arrive + timedelta(seconds=stop.wait_s)
            off = pad + timedelta(seconds=stop.recharge_s)
            pieces.append(("wait or hold", stop.arrive, stop.soc_from, pad, stop.soc_from))
            pieces.append(("charge", pad, stop.soc_from, off, stop.soc_to))
            pieces.append(("wait or hold", off, stop.soc_to, service.depart, stop.soc_to))
        pieces.append(("fly", service.depart, service.soc_depart, service.arrive, service.soc_arrive))
    return pieces


def _clock_ticks(zone: ZoneInfo, pattern: str) -> tuple[Any, Any]:
    """Ticks at round times of day in a zone."""
    from matplotlib import dates

    untyped: Any = dates
    return untyped.AutoDateLocator(tz=zone, minticks=4, maxticks=9), untyped.DateFormatter(pattern, tz=zone)
