"""A forecast conditioned on winds observed before the departure.

It uses `models.wind.estimation.forecast_update.update_forecast`, the same method as for drones, adapted to the reports of
airports (decision 83): only the newest report of each station, its error `STATION_ERROR_MPS`, weights worth `LEAST_MEMBERS` members, and of
these the most probable. The age of a report is accounted for: members are compared with it in the hour of the observation, and the
residual has faded since.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.formatting import distance_text, duration
from skyway.models.base.geodesy import inverse
from skyway.models.base.units import from_posix, iso
from skyway.models.wind.estimation.forecast_update import update_forecast

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import datetime

    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import ResidualModel, WindObservation
    from skyway.models.wind.history import WindSite
    from skyway.models.wind.observed.reading import ObservedWind

OLDEST_S = 6 * 3600.0
"""Before the departure. By then half of the information of a fresh report is gone."""
FUTURE_S = 60.0
"""A report this long after the departure counts as simultaneous: departures are given to the minute."""
FAR_M = 80_000.0
"""From the nearest wind site: two correlation lengths of residuals."""
LEAST_MEMBERS = 30.0
SAME_S, SAME_MPS = 60.0, 0.3
"""Two winds of a station at one time that differ by no more are one report, rounded in two ways."""
DOUBT_SIGMAS = 4.0
END_OF_HOUR_S = 600.0
"""An observation in the last part of an hour, of this length, is of this hour of a record; an earlier one is of the hour before."""


@dataclass(frozen=True, slots=True)
class Counted:
    """The observations that are used for a departure."""

    winds: tuple[ObservedWind, ...]
    notes: tuple[str, ...]
    """The omitted ones, with the reason."""


def counted(observed: Sequence[ObservedWind], sites: Sequence[WindSite], depart_s: float) -> Counted:
    """Choose the observations to use: none after the departure, neither old nor far, of each station the newest.

    An `InputError` names two winds of a station at one time that contradict each other.
    """
    notes: list[str] = []
    late = [one for one in observed if one.observation.time_s > depart_s + FUTURE_S]
    kept = [one for one in observed if one not in late]
    if late:
        notes.append(f"{_many(late)} after the departure and ignored")
    old = [one for one in kept if one.observation.time_s < depart_s - OLDEST_S]
    newest = {one.place for one in kept if one not in old}
    silent = [one for one in old if one.place not in newest and not one.drone]
    if silent:
        last = max(silent, key=lambda one: one.observation.time_s)
        age = duration(depart_s - last.observation.time_s)
        names = ", ".join(dict.fromkeys(one.place for one in silent))
        notes.append(
            f"the wind observed at {names} is ignored: {age} before the departure, the limit is {duration(OLDEST_S)}"
        )
    kept = [one for one in kept if one not in old]
    far = [(one, away) for one in kept if (away := _away_m(one, sites)) > FAR_M]
    for one, away in far:
        swapped = "; lat and lon look swapped" if _away_m(one, sites, swapped=True) < FAR_M else ""
        notes.append(
            f"the wind observed at {one.place} is ignored: {distance_text(away)} from every wind site{swapped}"
        )
    kept = [one for one in kept if all(one is not other for other, _ in far)]
    order = {site.id: number for number, site in enumerate(sites)}
    stations = sorted(_newest([one for one in kept if not one.drone]), key=lambda one: order.get(one.place, len(order)))
    return Counted((*stations, *(one for one in kept if one.drone)), tuple(notes))


def _many(winds: Sequence[ObservedWind]) -> str:
    if len(winds) == 1:
        one = winds[0]
        return f"the wind observed at {one.place} at {iso(from_posix(one.observation.time_s))} is"
    return f"{len(winds)} observed winds are"


def _away_m(one: ObservedWind, sites: Sequence[WindSite], *, swapped: bool = False) -> float:
    """Distance of an observation from the nearest site; infinite if its `swapped` latitude is none."""
    lat, lon = np.array([site.lat for site in sites]), np.array([site.lon for site in sites])
    here = one.observation.lat_deg, one.observation.lon_deg
    if swapped and abs(here[1]) > 90.0:
        return np.inf
    return float(inverse(*(here[::-1] if swapped else here), lat, lon)[0].min())


def _newest(winds: Sequence[ObservedWind]) -> list[ObservedWind]:
    """The newest wind of each station, or its correction if there is one."""
    chosen: dict[str, ObservedWind] = {}
    faults = []
    for one in sorted(winds, key=lambda one: (one.observation.time_s, one.corrected)):
        other = chosen.get(one.place)
        if other is not None and one.corrected == other.corrected and _contradict(one, other):
            stamp = iso(from_posix(one.observation.time_s))
            problem = f"two winds at {stamp} contradict each other: {other.told} ({other.stands}) and {one.told} ({one.stands})"
            faults.append(Fault(problem, field=one.place, remedy="keep the right one"))
        chosen[one.place] = one
    refuse(faults)
    return list(chosen.values())


def _contradict(one: ObservedWind, other: ObservedWind) -> bool:
    a, b = one.observation, other.observation
    apart = np.hypot(a.north_mps - b.north_mps, a.east_mps - b.east_mps)
    return abs(a.time_s - b.time_s) < SAME_S and (apart > SAME_MPS or abs(one.speed_mps - other.speed_mps) > SAME_MPS)


def conditioned(
    forecast: Callable[[datetime, int], WindEnsemble],
    winds: Sequence[ObservedWind],
    depart: datetime,
    hours: int,
    *,
    exponent: float,
    residual: ResidualModel,
    members: int,
    analogue: bool = True,
) -> tuple[WindEnsemble, tuple[str, ...]]:
    """Condition a forecast on the chosen observations.

    Parameters
    ----------
    forecast : callable
        Return the forecast from an instant on, for a number of hours.
    winds : sequence of ObservedWind
        See `counted`.
    depart, hours
        The departure, and the number of hours of wind wanted from then on.
    exponent : float
        Of the wind's profile, for observations at other heights than the forecast's.
    residual : ResidualModel
        Model of the difference between wind and forecast, and its duration.
    members : int
        Number of members kept, the most probable ones.
    analogue : bool
        Whether the members are days of a record, with one wind an hour; false for a forecast of these hours.

    Returns
    -------
    WindEnsemble
        Its first slot is that of the departure. Without winds the unchanged forecast.
    tuple of str
        Observations that are inconsistent with the others, for people; they are used nevertheless.
    """
    if not winds:
        return forecast(depart, hours), ()
    depart_s = depart.timestamp()
    seen = [of_an_hour(one.observation) if analogue else one.observation for one in winds]
    begin_s = min([depart_s, *(one.time_s for one in seen)])
    before = forecast(from_posix(begin_s), hours + int(np.ceil((depart_s - begin_s) / 3600.0)))
    level = [one.at_height(before.height_m, exponent) for one in seen]
    after = update_forecast(before, level, residual, slot_s=before.slot_s, least_members=LEAST_MEMBERS)
    notes = []
    if 1 < len(winds) <= 50:
        for number, one in enumerate(winds):
            others = [*level[:number], *level[number + 1 :]]
            told = update_forecast(before, others, residual, slot_s=before.slot_s, least_members=LEAST_MEMBERS)
            if _sigmas(told, level[number]) > DOUBT_SIGMAS:
                notes.append(f"the wind observed at {one.place}, {one.told}, contradicts the others: check it")
    first = after.slot_at(depart_s)
    last = min(first + int(np.ceil(hours * 3600.0 / after.slot_s)), after.slots)
    cut = replace(
        after,
        start_s=after.start_s + first * after.slot_s,
        north=after.north[:, first:last],
        east=after.east[:, first:last],
    )
    return cut.most_probable(members), tuple(notes)


def of_an_hour(seen: WindObservation) -> WindObservation:
    """Return an observation at a time within the hour of a record that it is compared with, in hours of the clock (UTC)."""
    into_s = seen.time_s % 3600.0
    return seen if into_s >= 3600.0 - END_OF_HOUR_S else replace(seen, time_s=seen.time_s - into_s - 1.0)


def _sigmas(ensemble: WindEnsemble, seen: WindObservation) -> float:
    """Distance of an observation from an ensemble at its place and time, in standard deviations."""
    winds = ensemble.wind_at(seen.lat_deg, seen.lon_deg, ensemble.slot_at(seen.time_s))
    worst = 0.0
    for values, value in zip(winds, (seen.north_mps, seen.east_mps), strict=True):
        mean = float(ensemble.probability @ values)
        variance = float(ensemble.probability @ (values - mean) ** 2) + seen.variance
        worst = max(worst, abs(value - mean) / float(np.sqrt(variance)))
    return worst


def nothing_counts(given: Sequence[ObservedWind], notes: Sequence[str], depart: datetime) -> InputError:
    """Return the error for a case in which none of the given observations is usable."""
    said = "; ".join(notes) or "there are none"
    remedy = f"give winds observed within {duration(OLDEST_S)} before the departure ({iso(depart)}), or omit the option"
    problem = f"none of {len(given)} observed winds is usable: {said}" if given else f"no wind was observed: {said}"
    return InputError(problem, field="--observed", remedy=remedy)
