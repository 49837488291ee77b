"""Summary of a cut mission: ``skyway.recharge/1``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.units import J_PER_WH
from skyway.recharge.order.picture_audit import PictureAudit, kept_pictures

if TYPE_CHECKING:
    from skyway.missions.recharge.work import WorkPoint
    from skyway.planner.fixed_route.charging_stops import ChargingStop
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.order.ordering import OrderTold
    from skyway.recharge.problem import RechargeOptions
    from skyway.recharge.simulated import SimulatedFlights

SCHEMA = "skyway.recharge/1"


@dataclass(frozen=True, slots=True)
class LeftAt:
    """Point where the work is left: after an item, or on the way to it."""

    item: int
    """Number of the item in the given mission, completed as in `notes`."""
    command: str
    on_the_way: bool
    """True: on the way to the item, which is not reached yet."""
    lat: float
    lon: float


@dataclass(frozen=True, slots=True)
class Stay:
    """A stay on a pad, by the plan."""

    pad: str
    arrive_s: float
    """After the first take-off, as all instants."""
    wait_s: float
    charge_s: float
    """Or of changing the battery."""
    ground_s: float
    """Upload, checklist, arming."""
    soc_from: float
    soc_to: float
    leave_s: float


@dataclass(frozen=True, slots=True)
class FlightTold:
    """One flight of one battery, as its file is flown in the winds of its check."""

    number: int
    items: int
    depart_s: float
    flight_s: float
    distance_m: float
    energy_wh: float
    soc_start: float
    soc_end: float
    p_reserve: float
    left_at: LeftAt | None
    """None: the work is done."""
    stay: Stay | None
    """None: it ends here."""
    files: dict[str, str]


@dataclass(frozen=True, slots=True)
class RechargeSummary:
    """A cut mission: ``skyway.recharge/1``."""

    schema: str
    mission: str
    drone: str
    reserve_soc: float
    epsilon: float
    pictures: PictureAudit
    """Those on the way, and those commanded by items: of the mission, and of the written flights."""
    work_s: float
    """Time of the work without any stop."""
    end_s: float
    """By the plan, after the first take-off."""
    ends_s: tuple[float, float, float]
    """Of the simulated flights: mean, 5th and 95th percentile."""
    end_p50_s: float
    """Half of the simulated flights have ended by then; 95 % by the last of `ends_s`."""
    decided_on_the_way: tuple[str, ...]
    """Decisions that `skyway fly` makes in flight, and the assumption until then."""
    p_reserve: float
    """Probability that every landing keeps the reserve."""
    runs: int
    flights: tuple[FlightTold, ...]
    notes: tuple[str, ...]
    order: OrderTold | None = None
    """Of ``--reorder``; then items are those of `reordered.plan`, if any part was moved."""


def summary_of(found: Recharged, flown: SimulatedFlights, mission: str, files: dict[str, list[str]]) -> RechargeSummary:
    """Return the summary of a cut mission; `files` has the names by autopilot, one for each flight."""
    problem, plan = found.problem, found.plan
    conditions = problem.options.conditions
    cut_of = [cut for cut in found.cuts for _ in cut.pads]
    flights = []
    for number, flight in enumerate(found.told):
        stop = plan.stops[number] if number < len(plan.stops) else None
        legs = flight.report.legs
        stay = None
        if stop is not None:
            wait_s, charge_s, ground_s = phases_of(stop, problem.options)
            stay = Stay(
                problem.ways.pads[stop.pad].id,
                stop.arrive_s,
                wait_s,
                charge_s,
                ground_s,
                stop.soc_arrive,
                stop.soc_leave,
                stop.leave_s,
            )
        flights.append(
            FlightTold(
                number + 1,
                len(flight.document.mission.items),
                flight.depart_s,
                sum(leg.time_s or 0.0 for leg in legs),
                sum(leg.distance_m for leg in legs),
                sum(leg.energy_j or 0.0 for leg in legs) / J_PER_WH,
                flight.soc_start,
                legs[-1].soc_end if legs[-1].soc_end is not None else 0.0,
                legs[-1].p_reserve if legs[-1].p_reserve is not None else 0.0,
                None if stop is None else left_at(found, problem.work.points[cut_of[number].point]),
                stay,
                {name: of_family[number] for name, of_family in files.items()},
            )
        )
    return RechargeSummary(
        SCHEMA,
        mission,
        conditions.drone.name,
        conditions.reserve_soc,
        problem.options.epsilon,
        kept_pictures(found),
        float(problem.hops.work_s[0].sum()),
        plan.end_s,
        (flown.end_s, flown.end_early_s, flown.end_late_s),
        flown.end_p50_s,
        _decided(found),
        flown.p_reserve,
        flown.runs,
        tuple(flights),
        found.notes,
        found.order,
    )


def phases_of(stop: ChargingStop, options: RechargeOptions) -> tuple[float, float, float]:
    """Return the duration of a stop: wait for its pad, charge or change of the battery, and handling on the ground."""
    ends_s = max(stop.leave_s - options.ground_s, stop.arrive_s)
    begins_s = max(stop.on_pad_s, stop.arrive_s) if options.swap_s is None else ends_s - options.swap_s
    begins_s = min(max(begins_s, stop.arrive_s), ends_s)
    return begins_s - stop.arrive_s, ends_s - begins_s, stop.leave_s - ends_s


def _decided(found: Recharged) -> tuple[str, ...]:
    """Return in words what is undecided when the mission is cut: empty if there is no stop."""
    if not found.plan.stops:
        return ()
    charge = "that the battery is changed" if found.problem.options.swap_s is not None else "how long to charge"
    return (
        f"on every pad: where to leave the work next, for which pad, and {charge}, from the measured wind and energy",
        "in the air, every ten seconds: whether to leave the work earlier, because the landing would miss the reserve",
    )


def left_at(found: Recharged, point: WorkPoint) -> LeftAt:
    """Return the place where the work is left at a point."""
    work = found.problem.work
    number = work.steps[max(point.step, 0)].item
    return LeftAt(number, work.mission.items[number].name, point.share < 1.0, round(point.lat, 7), round(point.lon, 7))
