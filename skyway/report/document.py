"""The document ``skyway.flight/1``: what was planned and what happened, from the journal of a flight.

Every figure is the journal's, or is computed from its figures; what it does not tell is None. All of it is computed here;
pages, maps and charts only show it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from msgspec.structs import replace

from skyway.link.supervisor.journal import entries
from skyway.link.supervisor.journal import fields as of
from skyway.report.flight_report import (
    Decision,
    Delivery,
    Event,
    FlightReport,
    FlownLeg,
    PlanInForce,
    Planned,
    PlannedLeg,
    PlannedTimes,
    Preflight,
    Result,
    Scenario,
    Station,
    Stop,
    Times,
    Totals,
)
from skyway.report.heights import planned_heights
from skyway.report.seen import aircraft_seen, radios_seen, remote_id_seen
from skyway.report.series import Columns, LegWind, Series, series_of, wind_errors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.link.supervisor.journal.entry import Entry
    from skyway.link.supervisor.journal.file import Record

E = TypeVar("E", bound="Entry")
SCHEMA = "skyway.flight/1"
END_WORDS = ("delivered", "stopped-safe", "landed-elsewhere", "crashed", "left-to-itself")
_QUIET = frozenset({"track", "truth"})
_MAX_ROWS = 20_000
_LANDING_S = 15.0


def flight_report(records: tuple[Record, ...], plan: dict[str, Any] | None = None) -> FlightReport:
    """Return what was planned, by a composition or that which the journal begins with, and what happened."""
    start = entries.Start.read(records[0].data)
    planned = plan or start.composition
    series = series_of(records)
    legs, outcome = _legs(records, series), _outcome(records, start)
    stops = _stops(records, start, outcome)
    decisions = [
        Decision(
            time_s=at_s, flight=record.flight, state=record.state, action=entry.action, where=entry.where,
            reason=record.reason, new_plan=entry.new_plan, figures=entry.numbers(),
        )
        for at_s, record, entry in _of(records, entries.Decided)
    ]  # fmt: skip
    return FlightReport(
        schema=SCHEMA,
        delivery=_delivery(records, start, planned),
        outcome=outcome,
        planned=_planned(planned),
        totals=_totals(records, planned, legs, stops),
        legs=legs,
        stops=stops,
        decisions=decisions,
        plans=_plans(records),
        preflights=[
            Preflight(time_s=at_s, flight=record.flight, reason=record.reason, checks=entry.checks)
            for at_s, record, entry in _of(records, entries.ListDone)
        ],
        contingencies=_contingencies(records),
        events=[_event(at_s, one) for at_s, one in of.timed(records) if one.event not in _QUIET][:_MAX_ROWS],
        series=series,
        radios=radios_seen(records),
        aircraft=aircraft_seen(records),
        remote_id=remote_id_seen(records),
    )


def _of(records: tuple[Record, ...], kind: type[E]) -> Iterator[tuple[float, Record, E]]:
    """Go through the records of a kind that have an instant."""
    for at_s, record in of.timed(records):
        entry = record.entry(kind)
        if entry is not None:
            yield at_s, record, entry


def _delivery(records: tuple[Record, ...], start: entries.Start, planned: dict[str, Any]) -> Delivery:
    met = next((record for record in records if record.event == entries.Met.event()), None)
    scenario = of.table(planned, "scenario")
    return Delivery(
        origin=of.text(planned, "from"),
        destination=of.text(planned, "to"),
        drone=of.text(planned, "drone"),
        drone_name=of.text(of.table(planned, "drone_parameters"), "name"),
        vehicle=None if met is None else met.reason,
        autopilot=None if met is None else of.text(met.data, "autopilot"),
        payload_kg=of.number(planned, "payload_kg"),
        reserve_soc=start.reserve_soc,
        planner=start.planner,
        supervised=start.supervised,
        asking=start.asking,
        forecast=start.forecast,
        scenario=Scenario(path=of.text(scenario, "path"), sha256=of.text(scenario, "sha256")),
        hands_over=start.delivers,
    )


def _outcome(records: tuple[Record, ...], start: entries.Start) -> Result:
    last = records[-1]
    end = last.entry(entries.Ended)
    state = (None if end is None else end.outcome) or last.state
    proof, why = _proof(records)
    handed_over = _handed_over_s(records) is not None and proof != "not delivered"
    arrived = end is not None and (state in {"delivered", "done"} or handed_over)
    return Result(
        ended=end is not None,
        state=state,
        arrived=arrived,
        delivered=arrived and start.delivers,
        reason=_reason(records, ended=end is not None),
        station=_last_station(records) if end is None else end.station,
        time=last.time,
        flights=max((record.flight for record in records), default=0),
        resumed=sum(1 for r in records if (entry := r.entry(entries.Resumed)) is not None and entry.last is not None),
        proof=proof,
        proof_reason=why,
    )


def _handed_over_s(records: tuple[Record, ...]) -> float | None:
    """When the drone went on after the package had been delivered; None where it did not."""
    return next((at_s for at_s, _, entry in _of(records, entries.WentOn) if entry.delivered), None)


def _parts(planned: dict[str, Any]) -> list[dict[str, Any]]:
    """The delivery, and the way back where there is one."""
    back = of.table(of.table(planned, "return"), "plan")
    return [planned, back] if back else [planned]


def _sum(planned: dict[str, Any], name: str) -> float | None:
    known = [one for part in _parts(planned) if (one := of.number(part, name)) is not None]
    return sum(known) if known else None


def _proof(records: tuple[Record, ...]) -> tuple[str | None, str | None]:
    """Return the last verdict on the package, and its reason."""
    for record in reversed(records):
        told = record.entry(entries.Proved)
        if told is not None and told.verdict is not None:
            return told.verdict, (record.reason or "").removeprefix(f"proof of delivery: {told.verdict}: ") or None
    return None, None


def _reason(records: tuple[Record, ...], *, ended: bool) -> str | None:
    """Why it ended: the last sentence; where it has not ended, the last thing that happened."""
    if ended and records[-1].reason:
        return records[-1].reason
    return next((r.reason for r in reversed(records) if r.reason and r.event not in _QUIET), None)


def _last_station(records: tuple[Record, ...]) -> str | None:
    """Where it stood last; None where it has taken off since."""
    for record in reversed(records):
        if record.event == entries.LegBegun.event():
            return None
        if (entry := record.entry(entries.Landed) or record.entry(entries.PlanTaken)) is not None:
            return entry.standing.station
    return None


def _planned(planned: dict[str, Any]) -> Planned:
    """Return the plan: legs, stops and stations, as numbers or None."""
    legs = [
        PlannedLeg(
            origin=of.text(leg, "from"), destination=of.text(leg, "to"), via=of.words(leg, "via"),
            depart_s=of.instant_s(leg.get("depart")), arrive_s=of.instant_s(leg.get("arrive")),
            flight_s=of.number(leg, "flight_time_s"), distance_m=of.number(leg, "distance_m"),
            soc_depart=of.share(leg, "soc_depart"), soc_arrive=of.share(leg, "soc_arrive"),
            ground_speed_mps=of.number(leg, "ground_speed_mps"), p_reserve=of.share(leg, "p_reserve"),
            heights=planned_heights(leg),
        )
        for part in _parts(planned)
        for leg in of.tables(part, "legs")
    ]  # fmt: skip
    stops = [
        Stop(
            station=of.text(stop, "station"), arrive_s=of.instant_s(stop.get("arrive")),
            leave_s=of.instant_s(stop.get("leave")), wait_s=of.number(stop, "wait_s"),
            charge_s=of.number(stop, "recharge_s"), soc_from=of.share(stop, "soc_from"),
            soc_to=of.share(stop, "soc_to"),
        )
        for part in _parts(planned)
        for stop in of.tables(part, "stops")
    ]  # fmt: skip
    stations = {}
    places = {name: place for part in _parts(planned) for name, place in of.table(part, "stations").items()}
    for name, station in places.items():
        if isinstance(station, dict) and (at := of.place(station.get("lat"), station.get("lon"))) is not None:
            stations[str(name)[: of.LONGEST]] = Station(*at, of.text(station, "name"))
    return Planned(
        legs=legs,
        stops=stops,
        stations=stations,
        cruise_height_m=of.number(planned, "cruise_height_m"),
        climb_rate_mps=of.number(planned, "climb_rate_mps"),
        descent_rate_mps=of.number(planned, "descent_rate_mps"),
        airspeed_mps=of.number(planned, "airspeed_mps"),
    )


def _totals(records: tuple[Record, ...], planned: dict[str, Any], legs: list[FlownLeg], stops: list[Stop]) -> Totals:
    """Return times and charges of the whole, planned and actual."""
    last_s = _handed_over_s(records) or of.instant_s(records[-1].time)
    took_off = legs[0].depart_s if legs else None
    flown = [leg.flight_s for leg in legs if leg.flight_s is not None]
    arrival = of.table(planned, "arrival")
    landings = {of.text(stop, "station") for stop in of.tables(planned, "stops") if "station" in stop}
    back = [leg for part in _parts(planned)[1:] for leg in of.tables(part, "legs")]
    return Totals(
        planned=PlannedTimes(
            depart_s=of.instant_s(planned.get("depart")),
            delivery_s=of.number(planned, "delivery_time_s"),
            flight_s=_sum(planned, "flight_time_s"),
            wait_s=_sum(planned, "wait_time_s"),
            charge_s=_sum(planned, "recharge_time_s"),
            lowest_soc=min(
                (soc for part in _parts(planned) if (soc := of.share(part, "min_soc")) is not None), default=None
            ),
            flights=len(landings) + 1 + len(back) if of.tables(planned, "legs") else None,
            arrive_mean_s=of.instant_s(arrival.get("mean")),
            arrive_p50_s=of.instant_s(arrival.get("p50")),
            arrive_p95_s=of.instant_s(arrival.get("p95")),
            runs=of.integer(arrival, "runs"),
        ),
        actual=Times(
            depart_s=took_off,
            delivery_s=None if took_off is None or last_s is None else last_s - took_off,
            flight_s=sum(flown) if flown else None,
            wait_s=sum(stop.wait_s or 0.0 for stop in stops),
            charge_s=sum(stop.charge_s or 0.0 for stop in stops),
            lowest_soc=min((leg.soc_land for leg in legs if leg.soc_land is not None), default=None),
            flights=len(legs),
        ),
    )


def _legs(records: tuple[Record, ...], series: Series) -> list[FlownLeg]:
    """Return the flights."""
    legs: list[FlownLeg] = []
    for at_s, record in of.timed(records):
        if begun := record.entry(entries.LegBegun):
            legs.append(_leg_begun(at_s, record, begun))
        elif not legs:
            continue
        elif (landed := record.entry(entries.Landed)) and legs[-1].land_s is None:
            legs[-1] = replace(
                legs[-1], land_s=at_s, landed_at=landed.standing.station, as_planned=landed.planned,
                flight_s=landed.flight_s, soc_land=landed.soc,
            )  # fmt: skip
        elif (learnt := record.entry(entries.EnergyLearnt)) and legs[-1].flight == record.flight:
            legs[-1] = replace(legs[-1], used_soc=learnt.used_soc, modelled_soc=learnt.modelled_soc)
    return [
        replace(
            leg, wind=wind_errors(series, leg.wind, leg.depart_s, leg.land_s),
            most_cross_track_m=_largest(series.track, "cross_track_m", leg.depart_s, leg.land_s),
        )
        for leg in legs
    ]  # fmt: skip


def _leg_begun(at_s: float, record: Record, entry: entries.LegBegun) -> FlownLeg:
    return FlownLeg(
        flight=record.flight,
        origin=entry.origin,
        destination=entry.destination,
        via=entry.via,
        depart_s=at_s,
        planned_s=entry.planned_s,
        soc_depart=entry.soc,
        planned_soc=entry.planned_soc,
        diverts=entry.standing.diverts,
        ground_speed_mps=entry.ground_speed_mps,
        way=entry.way,
        wind=LegWind.expected(entry.wind.words(), entry.wind_origin),
    )


def _largest(track: Columns, name: str, begin_s: float, end_s: float | None) -> float | None:
    found = [
        value
        for at_s, value in zip(track["time_s"], track[name], strict=True)
        if value is not None and begin_s <= at_s and (end_s is None or at_s <= end_s)
    ]
    return max(found, default=None)


def _stops(records: tuple[Record, ...], start: entries.Start, outcome: Result) -> list[Stop]:
    """Return the times on the ground.

    The start is one where it waited or charged; the customer is none where it was delivered.
    """
    times = [at_s for at_s, _ in of.timed(records)]
    if not times:
        return []
    stops = [Stop(station=of.text(start.composition, "from"), arrive_s=times[0], soc_from=None)]
    entered: tuple[float, str] | None = None
    for at_s, record in of.timed(records):
        stands = stops[-1].leave_s is None
        if landed := record.entry(entries.Landed):
            stops.append(Stop(station=landed.standing.station, arrive_s=at_s, soc_from=landed.soc))
        elif (begun := record.entry(entries.LegBegun)) and stands:
            stops[-1] = replace(stops[-1], leave_s=at_s, soc_to=begun.soc)
        elif record.event == entries.StateEntered.event():
            if stands:
                stops[-1] = _counted(stops[-1], entered, at_s)
            entered = (at_s, record.state)
        elif stands and stops[-1].soc_from is None and (point := record.entry(entries.Tracked)):
            stops[-1] = replace(stops[-1], soc_from=point.soc)
    if stops[-1].leave_s is None:
        stops[-1] = _counted(stops[-1], entered, times[-1])
        if len(stops) > 1 and outcome.arrived:
            stops.pop()
    return stops if (stops[0].wait_s or 0.0) + (stops[0].charge_s or 0.0) > 0.0 else stops[1:]


def _counted(stop: Stop, entered: tuple[float, str] | None, until_s: float) -> Stop:
    """Add the time in a state to the stop it was spent at."""
    if entered is None:
        return stop
    spent_s = max(until_s - max(entered[0], stop.arrive_s or 0.0), 0.0)
    if entered[1] == "waiting-for-pad":
        return replace(stop, wait_s=(stop.wait_s or 0.0) + spent_s)
    return replace(stop, charge_s=(stop.charge_s or 0.0) + spent_s) if entered[1] == "charging" else stop


def _plans(records: tuple[Record, ...]) -> list[PlanInForce]:
    """Return the plans that came into force."""
    found = []
    for at_s, record, entry in _of(records, entries.PlanTaken):
        legs = of.tables(entry.plan or {}, "legs")
        route = [of.text(legs[0], "from") or "unknown"] if legs else []
        for leg in legs:
            route += [f"({name})" for name in of.words(leg, "via")] + [of.text(leg, "to") or "unknown"]
        found.append(PlanInForce(time_s=at_s, reason=record.reason, route=route))
    return found


def _contingencies(records: tuple[Record, ...]) -> list[Event]:
    """Return what was not meant to happen: diverts, lost links, foreign commands, reboots, resumes."""
    found = []
    landings = [at_s for at_s, record in of.timed(records) if record.event == entries.Landed.event()]
    for at_s, record in of.timed(records):
        event, changed = record.event, record.entry(entries.Changed)
        foreign = changed is not None and changed.ours is False
        if (
            changed is not None
            and foreign
            and changed.after == "disarmed"
            and any(abs(at_s - t) <= _LANDING_S for t in landings)
        ):
            continue  # an autopilot disarms itself when it has landed
        decided, entered = record.entry(entries.Decided), record.entry(entries.StateEntered)
        turned = decided is not None and decided.action in ("divert", "land", "stop")
        apart = entered is not None and entered.after in ("lost-link", "holding", "diverting", *END_WORDS[1:])
        if foreign or turned or apart or event in ("turn", "reboot", "link", "resume"):
            found.append(_event(at_s, record))
    return found[:_MAX_ROWS]


def _event(at_s: float, record: Record) -> Event:
    return Event(
        n=record.n, time_s=at_s, state=record.state, event=record.event, flight=record.flight, reason=record.reason
    )  # fmt: skip
