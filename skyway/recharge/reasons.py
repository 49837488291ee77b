"""Reasons why a mission cannot be cut: no pad in reach, with the missing energy; or an item that cannot be left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.recharge.item_roles import role_of
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text, energy_text, percent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.recharge.problem import RechargeProblem


def no_plan(problem: RechargeProblem, sure_ratio: float) -> InputError:
    """Return the error of a mission that no stops make flyable: the first stretch of work that exceeds any battery."""
    work, ways = problem.work, problem.ways
    can_leave = np.array([point.hinders is None for point in work.points])
    if not can_leave.any():
        return _nowhere(problem)
    reached, lacking, to_point = _reach(problem, sure_ratio, can_leave)
    if not np.isfinite(ways.level_m[can_leave]).any():
        what = "leaves the fence, enters a zone, or is over unknown ground"
        return InputError(f"no pad in reach: every flight from the mission to a pad {what}", field="--pads")
    if reached == len(work.points) - 1 and problem.options.windows:
        told = "pads are not available when necessary, or not long enough; with pads available at any time, the mission could be cut"
        return InputError(
            told, field="--pads", remedy="extend vans and bookings, or add a pad that is always available"
        )
    hindering = _hindering(problem, sure_ratio, reached)
    if hindering is not None:
        name = work.mission.items[hindering].name
        told = (
            f"item {hindering} ({name}) cannot be cut, and the battery lacks {percent(lacking, 1)} of its energy to fly from before it"
            " to a pad after it"
        )
        return InputError(told, field="mission", remedy="add a nearer pad, or use a larger battery")
    joule = lacking * problem.options.conditions.drone.battery_j
    target = work.points[to_point]
    pad, away = _nearest(problem, to_point)
    item = work.steps[max(target.step, 0)].item
    text = (
        f"no pad in reach: on the way to item {item} the battery lacks {energy_text(joule)} ({percent(lacking, 1)} of it)"
        f" to continue and land with the reserve; the nearest pad, {pad}, is {distance_text(away)} from there"
    )
    return InputError(text, field="--pads", remedy="add a nearer pad, lower the reserve, or use a larger battery")


def _nowhere(problem: RechargeProblem) -> InputError:
    """Return the error of a mission that cannot be left anywhere: the item that prevents it, otherwise its first one."""
    items = problem.work.mission.items
    hinders = [point.hinders for point in problem.work.points if point.hinders is not None]
    bound = [one for one in hinders if role_of(items[one]) == "bound"]
    inside = [one for one in hinders if items[one].command not in TAKEOFF_COMMANDS | LAND_COMMANDS]
    number = (bound or inside or hinders)[0]
    told = f"item {number} ({items[number].name}) cannot be cut, nor the items after it: no place to leave the mission for a pad"
    return InputError(told, field="mission", remedy="use a larger battery, or fly that part as a separate mission")


def _hindering(problem: RechargeProblem, sure_ratio: float, reached: int) -> int | None:
    """Return the item that limits the reach of the battery: one that cannot be left, not a take-off or landing."""
    work = problem.work
    ends = TAKEOFF_COMMANDS | LAND_COMMANDS | {Command.NAV_RETURN_TO_LAUNCH}
    items = work.mission.items
    could = np.array(
        [
            point.hinders is None or (items[point.hinders].command not in ends and not point.on_ground)
            for point in work.points
        ]
    )
    farther, _, _ = _reach(problem, sure_ratio, could)
    if farther <= reached:
        return None
    behind = (point.hinders for point in work.points[reached + 1 :] if point.hinders is not None)
    return next((number for number in behind if items[number].command not in ends), None)


def _nearest(problem: RechargeProblem, point: int) -> tuple[str, float]:
    here = problem.work.points[point]
    pads = problem.ways.pads
    away, _ = geodesy.inverse(here.lat, here.lon, [pad.lat for pad in pads], [pad.lon for pad in pads])
    return pads[int(np.argmin(away))].id, float(np.min(away))


def _reach(problem: RechargeProblem, sure_ratio: float, can_leave: NDArray[np.bool_]) -> tuple[int, float, int]:
    """Return the last point that full batteries reach with a landing after it, the charge lacking to continue, SoC, and the next point."""
    hops, conditions = problem.hops, problem.options.conditions
    work = hops.work_soc.min(axis=0)
    done = np.concatenate(([0.0], np.cumsum(work)))
    to = np.where(np.isfinite(hops.to_s.min(axis=0)), hops.to_soc.min(axis=0), np.inf).min(axis=1)
    back = np.where(np.isfinite(hops.from_s.min(axis=0)), hops.from_soc.min(axis=0), np.inf).min(axis=1)
    last = len(done) - 1
    usable_full = (1.0 - conditions.reserve_soc) / sure_ratio
    reached, begin, budget = 0, 0.0, (conditions.soc_start - conditions.reserve_soc) / sure_ratio
    lacking, where = np.inf, 0
    for _ in range(last + 1):
        ends = np.where(can_leave, to, np.inf)
        ends[last] = 0.0
        need = begin + done - done[reached] + ends
        possible = np.flatnonzero((need <= budget) & (np.arange(last + 1) > reached))
        if not len(possible):
            behind = np.arange(last + 1) > reached
            with np.errstate(invalid="ignore"):
                excess = np.where(behind, need - budget, np.inf)
            where = int(np.argmin(excess))
            lacking = float(excess[where]) * sure_ratio
            return reached, lacking, where
        reached = int(possible[-1])
        if reached == last:
            return last, 0.0, last
        begin, budget = float(back[reached]), usable_full
    return reached, float(lacking), where
