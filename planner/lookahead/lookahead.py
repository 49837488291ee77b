"""Look-ahead over a forecast: arrays for kernels, and single queries."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.lookahead.flight_kernels import P_HOLD, WORKING_ROWS, Need, Ways, flight_lookahead
from skyway.planner.lookahead.lookahead_kernels import (
    FLIGHTS,
    MISSING,
    Flight,
    Graph,
    Policy,
    Stand,
    World,
    earliest,
    held,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind
    from skyway.planner.problem.problem import Problem


class Lookahead:
    """Answers about flights from a station at a time, over the forecast of a problem.

    Each charge goes to 100 % where it is `full`, by default as the request says; a second of the remaining flight
    counts `factor` seconds in the look-ahead.
    """

    def __init__(self, problem: Problem, *, full: bool | None = None, factor: float = 1.0) -> None:
        self.problem = problem
        self._policy = Policy(
            full=problem.request.recharge == "full" if full is None else full,
            reserve=float(problem.reserve),
            factor=float(factor),
        )
        self._tally = np.zeros(2, dtype=np.int64)

    @property
    def labels_expanded(self) -> int:
        """Flights evaluated so far."""
        return int(self._tally[FLIGHTS])

    @property
    def budget(self) -> float:
        """Most that a flight can take from a full battery."""
        return 1.0 - self.problem.reserve

    @cached_property
    def need(self) -> Need:
        """Conditions for a flight to be possible."""
        problem, onward = self.problem, self.problem.onward_cost
        return Need(
            soc_per_s=float(problem.soc_per_s),
            soc_fixed=float(problem.soc_fixed),
            empty_per_s=float(onward[0]),
            empty_fixed=float(onward[1]),
            epsilon=float(problem.epsilon),
            destination=int(problem.destination),
            escapes=problem.escapes,
            needs_escape=bool(problem.needs_escape),
            dwell_s=float(problem.request.dwell_s),
        )

    @cached_property
    def world(self) -> World:
        """All that a look-ahead reads."""
        direct = self._ways(self.problem.direct_air)
        bound = np.empty(int(np.diff(self.problem.network.first).max(initial=0)))
        return World(self.ways, direct, self._graph, self.need, self._policy, self._tally, bound)

    @cached_property
    def ways(self) -> Ways:
        """The segments as flights, and what is already known of them."""
        return self._ways(self.problem.air)

    def _ways(self, air: SegmentWind) -> Ways:
        members, slots, _ = air.north.shape
        count = len(air.distance_m)
        keep = slots if slots * count <= self.problem.parameters.pfs.kept_flights else 0
        north, east = self._wind
        return Ways(
            air=air,
            north=north,
            east=east,
            probability=self.problem.probability,
            table=np.zeros((keep, count, P_HOLD + 1)),
            lower_s=np.zeros((keep, count)),
            fresh=np.empty(P_HOLD + 1),
            rows=np.empty((WORKING_ROWS, members)),
        )

    @cached_property
    def _wind(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        air = self.problem.air
        north, east = (np.ascontiguousarray(wind.transpose(1, 2, 0)) for wind in (air.north, air.east))
        return north, east

    @cached_property
    def _graph(self) -> Graph:
        p = self.problem
        time, soc = p.padded_curves
        waits = p.waits
        return Graph(
            first=p.network.first,
            head=p.network.head,
            stops=p.network.pads > 0,
            curve_of=p.curve_of,
            curve_s=time,
            curve_soc=soc,
            wait_start_s=float(waits.start_s),
            wait_step_s=float(waits.step_s),
            wait_s=waits.wait_s,
            wait_known=waits.known,
        )

    def forecast_missing(self) -> None:
        """Forecast the waits that a kernel requested."""
        self.problem.waits.need([int(self._tally[MISSING])])

    def flight(self, segment: int, time_s: float) -> tuple[float, float, float]:
        """(mean time, charge taken, P(hold)) of a flight, see `flight_lookahead`."""
        self._tally[FLIGHTS] += 1
        node = int(self.problem.network.head[segment])
        mean, charge, p_hold = flight_lookahead(self.ways, self.need, segment, node, time_s)
        return float(mean), float(charge), float(p_hold)

    def without_way_on(self, segment: int, time_s: float) -> float:
        """Charge taken by a flight alone, without the way on from a destination without pads."""
        need, node = self.need._replace(needs_escape=False), int(self.problem.network.head[segment])
        return float(flight_lookahead(self.ways, need, segment, node, time_s)[1])

    def earliest(self, segment: int, time_s: float, soc: float, pad_s: float | None) -> Flight:
        """Earliest flight over a segment in the wind of that time; its take-off is infinite where there is none.

        The drone stands at its beginning since `time_s` with the charge `soc`, and comes onto a pad at `pad_s`; None:
        it does not charge.
        """
        return Flight(*earliest(self.world, self._stand(segment, time_s, soc, pad_s), segment))

    def held(self, segment: int, time_s: float, soc: float, pad_s: float | None) -> Flight:
        """Earliest flight over a segment after waiting for better wind, as `earliest`."""
        return Flight(*held(self.world, self._stand(segment, time_s, soc, pad_s), segment))

    def _stand(self, segment: int, time_s: float, soc: float, pad_s: float | None) -> Stand:
        node = int(self.problem.network.tail[segment])
        return Stand(node, float(time_s), float(soc), math.inf if pad_s is None else float(pad_s))
