"""Load of the pads by other drones, by hour of the week.

Other drones arrive as a Poisson process whose rate, like their mean charging time, depends on the hour of
the week; hour 0 begins on Monday at 00:00 local time. `models.queues.load_files` reads it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.units import S_PER_H

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

WEEK_H = 168
IDLE_CHARGING_S = 3600.0
"""Mean charging time if no drone ever charges: it matters only to drones seen on the pads at the start."""
MAX_ARRIVALS_PER_S = 1.0
MIN_CHARGING_S = 1.0
MAX_CHARGING_S = WEEK_H * S_PER_H


@dataclass(frozen=True, eq=False)
class PadLoad:
    """Arrivals of other drones and how long they charge, by station and hour of the week.

    Attributes
    ----------
    arrivals_per_s : ndarray, shape (stations, 168)
        Arrivals per second, 0 to `MAX_ARRIVALS_PER_S`.
    mean_charging_s : ndarray, shape (stations, 168)
        Mean time on a pad, seconds; a second to a week, also if nobody arrives.
    timezone : str
        IANA name; hour of week 0 begins on Monday 00:00 there.

    Raises
    ------
    InputError
        Shapes that do not fit, values out of range, an unknown time zone.
    """

    arrivals_per_s: NDArray[np.float64]
    mean_charging_s: NDArray[np.float64]
    timezone: str

    def __post_init__(self) -> None:
        zone(self.timezone)
        faults = []
        shape = self.arrivals_per_s.shape
        if len(shape) != 2 or shape[1] != WEEK_H or self.mean_charging_s.shape != shape:
            shapes = f"{shape} and {self.mean_charging_s.shape}"
            raise InputError("pad loads need the shape (stations, 168)", field="load", value=shapes)
        if not np.all((self.arrivals_per_s >= 0.0) & (self.arrivals_per_s <= MAX_ARRIVALS_PER_S)):
            faults.append(Fault("arrivals per second outside 0 to 1", field="arrivals_per_s"))
        if not np.all((self.mean_charging_s >= MIN_CHARGING_S) & (self.mean_charging_s <= MAX_CHARGING_S)):
            faults.append(Fault("mean charging time outside a second to a week", field="mean_charging_s"))
        refuse(faults)

    def __repr__(self) -> str:
        arrivals = float(self.arrivals_per_s.mean(axis=1).sum()) * 86400.0 if len(self.arrivals_per_s) else 0.0
        return f"PadLoad({len(self.arrivals_per_s)} stations, {arrivals:.0f} drones a day in all)"

    @classmethod
    def none(cls, stations: int, timezone: str) -> PadLoad:
        """No other drones, at that many stations."""
        shape = (stations, WEEK_H)
        return cls(np.zeros(shape), np.full(shape, IDLE_CHARGING_S), timezone)

    def __len__(self) -> int:
        return len(self.arrivals_per_s)

    def utilisation(self, pads: ArrayLike) -> NDArray[np.float64]:
        """Share of the pads that arrivals of each hour would keep busy, shape (stations, 168); above 1 the line grows.

        `pads`, shape (stations,); 0 at stations without pads, where nobody recharges.
        """
        count = np.broadcast_to(np.asarray(pads, dtype=np.float64), (len(self),))[:, None]
        offered = self.arrivals_per_s * self.mean_charging_s
        return np.where(count > 0.0, offered / np.maximum(count, 1.0), 0.0)

    def hourly(
        self, station: int | NDArray[np.int64], start_s: float, hours: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Arrivals per s and mean charging s in hours of UTC, shape (hours,), from the one that holds `start_s`.

        Of stations of shape (n, 1) those of each, shape (n, hours).

        Where local time changes, an hour of the week comes twice or not at all, as on the clock. In zones whose offset
        is not a whole hour, an hour of UTC gets the rates of the local hour in which it begins.
        """
        hour = hours_of_week(self.timezone, start_s, hours)
        return self.arrivals_per_s[station, hour], self.mean_charging_s[station, hour]

    def first(self, stations: int) -> PadLoad:
        """Return the load of the first stations only."""
        return PadLoad(self.arrivals_per_s[:stations], self.mean_charging_s[:stations], self.timezone)

    def extended(self, count: int) -> PadLoad:
        """Add that many stations without load at the end, such as delivery targets."""
        more = PadLoad.none(count, self.timezone)
        return PadLoad(
            np.concatenate((self.arrivals_per_s, more.arrivals_per_s)),
            np.concatenate((self.mean_charging_s, more.mean_charging_s)),
            self.timezone,
        )


def zone(timezone: str) -> ZoneInfo:
    """Time zone of an IANA name; an unknown one is an `InputError`."""
    try:
        return ZoneInfo(timezone)
    except (LookupError, ValueError, OSError, TypeError):
        remedy = "an IANA name such as America/New_York"
        raise InputError("unknown time zone", field="timezone", value=timezone, remedy=remedy) from None


def hours_of_week(timezone: str, start_s: float, hours: int) -> NDArray[np.int64]:
    """Local hour of the week, 0 to 167, in which each of consecutive UTC hours begins, shape (hours,); read-only.

    The first hour is the one that holds `start_s`, POSIX seconds.
    """
    return _hours_of_week(timezone, math.floor(start_s / S_PER_H), hours)


@lru_cache(maxsize=64)
def _hours_of_week(timezone: str, first_hour: int, hours: int) -> NDArray[np.int64]:
    place = zone(timezone)
    stamps = (datetime.fromtimestamp((first_hour + i) * S_PER_H, UTC).astimezone(place) for i in range(hours))
    result = np.fromiter((24 * stamp.weekday() + stamp.hour for stamp in stamps), np.int64, hours)
    result.flags.writeable = False
    return result
