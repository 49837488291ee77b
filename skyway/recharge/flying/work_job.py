"""A cut mission as a job of the supervisor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.job import DeliveryJob
from skyway.link.supervisor.work.task import Known
from skyway.missions.checks.weather import ForecastWind
from skyway.models.base.errors import InputError
from skyway.models.base.units import from_posix, parse_instant
from skyway.models.composition.composition import State
from skyway.planner.problem.request import NO_RETURN, Request
from skyway.recharge.flying.flown import SetPlanner
from skyway.recharge.flying.places import places_of, region_with
from skyway.recharge.output import identity_of
from skyway.typed_values import wind_forecast

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.models.drones.drag import DragModel
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.made_of import OpenedSet


MULTIROTORS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
"""MAV_TYPE of vehicles that hover on rotors."""


def job_of(
    found: Recharged,
    document: MissionDocument,
    family: Family,
    region: Scenario | None,
    forecast: WindEnsemble,
    time_s: float,
    *,
    zero_s: float | None = None,
    **how: Any,
) -> DeliveryJob:
    """Return the job of flying a cut mission from `time_s`, POSIX seconds, on; `how` as in `DeliveryJob`.

    Windows of pads count from `zero_s`; without it from the departure for which it was cut, otherwise from now.
    """
    places = places_of(found)
    joined = region_with(found, places, region)
    conditions = found.problem.options.conditions
    weather = conditions.weather
    if zero_s is None:
        zero_s = weather.depart_s if isinstance(weather, ForecastWind) else time_s
    planner = SetPlanner(found, document, places, joined.rules.wind_profile_exponent, zero_s, identity_of(found))
    known = Known(time_s=time_s, soc=conditions.soc_start, forecast=forecast, belief=conditions.drone.energy_belief)
    composition = planner.as_cut(family, None, known).composition
    request = Request(
        state=State(from_posix(time_s), composition.origin, None, conditions.soc_start),
        destination=composition.destination,
        payload_kg=conditions.payload_kg,
        drone=conditions.drone.id,
        airspeed_mps=composition.airspeed_mps,
        reserve_soc=max(conditions.reserve_soc, 0.01),
        epsilon=found.problem.options.epsilon,
        escape=False,
        return_to=NO_RETURN,
        seed=found.problem.options.seed,
    )
    return DeliveryJob(
        composition=composition, scenario=joined, request=request, forecast=forecast, work=planner, **how
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkAsked:
    """Typed options of flying a set."""

    wind: str | None = None
    forecast: list[Path] | None = None
    observed: Callable[[Scenario, datetime], Callable[[float], Sequence[WindObservation]]] | None = None
    drag: DragModel | None = None
    how: Mapping[str, Any] = field(default_factory=dict)


def work_of_set(opened_set: OpenedSet, vehicle: Vehicle, now: datetime, asked: WorkAsked) -> DeliveryJob:
    """Return the job of flying a set with the connected vehicle, from now on.

    Raises an `InputError` if the set was not cut for its autopilot, or for its kind of vehicle.
    """
    family = vehicle.family
    found = opened_set.found
    if family.name not in found.flights:
        known = ", ".join(found.flights)
        problem = f"the set has missions for {known}; the connected drone is {family.name}"
        raise InputError(
            problem,
            str(opened_set.folder),
            remedy=f"connect another drone, or cut the mission with --autopilot {family.name}",
        )
    kind = vehicle.peer.kind
    if not multirotor(kind) and multirotor(found.problem.work.mission.vehicle_type):
        raise InputError(
            f"the set is for a multirotor; the connected vehicle reports MAV_TYPE {kind}",
            str(opened_set.folder),
            remedy="connect the drone that it was cut for",
        )
    places = places_of(found)
    region = region_with(found, places, opened_set.region)
    cut_with = opened_set.made_of.asked
    wind = asked.wind if asked.wind is not None or asked.forecast else cut_with.wind
    depart = cut_with.depart
    zero_s = None if depart is None else parse_instant(depart, field="--depart").timestamp()
    has_own = opened_set.region is not None and wind is None
    if asked.forecast and opened_set.region is None:
        raise InputError(
            "a forecast needs a region",
            field="--forecast",
            remedy="cut the mission with --pads SCENARIO, or give --wind",
        )
    expected = (
        wind_forecast(region, now, None, asked.forecast, None, None)
        if has_own
        else wind_forecast(region, now, wind or "0@0", None, None, None)
    )
    more = {} if asked.observed is None else {"observed": asked.observed(region, now)}
    return job_of(
        found,
        opened_set.document,
        family,
        opened_set.region,
        expected,
        now.timestamp(),
        zero_s=zero_s,
        drag=asked.drag,
        **asked.how,
        **more,
    )


def multirotor(kind: int | None) -> bool:
    """Whether a MAV_TYPE is that of a multirotor, or unknown."""
    return kind is None or kind in MULTIROTORS
