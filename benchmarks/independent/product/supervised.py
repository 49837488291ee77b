"""What `fly` does, in terms of the world: the product's online policy on the ground and in the air, and its habits at a pad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.independent.information import Leave, Policy
from benchmarks.independent.product.in_air import InAir
from skyway.planner.online.information import Information

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

    def __init__(self, planned: Planned) -> None:
        self.start = planned.problem()
        self.plan = planned.result.composition
        self.in_air = InAir(self.start)
        self._stay: dict[int, _Stay] = {}
        self._plan: dict[int, Composition] = {}
        self._diverts: dict[int, tuple[str, ...]] = {}

    def forget(self) -> None:
        """Drop what was noted of deliveries before."""
        self.in_air.forget()
        self._stay.clear()
        self._plan.clear()
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
            self._plan[seen.run] = decision.composition
        self._diverts[seen.run] = decision.diverts
        if decision.charge_to is not None and decision.charge_to > seen.told + DONE:
            self._stay[seen.run] = _Stay(seen.node, decision.charge_to, seen.time_s, seen.told)
            return _charge(self._stay[seen.run])
        departure = decision.departure
        if decision.action == "wait" or departure is None or not departure.segments:
            return Leave((), look_s=max(decision.until_s or 0.0, seen.time_s + 10.0))
        return Leave(departure.segments)

    def _decide(self, seen: Seen) -> Decision:
        air, network = self.in_air, self.start.network
        ids = [one.id for one in network.stations]
        visited = {ids[node] for one in seen.flights for node in (one.origin, one.end)}
        forecast = air.forecast(seen.run, seen.reports)
        plan = self._plan.get(seen.run, self.plan)
        in_force = bool(plan.services) and plan.services[0].origin == seen.station
        info = Information(
            time_s=seen.time_s,
            soc=seen.told,
            forecast=air.forecast(seen.run, seen.reports, by_hour=True),
            near_forecast=forecast,
            belief=air.belief(seen.flights),
            roughness=air.roughness(seen.run),
            station=seen.station,
            visited=frozenset(visited),
            left=frozenset(visited - {seen.station}),
            busy_pads={one.id: seen.line(node) for node, one in enumerate(network.stations) if one.pads},
            behind=seen.behind,
            plan=plan if in_force else None,
        )
        return air.policy.on_ground(info, tell=True)

    def aloft(self, seen: Aloft) -> int | None:
        """Where `fly` would turn to: stations inside its fence."""
        network = self.start.network
        via = [int(network.head[one]) for one in seen.segments[:-1]]
        diverts = [network.index[one] for one in self._diverts.get(seen.run, ())]
        return self.in_air.turns(seen, tuple(dict.fromkeys((*diverts, seen.origin, *via))))


def _charge(stay: _Stay) -> Leave:
    """Nothing before the charge is reached; the segment is never flown: it is asked again then."""
    return Leave((0,), stay.charge_to, look_s=stay.since_s + REDECIDE_S)
