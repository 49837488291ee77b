"""One drone's view of a request: the arrays that planners work on."""

from __future__ import annotations

import math
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import S_PER_H
from skyway.models.flight.closures import parts_of_slots
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.heights import wind_factors
from skyway.models.flight.rules import SegmentWind, air_over
from skyway.models.queues.opening_hours import Closures, closed_path, opening_hours
from skyway.models.queues.waiting_times import TAIL_H
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.expected_waits import ExpectedWaits
from skyway.planner.problem.queue_samples import QueueSamples
from skyway.planner.problem.request_checks import check_request
from skyway.planner.problem.ways_on import return_node, undelivered_node, ways_on

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.network.network import Network
    from skyway.models.queues.paths import PackedPaths, QueuePath
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.scenario.tariff import Tariff
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.request import Request

HORIZON_H = 48
"""Horizon of wind and queues, hours from the departure; a delivery takes less."""
DAY_S = 86_400.0
NEVER_S = 1e12
"""A time, s, beyond all others; negated, before all others."""
MIN_EPSILON = 1e-6
"""Least epsilon: neither gusts nor the number of arrivals at a station are bounded."""
IN_FLIGHT = "in-flight"
"""Id of the node at the position of a drone in the air."""


class Problem:
    """A scenario, a request, a drone and a wind ensemble, made ready for planning.

    Attributes
    ----------
    network : Network
        With the position of a drone in flight added as a node.
    origin, destination : int
        Nodes.
    must_stop : tuple of int
        Nodes at which the drone must stop, in this order.
    depart_s, soc : float
        Start of the delivery (POSIX seconds), and charge at the start. For a drone in flight both are corrected for the
        climb that it no longer needs.
    ensemble, forecast : WindEnsemble
        Forecast used for planning, and the whole forecast if that is thinned (`thinned`).
    in_flight : bool
        The drone cannot wait, hold or charge at the origin.
    air : Air
        Segments and wind for kernels; ``probability``, shape (members,), goes with it.
    soc_per_s, soc_fixed : float
        A flight from take-off to touch-down of T seconds costs ``soc_fixed + soc_per_s * T``.
    longest_flight_s : float
        On a full battery, keeping the reserve.
    parameters : PlannerParameters
        Parameters of all planners.
    """

    def __init__(
        self,
        scenario: Scenario,
        request: Request,
        drone: Drone,
        ensemble: WindEnsemble,
        *,
        parameters: PlannerParameters = USUAL,
        waits: ExpectedWaits | None = None,
    ) -> None:
        self.parameters = parameters
        self.scenario = scenario
        self.request = request
        self.drone = drone
        self.rules = scenario.rules
        self.reserve = request.reserve_soc
        self.epsilon = max(request.epsilon, MIN_EPSILON)
        state = request.state
        check_request(scenario, request, drone)
        self.in_flight = state.position is not None
        self.depart_s = state.time.timestamp()
        self.soc = state.soc
        self.network: Network = scenario.network
        self.load = scenario.load
        if state.position is not None:
            self.network = self.network.with_target(*state.position, id=IN_FLIGHT)
            self.load = self.load.extended(len(self.network) - len(scenario.network))
            self.origin = len(self.network) - 1
        else:
            self.origin = self._node(state.station or "", "state.station")
        self.destination = self._node(request.destination, "destination")
        self.must_stop = tuple(self._stop(key) for key in request.stop_at)
        return_node(self), undelivered_node(self)  # refuses what is none
        slots = ensemble.start_s, ensemble.slot_s, ensemble.slots
        self.ensemble = self.forecast = ensemble = ensemble.in_shorter_slots(parts_of_slots(self.network, *slots))
        power = FlightPower.of(drone, request.payload_kg)
        self.air: SegmentWind = air_over(
            self.network, ensemble, drone, self.rules, airspeed_mps=request.airspeed_mps, power=power
        )
        self.probability = ensemble.probability
        self.soc_per_s, self.soc_fixed = self._flight_cost(request.payload_kg)
        if not (0.0 < self.soc_per_s < math.inf and math.isfinite(self.soc_fixed)):
            cost = self.soc_per_s, self.soc_fixed
            remedy = "a battery above 0 J and a power above 0 W"
            raise InputError(Fault("flies at no finite cost", field=f"drone {drone.id}", value=cost, remedy=remedy))
        self.longest_flight_s = (1.0 - self.reserve - self.soc_fixed) / self.soc_per_s
        if self.in_flight:
            self.depart_s -= self.rules.climb_s
            self.soc += FlightPower.of(drone, request.payload_kg).soc_climb(self.rules.climb_s)
        if waits is not None:
            self.__dict__["waits"] = waits  # they do not depend on the drone

    @cached_property
    def usual_errors(self) -> Errors:
        """Expected errors beyond the forecast: its gusts, if it contains any."""
        return USUAL_ERRORS.in_forecast(self.forecast, self.request.state.time.timestamp())

    def _node(self, identity: str, field: str) -> int:
        if identity not in self.network.index:
            raise InputError(Fault("no such station", field=field, value=identity))
        return self.network.index[identity]

    def _stop(self, identity: str) -> int:
        node = self._node(identity, "stop_at")
        if node in (self.origin, self.destination):
            raise InputError(Fault("is the start or the destination", field="stop_at", value=identity))
        if not self.has_pads(node):
            raise InputError(Fault("has no pads to stop at", field="stop_at", value=identity))
        return node

    def _flight_cost(self, payload_kg: float) -> tuple[float, float]:
        """SoC per second of flight, and what climb and descent cost beyond that rate."""
        power = FlightPower.of(self.drone, payload_kg)
        return power.soc_per_s, power.soc_fixed(self.rules.climb_s, self.rules.descent_s)

    def standing_at(self, node: int, time_s: float, soc: float, *, in_flight: bool = False) -> Problem:
        """Return the same problem from another node, time and charge.

        In flight it is over the node, with time and charge set back by a climb.
        """
        moved = copy(self)
        moved.origin, moved.depart_s, moved.soc, moved.in_flight = node, time_s, soc, in_flight
        return moved

    def with_energy(self, ratio: float) -> Problem:
        """Return the same problem for a vehicle whose flights take a multiple of the energy."""
        moved = copy(self)
        moved.soc_per_s, moved.soc_fixed = ratio * self.soc_per_s, ratio * self.soc_fixed
        moved.longest_flight_s = (1.0 - self.reserve - moved.soc_fixed) / moved.soc_per_s
        per_s, fixed = self.empty_cost
        moved.__dict__["empty_cost"] = ratio * per_s, ratio * fixed
        return moved

    def bound_for(self, node: int) -> Problem:
        """Return the same problem with another destination."""
        bound = copy(self)
        bound.destination = node
        for name in ("direct_air", "ways_on", "escapes", "onward_energies"):
            bound.__dict__.pop(name, None)
        return bound

    @cached_property
    def empty_cost(self) -> tuple[float, float]:
        """`soc_per_s` and `soc_fixed` once the package is delivered."""
        return self._flight_cost(0.0)

    @cached_property
    def curves(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Charging curve from empty (seconds, SoC) of each kind of pad in the network."""
        powers = self._pad_powers
        return [self.drone.charging_curve(power).piecewise() for power in dict.fromkeys(powers)]

    @cached_property
    def padded_curves(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`curves` as arrays for kernels, shape (kinds, points) each: padded by repeating the last point."""
        points = max(len(time) for time, _ in self.curves)
        padded = [[np.pad(part, (0, points - len(part)), mode="edge") for part in curve] for curve in self.curves]
        return np.array([time for time, _ in padded]), np.array([soc for _, soc in padded])

    @cached_property
    def _pad_powers(self) -> list[float | None]:
        return [station.recharge_power_w for station in self.network.stations]

    @cached_property
    def curve_of(self) -> NDArray[np.int64]:
        """Index into `curves` of each station, shape (nodes,)."""
        kinds = {power: number for number, power in enumerate(dict.fromkeys(self._pad_powers))}
        return np.array([kinds[power] for power in self._pad_powers], dtype=np.int64)

    def curve(self, node: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Charging curve of a station."""
        return self.curves[int(self.curve_of[node])]

    def charge_time_s(self, node: int, soc_from: float, soc_to: float) -> float:
        """Time on a pad of the station from one charge to a higher one; 0 where none is needed."""
        if soc_to <= soc_from:
            return 0.0
        time, soc = self.curve(node)
        return float(np.interp(min(soc_to, 1.0), soc, time) - np.interp(max(soc_from, 0.0), soc, time))

    def soc_after(self, node: int, soc: float, charging_s: float) -> float:
        """Return the charge after a time on a pad."""
        time, level = self.curve(node)
        return float(np.interp(np.interp(soc, level, time) + charging_s, time, level))

    @cached_property
    def tariff(self) -> Tariff | None:
        """Prices at the nodes; None where the scenario has no costs."""
        given = self.scenario.tariff
        return None if given is None else given.of_length(len(self.network))

    @property
    def counts_spending(self) -> bool:
        """Whether energy and cost of deliveries are computed."""
        return self.scenario.tariff is not None or self.request.objective.beside_time

    @cached_property
    def closures(self) -> dict[int, Closures]:
        """Closing times of stations with opening hours, from a day before the departure on, by node; none for those that never close."""
        begin_s, end_s = self.depart_s - DAY_S, self.depart_s + (HORIZON_H + TAIL_H) * S_PER_H
        found: dict[int, Closures] = {}
        for node, station in enumerate(self.network.stations):
            if station.open_hours and station.pads:
                closed_s = opening_hours(station.open_hours).closed_between(self.load.timezone, begin_s, end_s)
                found |= {node: Closures(closed_s)} if len(closed_s) else {}
        return found

    def while_open(self, node: int, path: QueuePath) -> QueuePath:
        """Return the queue of a station within its opening hours; at the target also from the earliest delivery on."""
        closures = self.closures.get(node)
        if closures is not None:
            path = closed_path(path, closures.closed_s, spots=self.network.stations[node].holding_spots)
        if node == self.awaiting and math.isfinite(self.earliest_s):
            path = closed_path(path, np.array([[-NEVER_S, self.earliest_s]]), spots=0)
        return path

    @cached_property
    def awaiting(self) -> int:
        """Node of the target that the request names, independent of a search's destination."""
        return self.network.index[self.request.destination]

    @property
    def earliest_s(self) -> float:
        """Earliest arrival of the package, POSIX seconds; -inf without a limit."""
        return -math.inf if self.request.not_before is None else self.request.not_before.timestamp()

    def no_landing(self, node: int) -> Closures | None:
        """Times without landings at a node: while it is closed and has no holding spots, and at the target before the earliest delivery."""
        closures = self.closures.get(node)
        closed_s = np.empty((0, 2))
        if closures is not None and not self.network.stations[node].holding_spots:
            closed_s = closures.closed_s
        if node == self.awaiting and math.isfinite(self.earliest_s):
            later = closed_s[closed_s[:, 1] > self.earliest_s]
            begins_s = self.earliest_s if not len(later) or later[0, 0] > self.earliest_s else float(later[0, 1])
            closed_s = np.concatenate(([[-NEVER_S, begins_s]], later[later[:, 0] > self.earliest_s]))
        return Closures(closed_s) if len(closed_s) else None

    def fastest_s(self, segments: Sequence[int]) -> float:
        """Lower bound of the flight time over segments, take-off to touch-down, s."""
        air = self.air
        return air.climb_s + air.descent_s + float(air.distance_m[list(segments)].sum()) / air.max_ground_speed_mps

    def charged_at(self, node: int, pad_s: float, lasts_s: float) -> float:
        """Time at which a drone on a pad of a station has charged for `lasts_s`; it charges only while the station is open."""
        closures = self.closures.get(node)
        return pad_s + lasts_s if closures is None else float(closures.past(np.array(pad_s), np.array(pad_s + lasts_s)))

    def charging_s(self, node: int, pad_s: float, until_s: float) -> float:
        """Charging time of a drone on a pad of a station until a time, s."""
        closures = self.closures.get(node)
        shut = 0.0 if closures is None else float(closures.within(np.array(pad_s), np.array(until_s)))
        return until_s - pad_s - shut

    def has_pads(self, node: int) -> bool:
        """Return whether a drone can recharge there."""
        return self.network.stations[node].pads > 0

    @cached_property
    def busy(self) -> dict[int, int]:
        """Busy pads reported at the start, by node."""
        seen = self.request.state.busy_pads
        return {self.network.index[key]: count for key, count in seen.items() if key in self.network.index}

    @cached_property
    def pads_free_s(self) -> dict[int, tuple[float, ...]]:
        """Times at which busy pads become free, by node, POSIX seconds, as far as known."""
        known = self.request.state.pads_free_s
        return {self.network.index[key]: times for key, times in known.items() if key in self.network.index}

    @cached_property
    def holding_spots(self) -> NDArray[np.int64]:
        """Holding spots at each node, shape (nodes,)."""
        return np.array([station.holding_spots for station in self.network.stations], dtype=np.int64)

    @cached_property
    def waits(self) -> ExpectedWaits:
        """Expected waits, computed for a station on first use."""
        return ExpectedWaits(self, HORIZON_H)

    def queue_paths(self, nodes: Iterable[int], sample: int, seed: int | None = None) -> dict[int, QueuePath]:
        """One sampled realisation of the other drones at each of some stations; by default of the request's seed."""
        return self.queue_sets(nodes, [sample], seed)[0]

    def queue_sets(
        self,
        nodes: Iterable[int],
        samples: Sequence[int],
        seed: int | None = None,
        until_s: float = math.inf,
        among: Sequence[int] = (),
    ) -> list[dict[int, QueuePath]]:
        """Several sampled realisations of the other drones at each of some stations; what happens after `until_s` may be missing.

        Those `among` which they are, if given, are sampled with them.
        """
        known = self.request.seed if seed is None else seed
        return self.queue_samples.sets(self, nodes, samples, known, until_s, among)

    def many_queues(
        self, nodes: Sequence[int], stream: int, count: int, until_s: float | NDArray[np.float64] = math.inf
    ) -> PackedPaths:
        """Sample `count` realisations of the other drones at each of some places, in order (place, realisation).

        The realisations of a stream differ from those of `queue_sets` and of other streams; a repeated request with the same count gives the same
        ones. Times after `until_s`, of all or of each, shape (count,), may be missing: those after `QueueSamples.sampled_until`.
        """
        return self.queue_samples.many(self, nodes, stream, count, until_s)

    @cached_property
    def queue_samples(self) -> QueueSamples:
        """Sampled queues so far."""
        return QueueSamples(float(HORIZON_H))

    @cached_property
    def direct_air(self) -> SegmentWind:
        """The wind over straight flights from every node to the destination, one "segment" per node."""
        lat, lon = self.network.lat, self.network.lon
        d = self.destination
        distance, bearing = geodesy.inverse(lat, lon, lat[d], lon[d])
        middle = geodesy.midpoint(lat, lon, bearing, distance)
        wind = self.ensemble
        ground_m = self.network.ground_m
        factor = wind_factors(self.rules, (ground_m, ground_m[d]))
        weight = wind.weights(*middle) * factor[:, None]
        angle = np.radians(bearing)
        return self.air._replace(
            weight=np.ascontiguousarray(weight),
            cos_bearing=np.cos(angle),
            sin_bearing=np.sin(angle),
            distance_m=distance,
            shut_of=np.zeros(len(distance), dtype=np.int64),
        )

    @cached_property
    def ways_on(self) -> tuple[tuple[int, ...], ...]:
        """Flights, each the segments of one, by which the drone leaves a destination without pads; see `planner.problem.ways_on`."""
        return ways_on(self) if self.needs_escape else ()

    @cached_property
    def escapes(self) -> NDArray[np.int64]:
        """`ways_on` as kernels read them: one after the other, -1 after each."""
        return np.array([segment for way in self.ways_on for segment in (*way, -1)], dtype=np.int64)

    @cached_property
    def onward_energies(self) -> dict[tuple[int, float], tuple[float, tuple[int, ...]]]:
        """Known charge for the onward flight; see `planner.robust.way_on.way_on_energy`."""
        return {}

    @property
    def needs_escape(self) -> bool:
        """Whether the drone must be able to fly on from the destination."""
        return self.request.escape and (self.request.in_air or not self.has_pads(self.destination))

    @property
    def onward_cost(self) -> tuple[float, float]:
        """`soc_per_s` and `soc_fixed` kept for the onward flight: without the package, or with it where it may stay on board.

        The charge of a hover at the target is included.
        """
        if self.keeps_for_package:
            return self.soc_per_s, self.soc_fixed + self.hover_soc
        return self.empty_cost

    @property
    def keeps_for_package(self) -> bool:
        """Whether the charge for the onward flight is that with the package: a winch may jam, and a payload place may not release."""
        return self.request.undelivered_to is not None or self.request.in_air

    @property
    def hover_soc(self) -> float:
        """Charge of a hover at the target, with the package."""
        return self.soc_per_s * self.request.dwell_s if self.request.in_air else 0.0

    @property
    def why_on(self) -> str:
        """Reason why the drone must fly on from the destination, in words."""
        return "where it does not land" if self.request.in_air else "which has no pads"

    def thinned(self, members: int) -> Problem:
        """Return the same problem with a limited number of members of the forecast; computed waits are kept."""
        if len(self.probability) <= members:
            return self
        return self._sharing_queues(self.drone, self.ensemble.thinned(members))

    def for_drone(self, drone: Drone) -> Problem:
        """Return the same request for another drone; computed waits and queues are kept."""
        return self._sharing_queues(drone, self.ensemble)

    def _sharing_queues(self, drone: Drone, ensemble: WindEnsemble) -> Problem:
        other = Problem(self.scenario, self.request, drone, ensemble, parameters=self.parameters, waits=self.waits)
        other.__dict__["queue_samples"], other.forecast = self.queue_samples, self.forecast
        return other
