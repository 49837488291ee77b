"""Diverting: leave the mission and land elsewhere, by reposition (PX4) or GUIDED (ArduPilot).

A `Diversion` is started, and then stepped with the samples that the supervisor gets anyway.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError, VehicleTimeoutError
from skyway.models.base.formatting import distance_text, duration
from skyway.models.base.geodesy import distance_m
from skyway.models.base.views import how_often

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.drones.telemetry import TelemetrySample

ARRIVED_M, ARRIVED_HEIGHT_M, ARRIVED_MPS = 4.0, 3.0, 1.5
"""So near and so slow, it is there and may land."""
STALLED_S, STALLED_M = 20.0, 5.0
"""A vehicle that has not come closer by this distance in this time is sent there again."""
_ORDERS = 4
_SLOWEST_MPS, _LANDING_S = 3.0, 240.0
_SETTLE_S = 15.0
"""Heartbeats come once a second, and some are lost: so long after an order the mode may still be the old one."""
_OWN_MODES = {"flying": ("guided", "hold"), "landing": ("land",)}


@dataclass(frozen=True, slots=True)
class Refuge:
    """Where to land instead."""

    lat_deg: float
    lon_deg: float
    """`lat_deg`, `lon_deg`: WGS-84."""
    height_m: float
    """To fly there at, above home."""

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0 and math.isfinite(self.height_m)):
            raise InputError(Fault("is not a place on Earth", value=(self.lat_deg, self.lon_deg, self.height_m)))


class DivertState(StrEnum):
    """Progress of a diversion."""

    ORDERED = "ordered"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    TAKEN = "taken over"
    OVERDUE = "overdue"

    @property
    def over(self) -> bool:
        """Whether nothing more is commanded."""
        return self in (DivertState.LANDED, DivertState.TAKEN, DivertState.OVERDUE)


class Diversion:
    """One vehicle on its way to a refuge."""

    def __init__(self, vehicle: Vehicle, refuge: Refuge) -> None:
        self.vehicle, self.refuge = vehicle, refuge
        self.state = DivertState.ORDERED
        """How far it has come. Taken over: it is in a mode that is not ours, by a pilot or a failsafe of its own;
        nothing is commanded any more. Overdue: it does not arrive, or does not land, in any sensible time."""
        self.reason = ""
        """Why it was taken over or is overdue; empty otherwise."""
        self._orders = 0
        self._before = ""
        self._order_s = self._end_s = math.nan
        self._closest_m, self._closer_s = math.inf, math.nan

    def begin(self) -> None:
        """Send it to its refuge.

        Raises a `CommandRefusedError` if it will not, with its reason; a `VehicleTimeoutError` if it did not answer,
        though asked several times: it may not have heard.
        """
        self._order_again()
        self.state = DivertState.FLYING

    def _order_again(self) -> None:
        place = self.refuge
        self._orders += 1
        self._repeat(lambda: self.vehicle.go_to(place.lat_deg, place.lon_deg, place.height_m))
        self._order_s = math.nan

    def _repeat(self, order: Callable[[], None]) -> None:
        """Give an order again where there was no answer: giving it twice does no harm."""
        self._before = self.vehicle.mode
        for attempt in range(_ORDERS):
            try:
                order()
            except VehicleTimeoutError:
                if attempt == _ORDERS - 1:
                    raise
            else:
                return

    def _taken(self, time_s: float) -> bool:
        """Whether it is in a mode that is neither ours nor, for a while, the one it was in before our order."""
        mode = self.vehicle.mode
        if mode in _OWN_MODES[self.state.value] or not self.vehicle.armed:
            return False  # PX4 leaves LAND as it disarms; samples on their way still say armed
        return mode != self._before or time_s > self._order_s + _SETTLE_S

    def hear(self, sample: TelemetrySample) -> DivertState:
        """Continue by the vehicle's latest report; returns the state.

        Raises a `LinkError` if an order was refused, or not answered.
        """
        if self.state.over or self.state is DivertState.ORDERED:
            return self.state
        if math.isnan(self._order_s):
            self._order_s = sample.time_s
        if not self.vehicle.armed:  # whatever mode that leaves it in: PX4 leaves LAND when it disarms
            if sample.landed != 0.0 or self.state is DivertState.LANDING:
                self.state = DivertState.LANDED
        elif self._taken(sample.time_s):
            self.state = DivertState.TAKEN
            self.reason = f"it is in mode {self.vehicle.mode}, which we did not command"
        elif self.state is DivertState.FLYING:
            self._fly(sample)
        elif sample.time_s > self._end_s:
            self._overdue(f"it has not landed in {duration(_LANDING_S)}")
        return self.state

    def _overdue(self, why: str) -> None:
        self.state, self.reason = DivertState.OVERDUE, why

    def _fly(self, sample: TelemetrySample) -> None:
        away = self.away_m(sample)
        if math.isnan(away):
            return
        if math.isnan(self._end_s):
            self._end_s = sample.time_s + away / _SLOWEST_MPS + _LANDING_S
        if away < self._closest_m - STALLED_M:
            self._closest_m, self._closer_s = away, sample.time_s
        there = away <= ARRIVED_M and abs(sample.height_m - self.refuge.height_m) <= ARRIVED_HEIGHT_M
        if there and sample.ground_speed_mps <= ARRIVED_MPS:
            self._repeat(self.vehicle.land)
            self.state = DivertState.LANDING
            self._order_s, self._end_s = sample.time_s, sample.time_s + _LANDING_S
        elif sample.time_s > self._end_s:
            self._overdue(f"it is still {distance_text(away)} away")
        elif away > ARRIVED_M and sample.time_s > self._closer_s + STALLED_S:
            if self._orders >= _ORDERS:
                self._overdue(
                    f"it stays {distance_text(away)} away, though it was sent there {how_often(self._orders)}"
                )
                return
            self._closer_s = sample.time_s
            self._order_again()

    def away_m(self, sample: TelemetrySample) -> float:
        """Distance of a sample from the refuge, m; NaN where its position is unknown."""
        if math.isnan(sample.lat_deg) or math.isnan(sample.lon_deg):
            return math.nan
        return float(distance_m(sample.lat_deg, sample.lon_deg, self.refuge.lat_deg, self.refuge.lon_deg))
