"""Deliveries under a policy that sees only what a drone would know; all runs of one order fly together, leg by leg."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.information import Flown, Seen
from benchmarks.independent.vehicle.craft import cruise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.ground import Ground
    from benchmarks.independent.information import Leave, Order, Policy
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
HOVER_AIRSPEED_MPS = 3.0


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
        _fly(setting, policy, going, runs, leg)
        for number in going:
            if not runs[number].ending and runs[number].node == goal:
                runs[number].ending = DELIVERED
    for run in runs:
        run.ending = run.ending or GAVE_UP
    return runs


def _seen(setting: Setting, run: Run, node: int, landed_s: float, time_s: float, soc: float) -> Seen:
    reports = {}
    shift = float(setting.shift_s[run.number])
    for site in setting.told:
        k = site.latest(time_s + shift)
        if k >= 0:
            reports[site.id] = (float(site.time_s[k]) - shift, float(site.wind[k, 0]), float(site.wind[k, 1]))
    stations = setting.stations[run.number]

    def line(other: int) -> int:
        found = stations.line(other)
        return found.before(landed_s, time_s) + found.out if other == node else found.told(time_s)

    here = stations.line(node)
    behind = here.present(time_s) - here.before(landed_s, time_s)
    told = float(setting.batteries.told_one(run.number, soc))
    return Seen(
        run.number, node, setting.ground.ids[node], landed_s, time_s, told, reports, line, behind, tuple(run.flights)
    )


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
        answer = policy.leave(_seen(setting, run, run.node, run.came_s, now, charge(now)))
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


def _fly(setting: Setting, policy: Policy, going: dict[int, tuple[Leave, float]], runs: list[Run], leg: int) -> None:
    """Take off, fly segment by segment, land, hover until there is a place: all runs that go together, by their number."""
    gusts, air, how, ground = setting.gusts(leg), setting.air, setting.how, setting.ground
    share = setting.vehicle / setting.batteries.holds_j
    chosen = np.array([run.number in going for run in runs])
    now = np.array([going[run.number][1] if run.number in going else run.time_s for run in runs])
    soc = np.array([run.soc for run in runs])
    node = np.array([run.node for run in runs])
    rest = [going[run.number][0].segments if run.number in going else () for run in runs]
    flown: list[tuple[int, ...]] = [() for _ in runs]
    met, aloft_s = np.zeros((len(runs), 2)), np.zeros(len(runs))

    def spend(seconds: NDArray[np.float64] | float, climb: float) -> None:
        wind = air.aloft(ground.xy[node], now - setting.begin_s, now + setting.shift_s)
        speed = np.maximum(np.hypot(wind[:, 0], wind[:, 1]), HOVER_AIRSPEED_MPS)
        soc[:] -= np.where(chosen, share * setting.power(speed, climb) * seconds, 0.0)
        now[:] += np.where(chosen, seconds, 0.0)

    spend(how.climb_s, how.climb_mps)
    while any(rest):
        ahead = np.array([bool(one) for one in rest])
        begin = ground.xy[node]
        end = np.array([ground.xy[ground.head[one[0]]] if one else begin[k] for k, one in enumerate(rest)])
        part = cruise(air, gusts, setting.power, how, (begin, end), now - setting.begin_s, now + setting.shift_s)
        now += part.took_s
        soc -= share * part.energy_j
        met += part.took_s[:, None] * part.wind
        aloft_s += part.took_s
        for k in np.flatnonzero(ahead).tolist():
            node[k] = ground.head[rest[k][0]]
            flown[k], rest[k] = (*flown[k], rest[k][0]), rest[k][1:]
            if rest[k] and ground.pads[node[k]] > 0:
                rest[k] = policy.over(
                    _seen(setting, runs[k], int(node[k]), float(now[k]), float(now[k]), float(soc[k])), rest[k]
                )
    spend(how.descent_s, -how.descent_mps)
    came = now.copy()
    hovered = np.zeros(len(runs))
    for k in np.flatnonzero(chosen).tolist():
        hovered[k] = setting.stations[k].line(int(node[k])).place_time(float(came[k])) - came[k]
    spend(hovered, 0.0)
    for number, (_, off) in going.items():
        run, after = runs[number], float(soc[number])
        told = setting.batteries.told_one(number, run.soc), setting.batteries.told_one(number, after)
        wind = met[number] / max(aloft_s[number], 1e-9)
        run.flights.append(
            Flown(
                flown[number], off, float(now[number]), *told, float(hovered[number]), (float(wind[0]), float(wind[1]))
            )
        )
        run.node, run.time_s, run.came_s, run.soc = int(node[number]), float(now[number]), float(came[number]), after
        run.landings.append(after)
        if after < 0.0:
            run.ending = STRANDED
