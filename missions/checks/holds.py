"""Check of energies: reserve, wind limits, and holds against the charging curve."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.missions.checks.weather import SteadyWind
from skyway.missions.items.finding import Finding
from skyway.models.base.formatting import duration, modelled, percent, probability, speed_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.checks.energy import FlightConditions, LegEnergy
    from skyway.missions.checks.route import Route, RouteLeg

BATTERY_EMPTY = "battery-empty"
EPSILON = 0.001
"""Probability of landing below the reserve that is accepted."""


def check_energy(route: Route, legs: Sequence[LegEnergy], conditions: FlightConditions) -> Iterator[Finding]:
    """Judge the energies of a mission: payload, wind, reserve, holds."""
    drone = conditions.drone
    if conditions.payload_kg > drone.max_payload_kg:
        message = (
            f"the package has {conditions.payload_kg:g} kg, but the {drone.name} lifts {drone.max_payload_kg:g} kg"
        )
        yield Finding("error", None, "payload", message, "use another vehicle")
    for leg in legs:
        yield from _wind(leg, conditions)
        yield from _reserve(leg, conditions)
    for (flown, route_leg), (following, _) in pairwise(zip(legs, route.legs, strict=True)):
        yield from _hold(flown, route_leg, following, conditions)


def _wind(leg: LegEnergy, conditions: FlightConditions) -> Iterator[Finding]:
    drone = conditions.drone
    if leg.p_flyable == 0.0:
        message = (
            f"this leg cannot be flown: the wind is above {drone.wind_limit_mps:g} m/s, or too strong across or against the"
            " course"
        )
        yield Finding("error", leg.worst_item, "wind-too-strong", message, "wait for less wind")
    elif leg.p_flyable < 1.0 - EPSILON:
        message = f"the wind forbids this flight with probability {probability(1.0 - leg.p_flyable)}"
        yield Finding("warning", leg.worst_item, "wind-may-forbid", message, "be ready to hold on the ground")
    if leg.p_flyable > 0.0 and leg.least_airspeed_margin_mps < 0.0:
        message = (
            f"{_which_wind(conditions)}the commanded ground speed needs {speed_text(-leg.least_airspeed_margin_mps)} more"
            f" airspeed than the {drone.max_airspeed_mps:g} m/s of the {drone.name}: it will fly slower"
        )
        yield Finding("warning", leg.worst_item, "speed-not-held", message, "command a lower ground speed")


def _which_wind(conditions: FlightConditions) -> str:
    """Name the wind, if any."""
    if not isinstance(conditions.weather, SteadyWind):
        return "in the strongest of these winds "
    return f"in a wind of {conditions.weather.speed_mps:g} m/s " if conditions.weather.speed_mps else ""


def _reserve(leg: LegEnergy, conditions: FlightConditions) -> Iterator[Finding]:
    if leg.soc_end is None or leg.p_reserve is None:
        return
    reserve = conditions.reserve_soc
    if leg.soc_end <= 0.0:
        message = (
            f"the battery is empty before item {leg.item_to}: the flight takes {percent(leg.soc_start - leg.soc_end)}"
            f" of a full battery, and begins with {percent(leg.soc_start)}"
        )
        yield Finding("error", leg.item_to, BATTERY_EMPTY, message, "land and recharge on the way")
    elif leg.soc_end < reserve:
        message = f"ends at {percent(leg.soc_end)} charge, below the reserve of {percent(reserve)}"
        yield Finding("error", leg.item_to, "below-reserve", message, "recharge before, or fly a shorter route")
    elif leg.p_reserve < 1.0 - EPSILON:
        message = f"keeps the reserve of {percent(reserve)} only with probability {modelled(leg.p_reserve)}"
        yield Finding("warning", leg.item_to, "reserve-unsure", message, "recharge more before")


def _hold(flown: LegEnergy, leg: RouteLeg, following: LegEnergy, conditions: FlightConditions) -> Iterator[Finding]:
    hold_s = leg.ground_hold_s
    if leg.released and flown.pad is None and hold_s != 0.0:
        if not conditions.stations:
            message = (
                "continues from where the package is released: assuming a battery charged there, but no pad is known"
            )
            yield Finding(
                "warning", flown.item_to, "charge-at-target-assumed", message, "give --scenario, which knows the pads"
            )
        return
    if hold_s is None:
        message = "the mission does not say how long it charges here: a full battery is assumed"
        yield Finding("info", flown.item_to, "hold-open", message, "arm only when it is charged")
        return
    if hold_s == 0.0 or flown.soc_end is None or following.energy_j is None:
        return
    if conditions.stations and flown.pad is None:
        message = f"a hold of {duration(hold_s)} at a place without a pad: the battery is not charged"
        yield Finding("warning", flown.item_to, "hold-without-pad", message, "hold at a station")
        return
    power_w = next((s.recharge_power_w for s in conditions.stations if s.name == flown.pad), None)
    curve = conditions.drone.charging_curve(power_w)
    arrived = max(flown.soc_end, 0.0)
    full_s = float(curve.duration_s(arrived, 1.0))
    wanted = conditions.reserve_soc + following.energy_j / conditions.drone.battery_j
    if following.soc_end is not None and following.soc_end < conditions.reserve_soc and wanted <= 1.0:
        needed_s = math.ceil(float(curve.duration_s(arrived, wanted)))
        message = (
            f"a hold of {duration(hold_s)} charges to {percent(following.soc_start)}, and the next flight needs"
            f" {percent(wanted)}"
        )
        yield Finding("error", flown.item_to, "hold-too-short", message, f"hold {needed_s} s")
    elif hold_s > full_s + 60.0:
        message = f"a hold of {duration(hold_s)}, and the battery is full after {duration(full_s)}"
        yield Finding("info", flown.item_to, "hold-longer-than-charge", message)
