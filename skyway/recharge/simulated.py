"""Simulation of the flights of a cut mission: its end, and whether each landing keeps the reserve, over winds, energies, times and pads.

Every flight is flown in every wind of the forecast; energy and times differ from the models according to the beliefs about the drone and its
operators (`models.drones.time_belief`); on a pad it is charged to the planned charge, corrected by the energy learnt in the flights
before, as `skyway fly` decides it, however long that takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.energy import fly_leg
from skyway.missions.checks.route import fly
from skyway.models.base.statistics import weighted_quantile
from skyway.models.drones.time_belief import TimeBelief
from skyway.models.flight.energy import FlightPower
from skyway.planner.fixed_route.pad_windows import ALWAYS
from skyway.recharge.problem import sure_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.fixed_route.pad_windows import Window
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.problem import RechargeOptions

RUNS = 4000
FULL = 1.0


@dataclass(frozen=True, slots=True)
class SimulatedFlights:
    """Results of many runs of a cut mission.

    Attributes
    ----------
    end_s, end_early_s, end_p50_s, end_late_s : float
        Mean, and 5th, 50th and 95th percentile, of the landing at the end, after the first take-off.
    p_reserve : float
        Probability that every landing keeps the reserve.
    each_p_reserve : tuple of float
        Of each flight.
    runs : int
        Number of runs.
    ends_s, kept : ndarray
        Of each run the end, and whether every landing kept the reserve.
    """

    end_s: float
    end_early_s: float
    end_p50_s: float
    end_late_s: float
    p_reserve: float
    each_p_reserve: tuple[float, ...]
    runs: int
    ends_s: NDArray[np.float64] = field(compare=False, repr=False)
    kept: NDArray[np.bool_] = field(compare=False, repr=False)


def simulated(
    found: Recharged, *, runs: int = RUNS, seed: int | None = None, drone: int = 0, times: TimeBelief | None = None
) -> SimulatedFlights:
    """Simulate a cut mission; the same seed gives the same runs, and several drones the same winds."""
    times = times or TimeBelief()
    options, plan = found.problem.options, found.plan
    conditions = options.conditions
    rng = np.random.default_rng(options.seed if seed is None else seed)
    weight = conditions.weather.probability
    wind = rng.choice(len(weight), runs, p=weight / weight.sum())
    if drone:
        rng = np.random.default_rng((options.seed if seed is None else seed, drone))
    ratios = conditions.drone.energy_belief.sampled(rng, runs, len(found.told))
    factors = times.sampled(rng, runs, len(found.told))
    clock = np.full(runs, plan.depart_s)
    soc = np.full(runs, conditions.soc_start)
    kept = np.ones((len(found.told), runs), dtype=bool)
    pool, ground_s = _Pool(found, runs), options.ground_s
    taught = Taught(options)
    power = FlightPower.of(conditions.drone, conditions.payload_kg)
    for number in range(len(found.told)):
        begin = np.bincount(wind, clock, len(weight)) / np.maximum(np.bincount(wind, minlength=len(weight)), 1)
        begin = np.where(begin > 0.0, begin, clock.mean())
        time_s, energy_j, turns_s = _in_each_wind(found, number, begin)
        more_s = turns_s * (factors.manoeuvres - 1.0)
        modelled_soc = energy_j[wind] / power.battery_j
        used_soc = ratios[:, number] * (modelled_soc + power.cruise_w * more_s / power.battery_j)
        soc = soc - used_soc
        kept[number] = soc >= conditions.reserve_soc
        taught.learn(used_soc, modelled_soc)
        clock = clock + factors.flights[number] * (time_s[wind] - turns_s) + turns_s + more_s
        if number < len(plan.stops):
            stop = plan.stops[number]
            clock = clock + _waits(found, stop.pad, clock, rng)
            first_s, last_s = _window(found, number)
            clock = np.maximum(clock, first_s)
            handled_s = ground_s * factors.ground[number]
            if options.swap_s is not None:
                clock, soc = pool.changed(clock, soc) + handled_s, np.ones(runs)
                continue
            curve = conditions.drone.charging_curve(found.problem.ways.pads[stop.pad].recharge_power_w)
            _, then_j, then_turns_s = _in_each_wind(found, number + 1, np.full(len(weight), stop.leave_s))
            then_soc = float(np.mean(then_j)) / power.battery_j
            more_soc = taught.more(then_turns_s * power.cruise_w / float(np.mean(then_j))) * then_soc
            wanted = np.minimum(stop.soc_leave + more_soc, FULL)
            target = np.maximum(soc, wanted)
            if math.isfinite(last_s):  # then the van drives on, even with a drone on its roof
                stay_s = np.maximum(last_s - clock - handled_s, 0.0) / factors.charging
                most = curve.soc(np.asarray(curve.time_from_empty_s(np.maximum(soc, 0.0))) + stay_s)
                target = np.maximum(soc, np.minimum(target, np.asarray(most)))
            clock = clock + factors.charging * np.asarray(curve.duration_s(np.maximum(soc, 0.0), target)) + handled_s
            soc = target
    one = np.ones(runs)
    return SimulatedFlights(
        float(clock.mean()),
        weighted_quantile(clock, one, 0.05),
        weighted_quantile(clock, one, 0.5),
        weighted_quantile(clock, one, 0.95),
        float(kept.all(axis=0).mean()),
        tuple(float(share) for share in kept.mean(axis=1)),
        runs,
        clock,
        np.asarray(kept.all(axis=0)),
    )


class Taught:
    """Energy belief learnt from the flights of each run, like `EnergyBelief.learnt` for one."""

    def __init__(self, options: RechargeOptions) -> None:
        self.belief = self.begun = options.conditions.drone.energy_belief
        self.epsilon, self.mean = options.epsilon, np.full(1, self.belief.mean_ratio)

    def learn(self, used_soc: NDArray[np.float64], modelled_soc: NDArray[np.float64]) -> None:
        """Learn from a flight of each run."""
        modelled = float(np.mean(modelled_soc))
        if not modelled > 0.0:
            return
        # an excess of 1 over the mean moves the mean by the gain
        then = self.belief.learnt(modelled * (1.0 + self.belief.mean_ratio), modelled)
        gain = then.mean_ratio - self.belief.mean_ratio
        self.mean = self.mean + gain * (used_soc / np.maximum(modelled_soc, 1e-9) - self.mean)
        self.belief = replace(then, mean_ratio=self.belief.mean_ratio)

    def more(self, turns: float) -> NDArray[np.float64]:
        """Of each run: extra charge of a flight over the modelled one, compared with the first; `turns` of it are manoeuvres."""
        surer = sure_of(self.belief, self.epsilon, turns) - sure_of(self.begun, self.epsilon, turns)
        return self.mean - self.begun.mean_ratio + surer


class _Pool:
    """Packs and chargers of every run, as in `PackPool` for one."""

    def __init__(self, found: Recharged, runs: int) -> None:
        options = found.problem.options
        self.swap_s, self.packs = options.swap_s or 0.0, options.packs
        self.curve = options.conditions.drone.charging_curve()
        self.full = np.full((runs, max((self.packs or 1) - 1, 0)), -math.inf)
        self.free = np.full((runs, options.chargers), -math.inf)

    def changed(self, clock: NDArray[np.float64], soc: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the departure of each run that arrives at a time with a charge."""
        if self.packs is None:
            return clock + self.swap_s
        begin = np.maximum(clock + self.swap_s, self.free[:, 0])
        full = begin + np.asarray(self.curve.duration_s(np.maximum(soc, 0.0), np.ones(len(soc))))
        self.free[:, 0] = full
        self.free.sort(axis=1)
        every = np.sort(np.column_stack((self.full, full)), axis=1)
        self.full = every[:, 1:]
        return np.asarray(np.maximum(clock, every[:, 0]) + self.swap_s)


