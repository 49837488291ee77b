"""Hours without flights because of the weather, besides the wind: by the limits of the drone and of the region.

One member in ten of an ensemble may be worse (`models.wind.ensemble.HourlyWeather`). Limits on quantities that a forecast lacks close nothing, and are reported.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.formatting import weekday_clock
from skyway.models.base.units import from_posix
from skyway.models.drones.weather_limits import NO_LIMITS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from zoneinfo import ZoneInfo

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.drones.weather_limits import WeatherLimits
    from skyway.models.flight.rules import FlightRules
    from skyway.models.wind.ensemble import HourlyWeather, WindEnsemble

ZERO_C_K = 273.15
SUNSET_DEG = -0.833
"""Height of the sun's centre at sunrise and sunset: its radius and the refraction at the horizon."""
MOST_TOLD = 4
"""Largest number of closures that are listed individually."""
ICING_SHARE = 0.1
"""Of the members."""


class WeatherClosure(NamedTuple):
    """A time without flights."""

    begin_s: float
    end_s: float
    """POSIX seconds."""
    why: str
    """The reason, for people."""


def weather_limits(drone: Drone, rules: FlightRules) -> WeatherLimits:
    """Limits that hold for a drone in a region."""
    return drone.limits.stricter(rules.limits)


def weather_closures(ensemble: WindEnsemble, drone: Drone, rules: FlightRules) -> tuple[WeatherClosure, ...]:
    """Times in which the weather closes flights of a drone, ascending for each reason."""
    limits = weather_limits(drone, rules)
    if limits == NO_LIMITS:
        return ()
    found: list[WeatherClosure] = []
    if ensemble.weather is not None:
        found += _of_weather(ensemble.weather, limits)
    if limits.daylight_only:
        found += _nights(ensemble)
    return tuple(sorted(found))


def closed_slots(ensemble: WindEnsemble, drone: Drone, rules: FlightRules) -> NDArray[np.bool_]:
    """Slots of an ensemble in any part of which the weather closes flights, shape (slots,)."""
    begin = ensemble.start_s + ensemble.slot_s * np.arange(ensemble.slots)
    shut = np.zeros(ensemble.slots, dtype=bool)
    for one in weather_closures(ensemble, drone, rules):
        shut |= (begin < one.end_s) & (begin + ensemble.slot_s > one.begin_s)
    return shut


def unchecked_limits(ensemble: WindEnsemble, drone: Drone, rules: FlightRules) -> tuple[str, ...]:
    """Limits that the forecast cannot check."""
    limits = weather_limits(drone, rules)
    known = set() if ensemble.weather is None else set(ensemble.weather.values)
    asked = {
        "gusts": (limits.gust_mps < math.inf, "gust"),
        "rain": (limits.rain_mm_h < math.inf, "rain"),
        "visibility": (limits.visibility_m > 0.0, "visibility"),
        "temperature": (limits.temperature_min_c > -math.inf or limits.temperature_max_c < math.inf, "coldest"),
        "icing": (limits.no_icing, "icing"),
    }
    return tuple(name for name, (set_, key) in asked.items() if set_ and key not in known)


def closures_told(
    ensemble: WindEnsemble, drone: Drone, rules: FlightRules, zone: ZoneInfo, begin_s: float, until_s: float
) -> list[str]:
    """Describe when the weather closes flights between two instants, and which limits could not be checked."""
    near = [one for one in weather_closures(ensemble, drone, rules) if one.end_s > begin_s and one.begin_s < until_s]
    notes = [
        f"closed from {weekday_clock(from_posix(one.begin_s), zone)} to {weekday_clock(from_posix(one.end_s), zone)}, because of {one.why}"
        for one in near[:MOST_TOLD]
    ]
    if len(near) > MOST_TOLD:
        notes.append(f"closed {len(near) - MOST_TOLD} times more")
    unknown = unchecked_limits(ensemble, drone, rules)
    if unknown:
        notes.append(f"limits that could not be checked, since the forecast lacks the data: {', '.join(unknown)}")
    return notes


def _of_weather(weather: HourlyWeather, limits: WeatherLimits) -> Iterator[WeatherClosure]:
    def of(name: str) -> NDArray[np.float64]:
        return weather.values.get(name, np.empty(0))

    rules = (
        (of("gust"), of("gust") > limits.gust_mps, max, "gusts of up to {:.0f} m/s", f"{limits.gust_mps:g} m/s at most"),
        (of("rain"), of("rain") > limits.rain_mm_h, max, "rain of up to {:.1f} mm/h", f"{limits.rain_mm_h:g} mm/h at most"),
        (of("visibility"), of("visibility") < limits.visibility_m, min, "a visibility down to {:.0f} m", f"{limits.visibility_m:g} m at least"),
        (of("coldest") - ZERO_C_K, of("coldest") - ZERO_C_K < limits.temperature_min_c, min, "down to {:.0f} °C", f"{limits.temperature_min_c:g} °C at least"),
        (of("warmest") - ZERO_C_K, of("warmest") - ZERO_C_K > limits.temperature_max_c, max, "up to {:.0f} °C", f"{limits.temperature_max_c:g} °C at most"),
        (of("icing"), (of("icing") >= ICING_SHARE) & limits.no_icing, max, "icing", "none allowed"),
    )  # fmt: skip
    for values, over, worst, told, allowed in rules:
        for first, last in _runs(over):
            extreme = worst(values[first:last].tolist())
            begin_s = weather.start_s + first * weather.slot_s
            yield WeatherClosure(
                begin_s, weather.start_s + last * weather.slot_s, f"{told.format(extreme)} ({allowed})"
            )


def _runs(over: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], over, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _nights(ensemble: WindEnsemble) -> Iterator[WeatherClosure]:
    """Times without daylight, to the minute, in the middle of the region."""
    from astral import Observer
    from astral.sun import elevation

    here = Observer(float(np.mean(ensemble.site_lat)), float(np.mean(ensemble.site_lon)))
    begin_s, end_s = ensemble.start_s, ensemble.start_s + ensemble.slots * ensemble.slot_s
    times = np.arange(begin_s, end_s + 600.0, 600.0)
    dark = np.array([elevation(here, from_posix(float(time)), with_refraction=False) < SUNSET_DEG for time in times])

    def edge(low_s: float, high_s: float) -> float:
        """The minute between two times at which the daylight changes."""
        first = elevation(here, from_posix(low_s), with_refraction=False) < SUNSET_DEG
        while high_s - low_s > 60.0:
            middle = 0.5 * (low_s + high_s)
            if (elevation(here, from_posix(middle), with_refraction=False) < SUNSET_DEG) == first:
                low_s = middle
            else:
                high_s = middle
        return high_s

    for first, last in _runs(dark):
        begin = begin_s if first == 0 else edge(float(times[first - 1]), float(times[first]))
        end = end_s if last == len(times) else edge(float(times[last - 1]), float(times[last]))
        yield WeatherClosure(begin, end, "night (daylight is needed)")
