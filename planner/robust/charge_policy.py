"""Charge policy: a route whose charges are decided at each stop.

The rule is that of `planner.robust.charge_kernels`; it is judged by `planner.robust.out_of_sample`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.wind.estimation.field import ResidualModel
from skyway.planner.problem.kernel_inputs import check_runs, check_shape
from skyway.planner.robust.calibration import calibrated, usual_arrivals_s
from skyway.planner.robust.charge_kernels import fly_by_required_soc
from skyway.planner.robust.free_capacity import room_at
from skyway.planner.robust.free_capacity_kernels import Present
from skyway.planner.robust.information_kernels import Known
from skyway.planner.robust.out_of_sample import (
    CHOOSING,
    PROMISING,
    OutOfSample,
    SampledTruths,
    left_out,
    simulated_realizations,
)
from skyway.planner.robust.required_soc_kernels import required_soc_tables
from skyway.planner.robust.way_on import fly_on, kept_for_way_on
from skyway.planner.schedule.gust_kernels import Disturbance, no_disturbance
from skyway.planner.schedule.itinerary import held_in_the_air, legs_of, place_nodes
from skyway.planner.schedule.no_route import grounded_leg, never_leaves
from skyway.planner.schedule.schedule_kernels import COLUMNS, SOC_LANDING, SOC_TAKE_OFF, TOUCH_DOWN, Queues
from skyway.planner.schedule.typical import typical_schedule

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.base.errors import NoRouteError
    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.typical import Typical


def known_at(problem: Problem, errors: Errors, *, measured: bool, epsilon: float) -> Known:
    """Information of a problem's drone at every stop; see `planner.robust.information_kernels.Known`.

    The members are smoothed with a normal kernel whose bandwidth falls with their number as Silverman's ("Density
    Estimation", 1986, eq. 3.28), but is wider: see `RobustParameters.bandwidth`.
    """
    residual, parameters, energy = ResidualModel(), problem.parameters.robust, errors.energy_of(problem.drone)
    return Known(
        air=problem.air,
        share=np.ascontiguousarray(problem.probability[None]),
        measured=measured,
        sigma_mps=residual.sigma_mps,
        tau_s=residual.tau_s,
        smoothing=parameters.bandwidth * len(problem.probability) ** -0.2
        if measured and len(problem.probability) > 1
        else 0.0,
        gust_sd=errors.gust_sd,
        gust_time_s=errors.gust_time_s,
        energy_mean=energy.mean_ratio,
        energy_between=energy.sd_between**2,
        energy_within=energy.sd_within**2,
        epsilon=epsilon,
        margin=0.0,
        full=problem.request.recharge == "full",
        worst_members=parameters.worst_members,
        steady_sigmas=parameters.steady_sigmas,
    )


_AHEAD = 1.3
"""Ratio of the sampled time of queues to the longest previous delivery by the same route in the same wind."""
_MOST_OF_THEM = 0.8
"""Share of the previous deliveries that took less than one in a wind that none of them met is assumed to take."""


@dataclass(frozen=True, eq=False)
class ChargePolicy:
    """Flights in a fixed order, each charged by the information available when it is due."""

    problem: Problem
    """With the forecast at the time of planning."""
    itinerary: Itinerary
    """The flights; ``charge_to`` is the charge of the typical schedule."""
    known: Known
    """The rule."""
    most_full: float = 1.0
    """A flight starts when the probability that its station is full is at most this."""
    first_s: float = -math.inf
    """The drone waits at its origin until then, POSIX seconds."""

    def __len__(self) -> int:
        return len(self.itinerary)

    @cached_property
    def landing(self) -> NDArray[np.float64]:
        """Least charge at the end of each flight, shape (legs,)."""
        least = np.full(len(self), self.problem.reserve)
        least[-1] += (1.0 + self.known.margin) * self.way_on_soc
        return least

    @cached_property
    def way_on_soc(self) -> float:
        """Charge for the way on from a target without pads, without the margin; see `planner.robust.way_on`."""
        return kept_for_way_on(self.problem, self.itinerary, self.known) if self.problem.needs_escape else 0.0

    def fly(
        self,
        truth: Problem,
        disturbance: Disturbance,
        member: NDArray[np.int64],
        paths: PackedPaths,
        *,
        share: NDArray[np.float64] | None = None,
        tables: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Fly it in realizations: (schedule, energy_ratio), see `planner.robust.charge_kernels.fly_by_required_soc`.

        `truth` is the same request in the winds that are true; `member` and the disturbance are those of each run.
        Paths are those of the sets of queues that the disturbance names, at each of
        `planner.schedule.itinerary.place_nodes`, in order (place, set). An `InputError` refuses members and sets that are not there,
        and arrays of other shapes.

        `share` is the forecast for each member of the truth, shape (members of truth, members); the policy's own for
        all by default. `tables` were computed before with the same truth, flights and forecast.
        """
        row = np.zeros(len(member), dtype=np.int64) if share is None else member
        known = self.known if share is None else self.known._replace(share=share)
        first_s = np.full(len(self), -math.inf)
        first_s[0] = self.first_s
        legs = legs_of(truth, self.itinerary)._replace(not_before_s=first_s)
        realizations = len(truth.air.north)
        if not len(paths):
            raise InputError(Fault("has no queues", field="paths", remedy="a set of one path for each place"))
        check_runs(member, realizations, disturbance, paths, len(self) + 1)
        given, true = known.air.north.shape[2], truth.air.north.shape[2]
        if given != true:
            remedy = "bring the forecast to the sites of the true wind with at_sites"
            problem = "the forecast is for other sites than those where the wind is measured"
            raise InputError(Fault(problem, field="sites", value=f"{given} instead of {true}", remedy=remedy))
        check_shape(
            "share", known.share, (realizations if share is not None else len(known.share), len(known.air.north))
        )
        if tables is not None:
            check_shape("tables", tables, required_soc_tables(truth.air, len(self)).shape)
        schedule, energy_ratio = fly_by_required_soc(
            known,
            self.landing,
            disturbance,
            truth.air,
            member,
            row,
            legs,
            Queues.of(paths),
            (float(truth.depart_s), float(truth.soc)),
            (float(truth.soc_per_s), float(truth.soc_fixed)),
            room_at(truth, [int(truth.network.head[leg.segments[-1]]) for leg in self.itinerary], self.most_full),
            Present.of(paths),
            tables if tables is not None else required_soc_tables(truth.air, len(self)),
            truth.in_flight,
        )
        held = held_in_the_air(truth, schedule)
        schedule[held], energy_ratio[held] = np.inf, 0.0
        return schedule, energy_ratio

    def simulate(
        self,
        errors: Errors,
        runs: int,
        *,
        max_realizations: int | None = None,
        before: OutOfSample | None = None,
        sample_set: int = CHOOSING,
    ) -> OutOfSample:
        """Fly it out of sample: each member as the truth, forecast by the others, through sampled queues.

        There are about `runs` realizations, of at most `max_realizations` members as the truth. `before`, of the same
        flights, lends its tables. `sample_set` is ``CHOOSING`` or ``PROMISING``: other queues, gusts and vehicles in
        the same winds. The best of several routes in some realizations is not as good in others.
        """
        p, share = self.problem, left_out(self.problem.ensemble, self.problem.parameters.robust.apart_days)
        tables = before.tables if before is not None else required_soc_tables(p.air, len(self))
        found = simulated_realizations(p, self.itinerary, errors, runs, max_realizations, sample_set)
        members, disturbance = found.members, found.disturbance
        until_s = np.full(found.sets, math.inf) if before is None else self._likely_ends_s(found, before)
        schedule, energy_ratio, paths, usual_s = self._fly_to_their_ends(
            disturbance, members, sample_set, until_s, share=share, tables=tables
        )
        weight, control = calibrated(p, place_nodes(p, self.itinerary), found, paths, usual_s)
        simulated = OutOfSample(
            schedule, weight, members, disturbance.queue, energy_ratio, found.usual_ratio,
            np.ascontiguousarray(disturbance.energy[:, : len(self)]), errors.energy_of(p.drone), tables, control,
        )  # fmt: skip
        if not p.needs_escape:
            return simulated

        def fly_way_on(
            leaving: Problem,
            itinerary: Itinerary,
            sky: Disturbance,
            members: NDArray[np.int64],
            paths: PackedPaths,
            needed: float,
        ) -> NDArray[np.float64]:
            on = ChargePolicy(leaving, itinerary, self.known, self.most_full)
            tables = np.full_like(required_soc_tables(leaving.air, 1), needed)  # it leaves with whatever it has
            return on.fly(leaving, sky, members, paths, share=share, tables=tables)[0]

        taken = fly_on(p, self.known, schedule[:, -1, TOUCH_DOWN], members, disturbance, sample_set, fly_way_on)
        arrives = np.isfinite(schedule[:, -1, TOUCH_DOWN])
        onward_soc = np.where(arrives, schedule[:, -1, SOC_LANDING] - taken, np.inf)
        broken = arrives & (onward_soc < p.reserve - 1e-9)
        ratio = np.where(broken, taken / self.way_on_soc, 0.0)
        return replace(simulated, energy_ratio=np.column_stack((energy_ratio, ratio)), onward_soc=onward_soc)

    def _fly_to_their_ends(
        self,
        disturbance: Disturbance,
        members: NDArray[np.int64],
        sample_set: int,
        until_s: NDArray[np.float64],
        *,
        share: NDArray[np.float64],
        tables: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], PackedPaths, NDArray[np.float64]]:
        """Fly it in the winds of the forecast, through queues that are sampled for as long as each delivery takes.

        Returns schedule and energy ratio, the queues, and the usual arrivals (`usual_arrivals_s`), for which the queues are sampled, too.
        Queues, a set for each of `until_s`, are sampled until then, or as long as they already were; those in which a delivery takes longer
        are sampled for all of the horizon, and it is flown again.
        """
        p, nodes, sets = self.problem, place_nodes(self.problem, self.itinerary), len(until_s)
        schedule, energy_ratio = np.empty((len(members), len(self), COLUMNS)), np.empty((len(members), len(self)))
        late = np.arange(len(members))
        while len(late):
            paths = p.many_queues(nodes, sample_set, sets, until_s)
            some = disturbance._replace(
                queue=disturbance.queue[late], energy=disturbance.energy[late], gust_key=disturbance.gust_key[late]
            )
            schedule[late], energy_ratio[late] = self.fly(p, some, members[late], paths, share=share, tables=tables)
            usual_s = usual_arrivals_s(schedule, members)
            read_s = usual_s.max(axis=1, where=np.isfinite(usual_s), initial=-math.inf)
            read_s = np.maximum(schedule[:, :, TOUCH_DOWN].max(axis=1), read_s)
            late = np.flatnonzero(read_s > p.queue_samples.sampled_until(p, nodes, sample_set, sets)[disturbance.queue])
            until_s = until_s.copy()
            until_s[disturbance.queue[late]] = math.inf
        return schedule, energy_ratio, paths, usual_s

    def _likely_ends_s(self, truths: SampledTruths, before: OutOfSample) -> NDArray[np.float64]:
        """Until when the deliveries in each set of queues will hardly fly, by those before in the same winds, POSIX seconds, shape (sets,).

        Where the queues were sampled for as long as it took before, they are not sampled again.
        """
        p, nodes = self.problem, place_nodes(self.problem, self.itinerary)
        last_s = before.schedule[:, :, TOUCH_DOWN].max(axis=1)
        ends_s = np.full(len(p.probability), np.quantile(last_s, _MOST_OF_THEM, method="lower"))
        ends_s[before.member] = -math.inf
        np.maximum.at(ends_s, before.member, last_s)
        needed_s = np.full(truths.sets, -math.inf)
        np.maximum.at(needed_s, truths.disturbance.queue, ends_s[truths.members])
        known_s = p.queue_samples.sampled_until(p, nodes, truths.sample_set, truths.sets)
        return np.where(known_s >= needed_s, known_s, p.depart_s + _AHEAD * (needed_s - p.depart_s))

    def typical(self, before: OutOfSample) -> Typical:
        """Choose the typical schedule; see `planner.schedule.typical`.

        `before` is of the same flights, in the realizations of ``PROMISING``; its tables are used again.
        """
        p = self.problem
        share = left_out(p.ensemble, p.parameters.robust.apart_days)

        def fly(members: NDArray[np.int64], queues: NDArray[np.int64]) -> NDArray[np.float64]:
            disturbance = no_disturbance(len(members))._replace(queue=queues)
            until_s = np.full(before.sets, -math.inf)  # as far as they were sampled for `before`
            found = self._fly_to_their_ends(disturbance, members, PROMISING, until_s, share=share, tables=before.tables)
            return found[0]

        return typical_schedule(before, p.reserve, fly, p.parameters.schedule)

    def grounded(self, out_of_sample: OutOfSample) -> NoRouteError:
        """Explain why no run of an out-of-sample simulation of this policy arrives."""
        leg = grounded_leg(out_of_sample.schedule)
        slots = self.problem.air.north.shape[1]
        bases = out_of_sample.tables[:, leg, : out_of_sample.tables.shape[2] - 2 * slots]
        least = float(np.nanmin(np.where(np.isnan(bases), math.inf, bases)))
        required = self.landing[leg] + self.known.energy_mean * (1.0 + self.known.margin) * least
        on = self.landing[leg] - self.problem.reserve
        return never_leaves(self.problem, self.itinerary, leg, required, float(on))

    def with_charges(self, schedule: NDArray[np.float64]) -> ChargePolicy:
        """The same policy whose itinerary names the charges of a schedule, shape (legs, 7)."""
        p = self.problem
        legs = []
        before = p.soc
        for number, leg in enumerate(self.itinerary):
            leave = float(schedule[number, SOC_TAKE_OFF])
            charged = math.isfinite(leave) and leave > before + 1e-9
            legs.append(replace(leg, charge_to=leave if charged else None, not_before_s=-math.inf))
            before = float(schedule[number, SOC_LANDING])
        return replace(self, itinerary=tuple(legs))
