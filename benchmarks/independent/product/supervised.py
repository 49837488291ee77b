"""What `fly` does, in terms of the world: the product's online policy on the ground and in the air, and its habits at a pad."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from benchmarks.independent.information import Leave, Policy
from benchmarks.independent.product.in_air import InAir
from skyway.planner.online.information import Departure, Information
from skyway.planner.online.told_plan import segments_of

if TYPE_CHECKING:
    from benchmarks.independent.information import Aloft, Seen
    from benchmarks.independent.product.planning import Planned
    from skyway.models.composition.composition import Composition
    from skyway.planner.online.information import Decision

WAIT_S = 300.0
REDECIDE_S = 600.0
"""Who waits for a pad thinks again after so long; who charges does so when it has charged."""
DONE = 1e-6


@dataclass
class _Stay:
    """What was decided at a stop."""

    node: int
    charge_to: float
    since_s: float
    told: float


class Supervised(Policy):
    """`planner.online.policy.OnlinePolicy` as `link.supervisor` consults it: it decides all along the way, not over stations."""

    watches = True

    def __init__(self, planned: Planned, *, thriftily: bool = False) -> None:
        self.start = planned.problem(thriftily=thriftily)
        self.plan = planned.result.composition
        self.in_air = InAir(self.start)
        self._stay: dict[int, _Stay] = {}
        self._plan: dict[int, tuple[Composition | None, int]] = {}
        """In force, and how many flights had been flown when it was."""
        self.told: dict[int, list[tuple[float, float, float]]] = {}
        """Of each run: when an arrival was told, by when half of the deliveries arrive, and 95 %; POSIX seconds."""
        self._diverts: dict[int, tuple[str, ...]] = {}

    def forget(self) -> None:
        """Drop what was noted of deliveries before."""
        self.in_air.forget()
        self._stay.clear()
        self._plan.clear()
        self.told.clear()
        self._diverts.clear()

    def leave(self, seen: Seen) -> Leave | None:
        """Charge as was decided; then decide again."""
        stay = self._stay.get(seen.run)
        if stay is not None and stay.node == seen.node and seen.told < stay.charge_to - DONE:
            charging = seen.told > stay.told + DONE
            if charging or seen.time_s < stay.since_s + REDECIDE_S - DONE:
                return _charge(stay)
        self._stay.pop(seen.run, None)
        if not seen.reports:
            return Leave((), look_s=seen.time_s + WAIT_S)
        decision = self._decide(seen)
        if decision.action == "stop":
            return None
        if decision.composition is not None:
            self._plan[seen.run] = decision.composition, len(seen.flights)
            arrival = decision.composition.arrival
            if arrival.p50 is not None and arrival.p95 is not None:
                told = seen.time_s, arrival.p50.timestamp(), arrival.p95.timestamp()
                self.told.setdefault(seen.run, []).append(told)
        self._diverts[seen.run] = decision.diverts
        if decision.charge_to is not None and decision.charge_to > seen.told + DONE:
            self._stay[seen.run] = _Stay(seen.node, decision.charge_to, seen.time_s, seen.told)
            return _charge(self._stay[seen.run])
        departure = decision.departure
        if decision.action == "wait" or departure is None or not departure.segments:
            return Leave((), look_s=max(decision.until_s or 0.0, seen.time_s + 10.0))
        return Leave(departure.segments)

    def _decide(self, seen: Seen) -> Decision:
        return self.in_air.policy.on_ground(self._information(seen), tell=True)

    def _information(self, seen: Seen) -> Information:
        """What `fly` knows at a stop."""
        air, network = self.in_air, self.start.network
        ids = [one.id for one in network.stations]
        plan, flown = self._plan.get(seen.run, (self.plan, 0))
        for flight in seen.flights[flown:]:
            plan = None if plan is None else plan.after(ids[flight.end])
        visited = {ids[node] for one in seen.flights for node in (one.origin, one.end)}
        return Information(
            time_s=seen.time_s,
            soc=seen.told,
            forecast=air.forecast(seen.run, seen.reports, by_hour=True),
            near_forecast=air.forecast(seen.run, seen.reports),
            belief=air.belief(seen.flights),
            roughness=air.roughness(seen.run),
            station=seen.station,
            visited=frozenset(visited),
            left=frozenset(visited - {seen.station}),
            busy_pads={one.id: seen.line(node) for node, one in enumerate(network.stations) if one.pads},
            behind=seen.behind,
            plan=plan,
        )

    def aloft(self, seen: Aloft) -> int | None:
        """Where `fly` would turn to: stations inside its fence."""
        network = self.start.network
        via = [int(network.head[one]) for one in seen.segments[:-1]]
        diverts = [network.index[one] for one in self._diverts.get(seen.run, ())]
        return self.in_air.turns(seen, tuple(dict.fromkeys((*diverts, seen.origin, *via))))


class Kept(Supervised):
    """What `fly` does at a stop under a plan that is kept, as under that of a fleet: the gate of a departure raises its charge, or lets it wait.

    Where no charge allows the leg, `fly` stops; here it is asked again after ten minutes.
    """

    def leave(self, seen: Seen) -> Leave | None:
        """As `Supervised`, but that it never gives up."""
        return super().leave(seen) or Leave((), look_s=seen.time_s + REDECIDE_S)

    def _decide(self, seen: Seen) -> Decision:
        info = self._information(seen)
        decision, departure = self.in_air.policy.keep_to_plan(info), None
        if decision.action == "continue" and info.plan is not None:
            service = info.plan.services[0]
            way = segments_of(self.start.network, [service.origin, *service.via, service.destination])
            departure = Departure(way, seen.told, lambda _: 0.0)
        return replace(decision, composition=None, departure=departure)


def _charge(stay: _Stay) -> Leave:
    """Nothing before the charge is reached; the segment is never flown: it is asked again then."""
    return Leave((0,), stay.charge_to, look_s=stay.since_s + REDECIDE_S)