def _in_each_wind(
    found: Recharged, number: int, begin_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Time and energy of a flight in each wind of the forecast (the mean of the others, if a wind forbids it); and seconds of manoeuvres in it."""
    conditions = found.problem.options.conditions
    mission = found.told[number].document.mission
    route = fly(mission)
    height_m, time_s, energy_j, turns_s = 0.0, np.zeros(len(begin_s)), np.zeros(len(begin_s)), 0.0
    for leg in route.legs:
        flown = fly_leg(mission, leg, conditions, conditions.payload_kg, begin_s + time_s, height_m)
        share = np.where(flown.flyable, conditions.weather.probability, 0.0)
        total = max(float(share.sum()), 1e-12)
        for sums, values in ((time_s, flown.time_s), (energy_j, flown.energy_j)):
            typical = float(share @ np.where(flown.flyable, values, 0.0)) / total
            np.add(sums, np.where(flown.flyable, values, typical), out=sums)
        turns_s += flown.turns_s
        height_m = leg.next_ground_m
    return time_s, energy_j, turns_s


def _window(found: Recharged, number: int) -> Window:
    """Return the window of a pad in which the plan has a stop."""
    stop = found.plan.stops[number]
    windows = found.problem.options.windows.get(found.problem.ways.pads[stop.pad].id, (ALWAYS,))
    return min(windows, key=lambda one: max(one[0] - stop.arrive_s, stop.leave_s - one[1], 0.0))


def _waits(found: Recharged, pad: int, arrive_s: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw waits for a pad: none if it is free, otherwise memoryless as those of M/M/c, with the mean of the queue."""
    wait, free = found.problem.waits[pad], found.problem.p_free[pad]
    mean = np.interp(arrive_s, wait[:, 0], wait[:, 1]) - (found.problem.options.swap_s or 0.0)
    if not mean.any():
        return mean
    p_free = np.interp(arrive_s, wait[:, 0], free)
    taken = rng.random(len(arrive_s)) >= p_free
    return np.where(taken, rng.exponential(1.0, len(arrive_s)) * mean / np.maximum(1.0 - p_free, 1e-9), 0.0)
