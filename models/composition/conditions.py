"""Conditions of a plan besides its forecast: observed winds and pads at the time of planning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from datetime import datetime


@dataclass(frozen=True, slots=True)
class Condition:
    """One observation that the promise of a plan rests on."""

    kind: Literal["wind", "pads"]
    place: str
    """A site of the wind record, a station, or latitude and longitude."""
    time: datetime
    """When it was observed, UTC."""
    age_s: float
    """Before the departure."""
    source: str
    """The file, service or option that it came from."""
    speed_mps: float | None = None
    from_deg: float | None = None
    """Of a wind, as observed; no direction is a variable one."""
    busy: int | None = None
    """Drones on the pads of a station and in line."""
