"""The weather besides the wind over a region, hour by hour, for weather limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.placing import Placing
from skyway.models.weather.profile import wind_at_height
from skyway.models.weather.weather import EAST, GUST, NORTH, Box, FieldKey
from skyway.models.wind.ensemble import HourlyWeather
from skyway.models.wind.gusts import LEAST_GUST_SD, MOST_GUST_SD, PEAK_FACTOR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.weather.region import Region
    from skyway.models.weather.weather import Weather

WORST = 0.9
"""Quantile of the members: one in ten may be worse."""
KINDS = {
    "gust": (GUST, True), "rain": ("rain", True), "visibility": ("visibility", False), "warmest": ("temperature", True),
    "coldest": ("temperature", False),
}  # fmt: skip
"""Report name, quantity, and whether more is worse."""
ICING_K = 273.15 - 15.0, 273.15 + 2.0
ICING_RAIN_MM_H, ICING_HUMIDITY = 0.1, 95.0
GUST_M = 10.0
"""Height of gusts if a forecast states none."""
GAP_S = 6.5 * 3600.0


def hourly_weather(
    used: Sequence[Weather],
    region: Region,
    lat: NDArray[np.float64],
    lon: NDArray[np.float64],
    start_s: float,
    slot_s: float,
    slots: int,
) -> HourlyWeather | None:
    """Return the forecast weather at places, the worst of them; None if the forecasts contain none."""
    edges = start_s + slot_s * np.arange(slots + 1, dtype=np.float64)
    found: dict[str, NDArray[np.float64]] = {}
    for one in used:
        at: dict[str, NDArray[np.float64]] = {}
        try:
            placing = Placing(one, lat, lon, Box.around(region.lat, region.lon))
        except InputError:
            continue
        for key, values in one.fields.items():
            if key.quantity in (GUST, "rain", "visibility", "temperature", "humidity"):
                at[key.quantity] = _at_edges(one, placing(values), edges)
        if GUST in at:
            gusty = _gust_sd(one, placing, at[GUST], region, edges)
            if gusty is not None:
                _worse(found, "gust_sd", gusty, more=True)
        for name, (quantity, more) in KINDS.items():
            if quantity in at:
                _worse(
                    found,
                    name,
                    _slotwise(
                        np.quantile(_worst_place(at[quantity], more=more), WORST if more else 1.0 - WORST, axis=0),
                        more=more,
                    ),
                    more=more,
                )
        icing = _icing(at)
        if icing is not None:
            _worse(found, "icing", _slotwise(icing.mean(axis=0), more=True), more=True)
    return HourlyWeather(start_s, slot_s, found) if found else None


def _worst_place(values: NDArray[np.float64], *, more: bool) -> NDArray[np.float64]:
    """Worst of the places, shape (members, times)."""
    return np.asarray(values.max(axis=2) if more else values.min(axis=2))


def _slotwise(values: NDArray[np.float64], *, more: bool) -> NDArray[np.float64]:
    """Worst of the begin and the end of each slot, shape (slots,)."""
    return np.maximum(values[:-1], values[1:]) if more else np.minimum(values[:-1], values[1:])


def _worse(found: dict[str, NDArray[np.float64]], name: str, values: NDArray[np.float64], *, more: bool) -> None:
    if np.isnan(values).all():
        return
    other = found.get(name)
    found[name] = values if other is None else np.fmax(other, values) if more else np.fmin(other, values)


def _at_edges(one: Weather, values: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at the edges of slots, shape (members, edges, places); NaN if the forecast lacks them."""
    times = one.times_s
    if len(times) == 1:
        near = np.abs(edges - times[0]) <= 3600.0
        return np.where(near[None, :, None], values, np.nan)
    after = np.clip(np.searchsorted(times, edges), 1, len(times) - 1)
    step = times[after] - times[after - 1]
    share = (edges - times[after - 1]) / step
    known = (share >= 0.0) & (share <= 1.0) & (step <= GAP_S)
    if one.holds:
        at = np.clip(np.searchsorted(times, edges, side="right") - 1, 0, len(times) - 1)
        return np.where(
            (edges >= times[0])[None, :, None] & (edges <= times[-1] + step[-1])[None, :, None], values[:, at], np.nan
        )
    between = (1.0 - share)[None, :, None] * values[:, after - 1] + share[None, :, None] * values[:, after]
    return np.where(known[None, :, None], between, np.nan)


def _gust_sd(
    one: Weather, placing: Placing, gust: NDArray[np.float64], region: Region, edges: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Standard deviation of gusts as a share of the wind at the height of flight, shape (slots,), the mean of places and members; None without a wind.

    Near the ground it hardly changes with height (Stull 1988, section 9.5), so the gust at its stated height is used at that of the flight.
    """
    heights = one.wind_heights_m
    if not heights:
        return None
    parts = [
        np.stack([_at_edges(one, placing(one.fields[FieldKey(part, height)]), edges) for height in heights])
        for part in (NORTH, EAST)
    ]
    whole = np.flatnonzero(np.isfinite(parts[0] + parts[1]).any(axis=(1, 2, 3)))
    if not len(whole):
        return None
    told_m = min((key.height_m for key in one.fields if key.quantity == GUST), default=GUST_M)
    below, flown = (
        np.hypot(
            *wind_at_height([heights[k] for k in whole], parts[0][whole], parts[1][whole], height, region.exponent)
        )
        for height in (told_m if told_m > 0.0 else GUST_M, region.height_m)
    )
    over = np.where(np.isfinite(below + flown), np.maximum(gust - below, 0.0), np.nan)
    known = np.isfinite(over)
    sums = [np.where(known, values, 0.0).sum(axis=(0, 2)) for values in (over, flown)]
    around = [values[:-1] + values[1:] for values in sums]
    share = np.where(around[1] > 0.0, around[0] / np.where(around[1] > 0.0, PEAK_FACTOR * around[1], 1.0), np.nan)
    return np.clip(share, LEAST_GUST_SD, MOST_GUST_SD)


def _icing(at: dict[str, NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Whether ice may form, by member and time, 0 or 1; None if unknown."""
    if "temperature" not in at or not ("rain" in at or "humidity" in at):
        return None
    cold = (at["temperature"] >= ICING_K[0]) & (at["temperature"] <= ICING_K[1])
    wet = np.zeros_like(cold)
    if "rain" in at:
        wet |= at["rain"] >= ICING_RAIN_MM_H
    if "humidity" in at:
        wet |= at["humidity"] >= ICING_HUMIDITY
    return np.asarray((cold & wet).any(axis=2).astype(np.float64))
