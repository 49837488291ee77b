"""Consumption of simulated deliveries: energy flown, and the cost of charges, pads and wear.

The cost of a delivery is the sum of

- energy charged on the way, each kWh at the price of its station in the hour in which it reaches the battery,
- the fee of a pad for every stop at which the drone charges,
- energy that the battery lacks at the end compared with the beginning, bought afterwards at the scenario's usual price,
- wear: of the hours flown, and of the charge taken in flight, by cycles of the battery.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.planner.problem.objective import J_PER_KWH
from skyway.planner.schedule.schedule_kernels import PAD, SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary

CHARGED = 1e-9
"""A stop with a smaller gain, as SoC, does not count as charging."""


@dataclass(frozen=True, eq=False)
class Spending:
    """Consumption of several deliveries, shape (runs,) each; prices in the scenario's currency, 0 without a tariff."""

    energy_j: NDArray[np.float64]
    """Flown."""
    energy: NDArray[np.float64]
    """Price of the energy charged on the way."""
    fees: NDArray[np.float64]
    """Of pads."""
    refill: NDArray[np.float64]
    """Price of the charge that is bought afterwards."""
    wear: NDArray[np.float64]
    """Of the drone and its battery."""

    @property
    def cost(self) -> NDArray[np.float64]:
        """Total cost."""
        return self.energy + self.fees + self.refill + self.wear

    def of(self, runs: NDArray[np.bool_]) -> Spending:
        """Return that of some of the runs."""
        return Spending(*(getattr(self, name)[runs] for name in ("energy_j", "energy", "fees", "refill", "wear")))


def spending(problem: Problem, itinerary: Itinerary, runs: NDArray[np.float64]) -> Spending:
    """Compute the consumption of deliveries, runs of shape (runs, legs, 7); legs that are not flown consume nothing."""
    flown = np.isfinite(runs[:, :, TOUCH_DOWN])
    start = np.where(flown, runs[:, :, SOC_TAKE_OFF], 0.0)
    end = np.where(flown, runs[:, :, SOC_LANDING], 0.0)
    before = np.concatenate((np.full((len(runs), 1), problem.soc), runs[:, :-1, SOC_LANDING]), axis=1)
    taken = (start - end).sum(axis=1)
    energy_j = taken * problem.drone.battery_j
    zero = np.zeros(len(runs))
    tariff = problem.tariff
    if tariff is None:
        return Spending(energy_j, zero, zero, zero, zero)
    kwh, energy, fees = problem.drone.battery_j / J_PER_KWH, zero.copy(), zero.copy()
    for number, leg in enumerate(itinerary):
        node = int(problem.network.tail[leg.segments[0]])
        charged = flown[:, number] & (runs[:, number, SOC_TAKE_OFF] > before[:, number] + CHARGED)
        if charged.any():
            some = runs[charged, number]
            socs = before[charged, number], some[:, SOC_TAKE_OFF]
            energy[charged] += kwh * charge_price(problem, node, some[:, PAD], some[:, TAKE_OFF], socs)
            fees[charged] += tariff.pad_fee[node]
    with np.errstate(invalid="ignore"):
        hours = np.where(flown, runs[:, :, TOUCH_DOWN] - runs[:, :, TAKE_OFF], 0.0).sum(axis=1) / S_PER_H
    lacking = np.maximum(problem.soc - _last(problem, flown, runs), 0.0)
    wear = problem.drone.wear_per_flight_h * hours + problem.drone.wear_per_cycle * taken
    return Spending(energy_j, energy, fees, tariff.refill_per_kwh * kwh * lacking, wear)


def _last(problem: Problem, flown: NDArray[np.bool_], runs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Charge at the last landing of each run; at the start if there is none."""
    count = flown.sum(axis=1)
    landed = runs[np.arange(len(runs)), np.maximum(count - 1, 0), SOC_LANDING]
    return np.where(count > 0, landed, problem.soc)


def charge_price(
    problem: Problem,
    node: int,
    pad_s: NDArray[np.float64],
    leave_s: NDArray[np.float64],
    socs: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Price of charges at a station, for a battery of 1 kWh, shape (charges,): from a pad reached to a take-off, from one SoC to another.

    The charge follows the station's curve from `pad_s` on; the energy of each hour has the price of that hour.
    """
    tariff = problem.tariff
    if tariff is None:
        return np.zeros(len(pad_s))
    low, high = socs
    first_s = float(np.floor(pad_s.min() / S_PER_H) * S_PER_H)
    count = int(np.ceil((leave_s.max() - first_s) / S_PER_H)) + 1
    prices = tariff.hourly(node, first_s, count)
    if (prices == prices[0]).all():
        return np.asarray(prices[0] * (high - low))
    curve_s, curve_soc = problem.curve(node)
    from_empty = np.interp(low, curve_soc, curve_s)
    closures = problem.closures.get(node)
    level, total = low, np.zeros(len(pad_s))
    for hour, price in enumerate(prices.tolist()):
        end_s = np.clip(first_s + (hour + 1) * S_PER_H, pad_s, leave_s)
        charged_s = end_s - pad_s - (closures.within(pad_s, end_s) if closures is not None else 0.0)
        reached = np.clip(np.interp(from_empty + charged_s, curve_s, curve_soc), level, high)
        total += price * (reached - level)
        level = reached
    return total
