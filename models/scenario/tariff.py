"""The tariff of a region: prices of energy at each station by hour of the week, and fees of pads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray  # noqa: TC002  dataclass fields

from skyway.models.base.errors import Fault, InputError
from skyway.models.network.files import MAX_PRICE
from skyway.models.queues.load import WEEK_H, hours_of_week


@dataclass(frozen=True, eq=False)
class Tariff:
    """Prices at stations.

    Attributes
    ----------
    currency : str
        Currency of the prices, such as ``EUR``.
    energy_per_kwh : ndarray, shape (stations, 168)
        Price of energy at each station in each hour of the week, hour 0 from Monday 00:00 local time on.
    pad_fee : ndarray, shape (stations,)
        For each charge at the station, regardless of its duration.
    refill_per_kwh : float
        Price of replacing, after a delivery, the charge that the drone has less than at its beginning.
    timezone : str
        IANA name.

    Raises
    ------
    InputError
        Shapes that do not fit, or prices that are not numbers from 0 to `MAX_PRICE`.
    """

    currency: str
    energy_per_kwh: NDArray[np.float64]
    pad_fee: NDArray[np.float64]
    refill_per_kwh: float
    timezone: str

    def __post_init__(self) -> None:
        stations = len(self.pad_fee)
        if self.energy_per_kwh.shape != (stations, WEEK_H) or self.pad_fee.shape != (stations,):
            shapes = f"{self.energy_per_kwh.shape} and {self.pad_fee.shape}"
            raise InputError("prices need the shapes (stations, 168) and (stations,)", field="tariff", value=shapes)
        for name, values in (
            ("energy_per_kwh", self.energy_per_kwh),
            ("pad_fee", self.pad_fee),
            ("refill_per_kwh", np.array([self.refill_per_kwh])),
        ):
            if not np.all((values >= 0.0) & (values <= MAX_PRICE)):
                remedy = f"a number from 0 to {MAX_PRICE:g}"
                raise InputError(Fault("is not a price", field=f"tariff.{name}", remedy=remedy))

    def __len__(self) -> int:
        return len(self.pad_fee)

    def hourly(self, station: int, start_s: float, hours: int) -> NDArray[np.float64]:
        """Price of a kWh in hours of UTC, shape (hours,), from the one that holds `start_s`, POSIX seconds."""
        return np.asarray(self.energy_per_kwh[station, hours_of_week(self.timezone, start_s, hours)])

    @property
    def by_hour(self) -> bool:
        """Whether the price at any station changes with the hour."""
        return bool((self.energy_per_kwh != self.energy_per_kwh[:, :1]).any())

    @property
    def least_per_kwh(self) -> float:
        """Lowest price of energy, bought on the way or afterwards."""
        return min(float(self.energy_per_kwh.min(initial=math.inf)), self.refill_per_kwh)

    def of_length(self, stations: int) -> Tariff:
        """Return the same for a number of stations: cut, or extended by some where the refill's price counts."""
        more = max(stations - len(self), 0)
        prices = np.vstack((self.energy_per_kwh[:stations], np.full((more, WEEK_H), self.refill_per_kwh)))
        fees = np.concatenate((self.pad_fee[:stations], np.zeros(more)))
        return Tariff(self.currency, prices, fees, self.refill_per_kwh, self.timezone)
