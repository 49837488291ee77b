"""Distributions over the simulated deliveries of a composition: arrival, cost and energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.base.statistics import Figure


@dataclass(frozen=True, slots=True)
class ArrivalDistribution:
    """Arrival of the package over the forecast (None: unknown), with the uncertainty of each figure."""

    mean: datetime | None
    p50: datetime | None
    p95: datetime | None
    """Mean arrival, and when half and 95 % of the deliveries have arrived."""
    delivery_mean: Figure | None = None
    delivery_p50: Figure | None = None
    delivery_p95: Figure | None = None
    """The same as delivery times, s, with their uncertainty; None if nothing was sampled."""
    runs: int | None = None
    """Simulated deliveries behind them: those in which the package arrives."""
    p_arrive: float | None = None
    """Probability that it arrives: in the others no later hour of the forecast lets the drone leave some place."""


@dataclass(frozen=True, slots=True)
class DeliveryCosts:
    """Cost of the delivery, over the simulated deliveries, in the scenario's currency; includes recharging the battery at the end.

    Attributes
    ----------
    currency : str
        What the prices are in.
    mean, p95 : Figure
        Of the sum.
    energy, pad_fees, refill, wear : float
        Means of its parts: charged on the way, fees of pads, bought afterwards, wear of drone and battery.
    """

    currency: str
    mean: Figure
    p95: Figure
    energy: float
    pad_fees: float
    refill: float
    wear: float


@dataclass(frozen=True, slots=True)
class EnergyDistribution:
    """Energy that the delivery flies with, over the simulated deliveries, Wh."""

    mean: Figure
    p95: Figure
