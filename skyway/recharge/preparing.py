"""Completion of a mission before the cut: from the ground to the ground, for the autopilots that can fly it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.autopilots.registry import family_of
from skyway.missions.checks.areas import check_fence
from skyway.missions.checks.route import fly
from skyway.missions.checks.structure import check_structure
from skyway.missions.items.commands import TAKEOFF_COMMANDS
from skyway.missions.recharge.item_roles import role_of
from skyway.missions.recharge.pad_ways import pad_grounds_m, pad_ways
from skyway.missions.recharge.parts import completed
from skyway.missions.recharge.work import too_many_repeats, work_of
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import height_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.mission import Mission
    from skyway.missions.recharge.pad_ways import PadWays
    from skyway.missions.recharge.work import Work
    from skyway.models.network.station import Station
    from skyway.recharge.problem import RechargeOptions

LOW_TAKEOFF_M = 10.0
"""Least height of a take-off that is added to a mission without one."""
_OF_THE_WHOLE = ("px4-sideways-after-land", "ardupilot-no-takeoff", "px4-takeoff-not-first")
"""Findings of a whole mission that do not apply to its flights."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A mission from the ground to the ground, and the autopilots for which it is cut."""

    document: MissionDocument
    families: tuple[Family, ...]
    """Autopilots that fly it."""
    only: bool
    """One autopilot was requested."""
    pads: tuple[Station, ...]
    """Those on which landing is possible."""
    notes: tuple[str, ...]
    left_out: tuple[str, ...]
    """Notes on the autopilots that do not fly it."""

    @property
    def by(self) -> Family | None:
        """Autopilot that reads it; None if neither the file nor the caller names one."""
        return self.families[0] if self.only else family_of(self.document.mission.firmware)

    def work(self, options: RechargeOptions) -> Work:
        """Return its work."""
        return work_of(self.document.mission, self.by, laps=options.laps, only=self.only)

    def ways(self, work: Work, options: RechargeOptions) -> PadWays:
        """Return the ways between its work and the pads."""
        home = self.document.mission.home
        home_m = None if home is None else home.altitude_m
        ground = pad_grounds_m(self.pads, home_m, options.transit.over, level=options.level_ground)
        document = replace(self.document, mission=work.mission)  # the work may be reordered
        return pad_ways(work, document, self.pads, ground, options.transit, self.families)


def prepared(
    document: MissionDocument, pads: Sequence[Station], families: Sequence[Family], options: RechargeOptions
) -> Prepared:
    """Complete a mission, and determine its drone and possible landings. Raises an `InputError` with the obstacle."""
    given = len(document.mission.items)
    if options.conditions.drone_is_assumed and (document.mission.is_for_wings or document.mission.is_for_the_surface):
        kind = "an aeroplane or a VTOL" if document.mission.is_for_wings else "a rover, boat or submarine"
        raise InputError(f"the mission was planned for {kind}", field="--drone", remedy="name the drone that flies it")
    mission, notes = _whole(document.mission, families, options)
    document = replace(document, mission=mission)
    flown_by, left_out = _that_fly(document, families, options, given)
    usable = tuple(pad for pad in pads if pad.pads > 0 and not pad.flyover)
    if not usable:
        raise InputError("there are no pads", field="--pads", remedy="give stations with one pad or more")
    return Prepared(document, tuple(flown_by), len(flown_by) == 1, usable, notes, tuple(left_out))


def _whole(mission: Mission, families: Sequence[Family], options: RechargeOptions) -> tuple[Mission, tuple[str, ...]]:
    """Add the missing items of a mission from the ground to the ground, and the height of its home if the terrain is known."""
    notes: list[str] = []
    home, over = mission.home, options.transit.over
    if home is not None and home.altitude_m is None and over is not None:
        ground = float(over.terrain.ground_m(np.array([home.point.lat]), np.array([home.point.lon]))[0])
        if math.isfinite(ground):
            mission = replace(mission, home=replace(home, altitude_m=round(ground, 2)))
            notes.append(f"home is {height_text(ground)} above the sea by the terrain model")
    route = fly(mission, autopilot=families[0], laps=options.laps)
    flown = [item for item in mission.items if item.is_flown_to or item.command in TAKEOFF_COMMANDS]
    steps = route.steps
    takes_off_m = None
    if flown and steps and flown[0].command not in TAKEOFF_COMMANDS and not math.isnan(steps[0].height_m):
        takes_off_m = max(steps[0].height_m, LOW_TAKEOFF_M)
    lands = not route.legs or route.legs[-1].landing != "none"
    mission, added = completed(mission, lands=lands, takes_off_m=takes_off_m)
    if mission.hover_speed_mps is None:
        notes.append("the mission sets no speed: assuming 5 m/s until it does")
    if open_holds := sum(leg.ground_hold_s is None for leg in route.legs[:-1]):
        landings = counted(open_holds, "landing")
        notes.append(
            f"{landings} on the way without the time of a hold: a full battery is assumed after each, and no time to charge it"
        )
    return mission, (*added, *notes)


def _added(number: int, document: MissionDocument, given: int) -> str:
    """Return the name of an item in brackets if its number is not that of the file; `given` is the number of items of the file."""
    items = document.mission.items
    return "" if len(items) == given or number >= len(items) else f" ({items[number].name}; what was added is counted)"


def _that_fly(
    document: MissionDocument, families: Sequence[Family], options: RechargeOptions, given: int
) -> tuple[list[Family], list[str]]:
    """Return the autopilots that fly a mission apart from its battery, and the notes on the others; `given` is the number of items before completion.

    An `InputError` gives the reason if none does.
    """
    fit: list[Family] = []
    faults: list[Fault] = []
    never: dict[str, None] = {}
    for family in families:
        route = fly(document.mission, autopilot=family, laps=options.laps)
        if route.is_cut:
            raise too_many_repeats()
        found = [
            *check_structure(document, route),
            *check_fence(document, route, family),
            *family.cannot_fly(document),
        ]
        errors = [one for one in found if one.severity == "error" and not _of_the_whole(one, document)]
        never |= {f"item {one.item}: {one.message}": None for one in found if one.code == "never-reached"}
        if not errors:
            fit.append(family)
            continue
        where = "" if errors[0].item is None else f"item {errors[0].item}{_added(errors[0].item, document, given)}: "
        faults.append(Fault(f"no missions for {family.name}: {where}{errors[0].message}", remedy=errors[0].remedy))
    if not fit:
        problems = {fault.problem.partition(": ")[2]: fault for fault in faults}
        if len(problems) == 1:
            problem, fault = next(iter(problems.items()))
            names = " and ".join(family.name for family in families)
            raise InputError(f"no missions for {names}: {problem}", remedy=fault.remedy)
        raise InputError(faults)
    return fit, [*never, *(fault.problem for fault in faults)]


def _of_the_whole(error: Finding, document: MissionDocument) -> bool:
    """Whether a fault of a mission does not apply to its flights: begin and end, and marks of jumps, which are unrolled."""
    if error.code in _OF_THE_WHOLE:
        return True
    refused = error.item is not None and error.code.endswith("unsupported-command")
    return refused and role_of(document.mission.items[error.item or 0]) == "mark"
