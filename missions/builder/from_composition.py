"""Missions from compositions, per leg or as a whole."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.missions.builder.leg_builder import LegBuilder
from skyway.missions.builder.mission_options import MissionOptions
from skyway.missions.builder.recharge_holds import hold_notes, recharge_hold
from skyway.missions.items.document import MissionDocument
from skyway.models.base.errors import Fault, InputError
from skyway.models.composition.release import hovers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.mission import MissionItem
    from skyway.missions.items.parameters import Parameter
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService


@dataclass(frozen=True, slots=True)
class Export:
    """Missions with all information that is required to fly them.

    Attributes
    ----------
    documents : tuple of MissionDocument
        In flying order; more than one where each leg is a separate mission.
    parameters : tuple of Parameter
        Required settings of the vehicle.
    warnings : tuple of str
        Warnings for the operator.
    notes : tuple of str
        Actions on the ground between the legs: how long to wait and charge, and to which state of charge.
    """

    documents: tuple[MissionDocument, ...]
    parameters: tuple[Parameter, ...]
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def leg_mission(composition: Composition, index: int, dialect: Family, options: MissionOptions | None = None) -> Export:
    """Return the mission of one leg, as `fly` uploads it before each take-off.

    TAKEOFF, climb, speed item, waypoints, approach, LAND; the last leg of the delivery releases the package and disarms. Heights
    are above the ground at the take-off of the leg, since home moves there at arming. Legs of the way back follow those of the delivery.

    Parameters
    ----------
    composition : Composition
        The plan.
    index : int
        Of `Composition.there_and_back`, from 0; people see the number of a leg, from 1.
    dialect : Family
        The autopilot family.
    options : MissionOptions, optional
        Options of the mission.

    Raises
    ------
    InputError
        No such leg, or a required ground height is unknown.
    """
    delivers, composition = len(composition.services) - 1, composition.there_and_back
    legs = len(composition.services)
    if not 0 <= index < legs:
        raise InputError(Fault("no such leg", field="index", value=index, remedy=f"an index from 0 to {legs - 1}"))
    build = LegBuilder(composition, dialect, options or MissionOptions())
    if index == delivers + 1 and hovers(build.options.release):
        remedy = f"leg {delivers + 1} of the plan, which flies both"
        raise InputError(Fault("the drone does not land before this leg", field="leg", value=index + 1, remedy=remedy))
    service = composition.services[index]
    onward = composition.services[index + 1] if index == delivers and index + 1 < legs else None
    flown = build.flown_together(service, onward, last=index == delivers)
    build.check_elevations(flown)
    document = build.leg(service, last=index == delivers, onward=onward)
    parameters = dialect.parameters(build.needs(flown, document))
    return Export((document,), parameters, build.warnings(flown), hold_notes(composition, (index,)))


def whole_mission(composition: Composition, dialect: Family, options: MissionOptions | None = None) -> Export:
    """Return all legs for a plain ground station, disarmed on every pad.

    If the autopilot stays in its mission after a landing that disarms (PX4), that is one mission: LAND, disarm, and
    a WAYPOINT straight above that arming resumes. If it does not (ArduPilot), it is one mission per leg. Heights are
    above the home of each leg, since home moves at each arming. With the way back: from the target on, too, where the package is
    released, the vehicle disarms, and arming resumes. Raises an `InputError` if a required ground height is unknown.
    """
    if not dialect.stays_in_mission_after_landing:
        return _mission_per_leg(composition, dialect, options)
    begins = takes_off(composition, options)
    delivers, composition = len(composition.services) - 1, composition.there_and_back
    build = LegBuilder(composition, dialect, options or MissionOptions())
    services = composition.services
    build.check_elevations(services)
    items = build.departure(services[0], build.ground_m(services[0].origin))
    in_air = hovers(build.options.release)
    ground = build.ground_m(services[0].origin)
    for number, service in enumerate(services):
        if in_air and number == delivers + 1:
            items += dialect.disarm()
            continue  # flown with the leg before
        ground = build.ground_m(service.origin)
        if number > 0:
            items.append(build.above(service, ground))
        items += build.way(service, ground)
        if number == delivers:
            items = build.delivered(items, service.destination, ground, _following(services, number))
        else:
            items += dialect.disarm()
    export = _one_document(build, items, min(build.ground_m(service.origin) for service in services))
    return replace(export, notes=hold_notes(composition, begins))


def _following(services: Sequence[DroneService], number: int) -> DroneService | None:
    return services[number + 1] if number + 1 < len(services) else None


def takes_off(composition: Composition, options: MissionOptions | None = None) -> tuple[int, ...]:
    """Return the indices of the legs that begin with a take-off: all but that from a target where it does not land."""
    delivers = len(composition.services) - 1
    in_air = hovers((options or MissionOptions()).release)
    return tuple(n for n in range(len(composition.there_and_back.services)) if not (in_air and n == delivers + 1))


def armed_mission(composition: Composition, dialect: Family, options: MissionOptions | None = None) -> Export:
    """Return all legs in one mission that stays armed on the pads and takes off by the clock.

    LAND, NAV_DELAY of wait and recharge, and take-off; heights are above the first home throughout. With the way back it stays armed
    at the target, too, for the time that is planned there. Raises an `InputError` if a required ground height is unknown.
    """
    begins = takes_off(composition, options)
    delivers, composition = len(composition.services) - 1, composition.there_and_back
    build = LegBuilder(composition, dialect, options or MissionOptions())
    services = composition.services
    build.check_elevations(services)
    ground = build.ground_m(services[0].origin)
    items = build.departure(services[0], ground)
    in_air = hovers(build.options.release)
    for number, service in enumerate(services):
        last = number == len(services) - 1
        if in_air and number == delivers + 1:
            items += dialect.disarm() if last else ()
            continue  # flown with the leg before
        if number > 0:
            items += [recharge_hold(composition, number), *dialect.leave_armed_hold(build.above(service, ground))]
        items += build.way(service, ground)
        if number == delivers and in_air:
            items = build.delivered(items, service.destination, ground, _following(services, number))
        elif number == delivers:
            items += build.release() if not last else build.delivery()
        elif last:
            items += dialect.disarm()
    export = _one_document(build, items, ground)
    pads = ", ".join(services[number].origin for number in begins[1:])
    if not pads:
        return export
    warning = (
        f"the vehicle stays ARMED at {pads}, with propellers turning beside people for the whole hold, and takes off by the"
        " clock at any state of charge"
    )
    return replace(export, warnings=(warning, *export.warnings))


def _one_document(build: LegBuilder, items: Sequence[MissionItem], lowest_home_m: float) -> Export:
    services = build.composition.services
    document = MissionDocument(
        build.mission(items, build.home(services[0].origin)),
        build.fence(services),
        build.rally(services, lowest_home_m),
    )
    parameters = build.dialect.parameters(build.needs(services, document))
    return Export((document,), parameters, build.warnings(services))


def _mission_per_leg(composition: Composition, dialect: Family, options: MissionOptions | None) -> Export:
    services = composition.there_and_back.services
    build = LegBuilder(composition.there_and_back, dialect, options or MissionOptions())
    build.check_elevations(services)
    exports = [leg_mission(composition, index, dialect, options) for index in takes_off(composition, options)]
    strictest: dict[str, Parameter] = {}
    for parameter in (parameter for export in exports for parameter in export.parameters):
        known = strictest.get(parameter.name)
        if known is None or (parameter.value or 0.0) > (known.value or 0.0):
            strictest[parameter.name] = parameter
    return Export(
        tuple(document for export in exports for document in export.documents),
        tuple(strictest.values()),
        tuple(dict.fromkeys(warning for export in exports for warning in export.warnings)),
        tuple(note for export in exports for note in export.notes),
    )
