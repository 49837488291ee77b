"""Deliveries under a policy that sees only what a drone would know; all runs of one order fly together, leg by leg."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from benchmarks.independent.flight import fly
from benchmarks.independent.telling import seen

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from benchmarks.independent.ground import Ground
    from benchmarks.independent.information import Flown, Leave, Order, Policy
    from benchmarks.independent.pads import Stations
    from benchmarks.independent.vehicle.battery import Batteries, Charging
    from benchmarks.independent.vehicle.craft import Air, Flying
    from benchmarks.independent.vehicle.energy import Power
    from benchmarks.independent.weather.reports import Site
    from benchmarks.independent.weather.turbulence import Gusts

DELIVERED, STRANDED, NEVER_LEFT, GAVE_UP = "delivered", "stranded", "never left", "gave up"
LONGEST_S = 46 * 3600.0
"""A delivery that waits longer has failed: the product looks 48 h ahead."""
MOST_LEGS = 40
AGAIN_S = 30.0


@dataclass(frozen=True, eq=False)
class Setting:
    """Everything true of the runs of one order.

    Attributes
    ----------
    shift_s : ndarray, shape (runs,)
        The record's time is that of the order's calendar plus so much.
    told : tuple of Site
        Sites whose reports the drone is told.
    begin_s : float
        When the winds begin, by the order's calendar.
    gusts : callable
        Gusts of all runs, by the number of the leg.
    """

    ground: Ground
    air: Air
    gusts: Callable[[int], Gusts]
    power: Power
    vehicle: NDArray[np.float64]
    how: Flying
    batteries: Batteries
    charging: Charging
    stations: Sequence[Stations]
    told: tuple[Site, ...]
    shift_s: NDArray[np.float64]
    begin_s: float


@dataclass(eq=False)
class Run:
    """One delivery under way."""

    number: int
    node: int
    time_s: float
    came_s: float
    soc: float = 1.0
    ending: str = ""
    flights: list[Flown] = field(default_factory=list)
    landings: list[float] = field(default_factory=list)


def deliver(setting: Setting, order: Order, policy: Policy) -> list[Run]:
    """Fly an order in all runs of a setting."""
    index = {name: node for node, name in enumerate(setting.ground.ids)}
    runs = [Run(k, index[order.origin], order.depart_s, order.depart_s) for k in range(len(setting.shift_s))]
    goal = index[order.destination]
    for leg in range(MOST_LEGS):
        going: dict[int, tuple[Leave, float]] = {}
        for run in runs:
            if run.ending:
                continue
            left = _stay(setting, policy, run, order.depart_s + LONGEST_S)
            if isinstance(left, str):
                run.ending = left
            else:
                going[run.number] = left
        if not going:
            return runs
        fly(setting, policy, going, runs, leg)
        for number in going:
            run = runs[number]
            if run.landings[-1] < 0.0:
                run.ending = STRANDED
            elif run.node == goal:
                run.ending = DELIVERED
    for run in runs:
        run.ending = run.ending or GAVE_UP
    return runs


def _next_report(setting: Setting, run: Run, time_s: float) -> float:
    """When the next report comes out, by the order's calendar."""
    shift = float(setting.shift_s[run.number])
    after = [site.out_s[k + 1] for site in setting.told if (k := site.latest(time_s + shift)) + 1 < len(site.out_s)]
    return float(min(after)) - shift if after else math.inf


def _stay(setting: Setting, policy: Policy, run: Run, end_s: float) -> tuple[Leave, float] | str:
    """Stay at a stop until the policy's conditions are met: (how, take-off), or how it ends."""
    landed, at_landing = run.time_s, run.soc
    curve = setting.charging
    on_pad = max(landed, setting.stations[run.number].line(run.node).pad_time(run.came_s))
    before = curve.time_s(at_landing)

    def charge(time_s: float) -> float:
        return curve.soc(before + time_s - on_pad) if time_s > on_pad else at_landing

    def gauge(time_s: float) -> float:
        return setting.batteries.told_one(run.number, charge(time_s))

    now = landed
    while now < end_s:
        answer = policy.leave(seen(setting, run, run.node, run.came_s, now, charge(now)))
        if answer is None:
            return GAVE_UP
        until = min(max(answer.look_s, now + AGAIN_S), _next_report(setting, run, now))
        at = now
        while answer.segments and at < until:
            wanted = max(answer.charge, answer.needs(at))
            if gauge(at) >= wanted - 1e-9:
                if at == now:
                    run.soc = charge(at)
                    return answer, at
                break
            if wanted > 1.0 or math.isinf(on_pad):
                at = until
                break
            true = setting.batteries.true_one(run.number, wanted)
            at = max(on_pad + curve.time_s(true) - before, at + AGAIN_S)
        now = min(at, until) if answer.segments else until
    return NEVER_LEFT
