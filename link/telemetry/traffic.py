"""Other aircraft that a vehicle's receiver detects (ADSB_VEHICLE), and which of them are near."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.models.base.formatting import distance_text, height_text
from skyway.models.base.geodesy import inverse

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message
    from skyway.models.drones.telemetry import TelemetrySample

_COORDINATES, _ALTITUDE, _CALLSIGN = 1, 2, 16
_OLD_S, _FORGOTTEN_S = 30, 60.0
_MAX_AIRCRAFT = 500


@dataclass(frozen=True, slots=True)
class TrafficLimits:
    """Limits of nearness; an aircraft without a reported height counts as being at ours."""

    away_m: float = 3000.0
    height_m: float = 300.0
    """`away_m`, `height_m`: within both it is near."""

    def hold(self, one: Aircraft, margin: float = 1.0) -> bool:
        """Whether an aircraft is near, within a multiple of the limits."""
        return one.away_m <= margin * self.away_m and not abs(one.above_m) > margin * self.height_m


@dataclass(frozen=True, slots=True)
class Aircraft:
    """One aircraft, from its latest report."""

    name: str
    """Its callsign, or its ICAO address."""
    lat_deg: float
    lon_deg: float
    alt_m: float
    """`lat_deg`, `lon_deg`, `alt_m`: position; the height is NaN if not reported."""
    heard_s: float
    """Time of the report, by the clock."""
    away_m: float
    above_m: float
    """`away_m`, `above_m`: from the drone; NaN if either place is unknown."""

    def __str__(self) -> str:
        height = (
            "at unknown height"
            if math.isnan(self.above_m)
            else f"{height_text(abs(self.above_m))} {'above' if self.above_m >= 0.0 else 'below'}"
        )
        return f"aircraft {self.name}: {distance_text(self.away_m)} away, {height}"


@dataclass(slots=True)
class Traffic:
    """The aircraft near one vehicle."""

    limits: TrafficLimits = field(default_factory=TrafficLimits)
    """Limits of nearness."""
    known: dict[int, Aircraft] = field(default_factory=dict)
    """By ICAO address."""
    _told_s: dict[int, float] = field(default_factory=dict)
    _alerts: list[Aircraft] = field(default_factory=list)

    def take_limits(self, limits: TrafficLimits) -> None:
        """Set the limits of nearness."""
        self.limits = limits

    def hear(self, message: Message, own: TelemetrySample | None, now_s: float) -> None:
        """Process an ADSB_VEHICLE; old reports, and those without a place, are omitted."""
        flags, number = message["flags"], message["ICAO_address"]
        lat, lon = message["lat"] * 1e-7, message["lon"] * 1e-7
        if not flags & _COORDINATES or message["tslc"] > _OLD_S or not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            return
        alt_m = message["altitude"] * 1e-3 if flags & _ALTITUDE else math.nan
        away_m = above_m = math.nan
        if own is not None and math.isfinite(own.lat_deg):
            away_m = float(inverse(own.lat_deg, own.lon_deg, lat, lon)[0])
            above_m = alt_m - own.alt_msl_m
        name = message["callsign"].strip() if flags & _CALLSIGN else ""
        seen = Aircraft(
            name if name.isprintable() and name else f"{number:06X}", lat, lon, alt_m, now_s, away_m, above_m
        )
        self.known = {key: one for key, one in self.known.items() if now_s <= one.heard_s + _FORGOTTEN_S}
        if number in self.known or len(self.known) < _MAX_AIRCRAFT:
            self.known[number] = seen
        if self.limits.hold(seen):
            if now_s > self._told_s.get(number, -math.inf) + _FORGOTTEN_S and len(self._alerts) < _MAX_AIRCRAFT:
                self._alerts.append(seen)
            self._told_s[number] = now_s
            if len(self._told_s) > 2 * _MAX_AIRCRAFT:
                self._told_s.clear()

    def alerts(self) -> list[Aircraft]:
        """Return the aircraft that have come near since the last call."""
        found, self._alerts = self._alerts, []
        return found

    def near(self, now_s: float, margin: float = 1.0) -> list[Aircraft]:
        """Return those within a multiple of the limits at this time, the nearest first."""
        known = [one for one in self.known.values() if now_s <= one.heard_s + _OLD_S]
        found = [one for one in known if self.limits.hold(one, margin)]
        return sorted(found, key=lambda one: one.away_m)
