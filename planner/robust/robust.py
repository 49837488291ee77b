"""The robust planner: a route and a charge policy, chosen by out-of-sample simulation.

Routes are composed by the exact planner in problems that represent the forecast (`planner.robust.composer`): that of the mean
flight time at several margins, and some of its members with sampled queues. Each route is flown with charges decided at
each stop (`planner.robust.charge_policy`), every member being the truth once for a drone whose forecast excludes it. The best by
the objective among those that keep the reserve is the answer; its margin is calibrated in the same way, among other queues
and gusts than those of the choice, and its promises are computed there. Stations that may be full to
the last holding spot are omitted if another way exists: a hovering drone uses its reserve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.errors import NoRouteError
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.robust.candidate import Candidate
from skyway.planner.robust.charge_policy import ChargePolicy, known_at
from skyway.planner.robust.composer import Composer, TimeLimit
from skyway.planner.robust.free_capacity import blocking_probabilities
from skyway.planner.robust.out_of_sample import PROMISING, OutOfSample, margin_for
from skyway.planner.schedule.no_route import emptied_leg, no_route, runs_empty

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome
    from skyway.planner.schedule.typical import Typical


@dataclass(frozen=True, eq=False)
class RobustAnswer:
    """Answer of the robust planner."""

    policy: ChargePolicy
    """Its itinerary names the charges of the typical schedule."""
    typical: Typical
    """The typical schedule and its realization."""
    out_of_sample: OutOfSample
    """Runs behind the outcome."""
    outcome: Outcome
    """Results out of sample."""
    candidates: tuple[Candidate, ...]
    """All compared routes, best first."""


class Look(NamedTuple):
    """What a search has found so far."""

    outcome: Outcome
    """Results of the best route, in the deliveries of the last comparison."""
    answer: RobustAnswer | None = None
    """At the end of the search."""


MIN_HOLD_S = 60.0
"""A shorter wait is not moved to another station, s."""


class RobustSearch:
    """One search.

    Parameters
    ----------
    problem : Problem
        With the forecast.
    errors : Errors, optional
        Errors of the truth beyond the forecast; by default those of the problem.
    end_at : float
        Time of `time.perf_counter` from which the search ends with the first route; `complete` is then False.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        errors: Errors | None = None,
        end_at: float = math.inf,
    ) -> None:
        self.parameters = problem.parameters.robust
        self.problem = problem.thinned(self.parameters.members)
        self.errors = self.problem.usual_errors if errors is None else errors
        self._limit = TimeLimit(end_at)
        self._large = self.parameters.is_large(len(problem.network))
        self._dense = self.parameters.is_dense(len(problem.network), len(problem.network.head))
        self._finalist_runs = self.parameters.finalist_runs_of(len(problem.network))
        self._composer = Composer(self.problem, self.errors, self._limit)
        self._simulated = 0
        self._known: dict[tuple[object, ...], tuple[Candidate, NDArray[np.float64]]] = {}

    @property
    def complete(self) -> bool:
        """Whether the comparison is complete."""
        return not self._limit.was_reached

    @property
    def labels_expanded(self) -> int:
        """Labels expanded by the exact searches, and simulated deliveries."""
        return self._composer.labels_expanded + self._simulated

    def earliest_s(self) -> float:
        """Return the arrival that hardly any plan beats on average, POSIX seconds; infinite without a way. A hundredth of the time of a search."""
        return self._composer.earliest_s()

    def solve(self) -> RobustAnswer:
        """Search for the best route. Raises a `NoRouteError` if there is no route even without margin."""
        return next(look.answer for look in self.looks() if look.answer is not None)

    def looks(self) -> Iterator[Look]:
        """Search for the best route, and return what is known of it after each comparison, the answer at last.

        Each look takes a third of the time of a search, or less. A `NoRouteError` as in `solve`.
        """
        candidates = self.candidates()
        yield Look(candidates[0].outcome)
        candidates = self._with_other_waits(self._with_short_flights(self.finalists(candidates)))
        yield Look(candidates[0].outcome)
        try:
            answer = self._best_finished(candidates)
        except NoRouteError:  # shorter flights may arrive
            answer = self._best_finished([*sorted(self._of_short_flights(), key=Candidate.order), *candidates])
        yield Look(answer.outcome, answer)

    def _of_short_flights(self) -> list[Candidate]:
        """Return routes of flights so short that hardly any wind makes them too long for the battery, over any station."""
        found: dict[tuple[tuple[int, ...], ...], Candidate] = {}
        self._add_short_flights(found, np.ones(len(self.problem.network), dtype=bool))
        return _flying(found)

    def _with_short_flights(self, candidates: list[Candidate]) -> list[Candidate]:
        """Try short flights if the best route has a long wait in some winds: the winds of the first comparison may not contain storms."""
        best = candidates[0]
        if not self._is_compared(best) and not self._limit.is_reached():
            best = self._judged(best.policy.itinerary, self._finalist_runs, None, best)[0]
        if self._limit.is_reached() or not self._waits_long(best.outcome, len(best.out_of_sample.weight)):
            return candidates
        short = {one.flights: one for one in self._of_short_flights()}
        for one in (best, *filter(self._is_compared, candidates[1:])):
            short.pop(one.flights, None)
        margin = best.policy.known.margin
        again = [self._compared(one, margin) for one in short.values()]
        rest = [one for one in candidates[1:] if one.flights not in short]
        compared = [best, *again, *filter(self._is_compared, rest)]
        return self._compare_better(compared, [one for one in rest if not self._is_compared(one)], margin)

    def _waits_long(self, outcome: Outcome, runs: int) -> bool:
        """Whether a route waits so long in some winds that one of short flights is worth a comparison."""
        begin = self.problem.depart_s
        seldom = outcome.mean_s - begin <= self.parameters.long_wait * (outcome.quantile_s(0.5) - begin)
        # A forecast of the day may have a storm in all of its members: then half of the deliveries wait long, too.
        long = not seldom or math.isfinite(self.problem.ensemble.known_until_s)
        return long or outcome.p_arrive <= 1.0 - self.parameters.chance_runs / runs

    def _with_other_waits(self, candidates: list[Candidate]) -> list[Candidate]:
        """If the objective is not early delivery, also let the best routes wait at the origin instead of at the last stop."""
        p = self.problem
        if not math.isfinite(p.earliest_s):
            return candidates
        found = list(candidates)
        for one in candidates[: self.parameters.finalists]:
            hold_s = one.out_of_sample.held_before_last
            if len(one.policy.itinerary) < 2 or not hold_s > MIN_HOLD_S:
                continue
            policy = replace(one.policy, first_s=p.depart_s + hold_s)
            runs = len(one.out_of_sample.weight)
            screened = None if self._is_compared(one) else self.parameters.screen_members
            again = policy.simulate(self.errors, runs, max_realizations=screened, before=one.out_of_sample)
            found.append(self._candidate(policy, again))
        return self._ranked(found)

    def _best_finished(self, candidates: list[Candidate]) -> RobustAnswer:
        """Finish the first candidate, and the next ones as long as they may be better: the calibrated margin may make a route much longer.

        In the final evaluation, the drone may never leave, or its battery become empty; then the next candidate is finished, too.
        """
        most = 1 if self._large else self.parameters.finished_routes
        answers: dict[Candidate, RobustAnswer] = {}
        best: Candidate | None = None
        for number, one in enumerate(candidates):
            if best is not None:
                enough = self._limit.is_reached() or len(answers) == most
                if enough or not self._is_compared(one) or one.order() >= best.order():
                    break
            try:
                answer = self.finish([one, *candidates[:number], *candidates[number + 1 :]])
            except NoRouteError:
                if best is None and number == len(candidates) - 1:
                    raise
            else:
                answers[self._candidate(answer.policy, answer.out_of_sample)] = answer
                best = self._ranked(list(answers))[0]
        return answers[self._ranked(list(answers))[0]]

    def finalists(self, candidates: list[Candidate]) -> list[Candidate]:
        """Order candidates again after more runs of the first few, and of those that are better except for the reserve.

        With a margin a route may take much longer; so others follow, see `_compare_better`.
        """
        if len(candidates) == 1 or self._large or self._limit.is_reached():
            return candidates
        first, others = candidates[: self.parameters.finalists], candidates[self.parameters.finalists :]
        bold = [one for one in others if one.unsafe and one.loss < first[0].loss][: self.parameters.bold_finalists]
        again = [self._judged(one.policy.itinerary, self._finalist_runs, None, one)[0] for one in first + bold]
        # Candidates are compared as flown: with a margin. A single one has a sampling error, one of all may be that of a bad route; so the
        # lesser counts, and the best are calibrated until none could be better.
        margin = margin_for([one.out_of_sample for one in again], self.problem.epsilon)
        compared = [self._careful(one, margin) for one in again]
        return self._compare_better(compared, [one for one in others if one not in bold], margin)

    def _compare_better(self, compared: list[Candidate], others: list[Candidate], margin: float) -> list[Candidate]:
        """Order the compared candidates; compare others too, as long as one would be better than the best, without a margin."""
        compared, others = self._ranked(compared), list(others)
        while len(compared) < self.parameters.most_finalists and others and others[0].order() < compared[0].order():
            if self._limit.is_reached():
                break
            compared = self._ranked([*compared, self._compared(others.pop(0), margin)])
        return compared + others

    def _compared(self, one: Candidate, margin: float) -> Candidate:
        """Return a candidate in the deliveries of the second comparison, with a margin."""
        return self._careful(self._judged(one.policy.itinerary, self._finalist_runs, None, one)[0], margin)

    def _careful(self, one: Candidate, margin: float) -> Candidate:
        """Return a candidate with a margin on its charges, or with its own one if that is less, or if it violates the reserve."""
        own = margin_for([one.out_of_sample], self.problem.epsilon)
        margin = max(margin, own) if one.unsafe else min(margin, own)
        if margin <= one.policy.known.margin + self.parameters.margin_tolerance:
            return one
        policy = replace(one.policy, known=one.policy.known._replace(margin=margin))
        out_of_sample = policy.simulate(self.errors, self._finalist_runs, before=one.out_of_sample)
        return self._candidate(policy, out_of_sample)

    def finish(self, candidates: list[Candidate]) -> RobustAnswer:
        """Calibrate the first of the candidates and return its answer.

        A `NoRouteError`: calibrated, it never arrives, or its typical schedule runs out of charge.
        """
        runs = self.parameters.final_runs_of(len(self.problem.network))
        runs = min(runs, self.parameters.hurried_runs) if self._limit.is_reached() else runs
        policy, out_of_sample = self._calibrated(candidates[0], runs)
        outcome = out_of_sample.outcome(self.problem, policy.itinerary)
        if outcome.p_arrive <= 0.0:
            raise policy.grounded(out_of_sample)
        typical = policy.typical(out_of_sample)
        emptied = emptied_leg(typical.schedule)
        if emptied is not None:
            raise runs_empty(self.problem, policy.itinerary, emptied)
        return RobustAnswer(policy.with_charges(typical.schedule), typical, out_of_sample, outcome, tuple(candidates))

    def _calibrated(self, one: Candidate, runs: int) -> tuple[ChargePolicy, OutOfSample]:
        """Return the policy of a candidate with the margin that so many simulated deliveries need, and these."""
        out_of_sample = one.policy.simulate(self.errors, runs, before=one.out_of_sample, sample_set=PROMISING)
        policy, out_of_sample = self._leaving(one.policy, out_of_sample, runs)
        chosen_in = [one.out_of_sample] if self._is_compared(one) else []
        for _ in range(1 if self._large else self.parameters.calibrations):
            wanted, margin = margin_for([out_of_sample, *chosen_in], self.problem.epsilon), policy.known.margin
            tolerance = self.parameters.margin_tolerance
            if margin - tolerance <= wanted <= margin:
                break
            policy = replace(policy, known=policy.known._replace(margin=wanted))
            if abs(wanted - margin) <= tolerance:
                break
            out_of_sample = policy.simulate(self.errors, runs, before=out_of_sample, sample_set=PROMISING)
        return policy, out_of_sample

    def _leaving(self, policy: ChargePolicy, out_of_sample: OutOfSample, runs: int) -> tuple[ChargePolicy, OutOfSample]:
        """Permit stations with a higher blocking probability if some runs never leave for lack of a place, and the reserve is kept."""
        for most_full in self.parameters.fuller:
            if not out_of_sample.waits_for_room or most_full <= policy.most_full:
                continue
            fuller = replace(policy, most_full=most_full)
            again = fuller.simulate(self.errors, runs, before=out_of_sample, sample_set=PROMISING)
            if 1.0 - again.outcome(self.problem).p_success > self.problem.epsilon:
                break
            policy, out_of_sample = fuller, again
        return policy, out_of_sample

    def candidates(self, *, without: int | None = None) -> list[Candidate]:
        """Return routes of all composed problems, each once, best first.

        No route may stop at the node `without`. A `NoRouteError`: there is none even without margin, or none that can be flown to its end in the
        forecast.
        """
        p = self.problem
        likely_free_at = blocking_probabilities(p) <= self.parameters.full_share * p.epsilon
        likely_free_at[[p.origin, p.destination]] = True
        found: dict[tuple[tuple[int, ...], ...], Candidate] = {}
        everywhere = np.ones(len(p.network), dtype=bool)
        few = likely_free_at.sum() < self.parameters.few_free * np.count_nonzero(p.network.pads > 0)
        for allowed in (everywhere,) if few else (likely_free_at, everywhere):
            if without is not None:
                allowed[without] = without in p.must_stop
            if _flying(found) and (self._large or likely_free_at.all() or self._limit.is_reached()):
                break
            for itinerary in self._composer.routes(
                allowed, members=0 if found or self._large else self.parameters.sampled_members
            ):
                self._add(found, itinerary)
                if _flying(found) and (self._limit.is_reached() or (self._dense and not self._waits_for_pads(found))):
                    break
            for itinerary in self._composer.sparing(allowed):
                self._add(found, itinerary)
            if found and not (_flying(found) and self._limit.is_reached()):
                best = min(found.values(), key=Candidate.order).outcome
                if self._waits_long(best, self.parameters.screen_runs):
                    self._add_short_flights(found, allowed)
        if not found:
            raise no_route(p, Lookahead(p))
        flying = _flying(found)
        if not flying:
            first = next(iter(found.values()))
            raise first.policy.grounded(first.out_of_sample)
        return self._ranked(flying)

    def _waits_for_pads(self, found: dict[tuple[tuple[int, ...], ...], Candidate]) -> bool:
        """Whether deliveries wait for pads so long that routes with fewer stops, of longer flights, may be better."""
        depart_s = self.problem.depart_s
        return (
            max(one.out_of_sample.waited_for_pads(depart_s) for one in found.values()) >= self.parameters.waits_matter
        )

    def _ranked(self, candidates: list[Candidate]) -> list[Candidate]:
        """Order candidates, best first; those of the second comparison before the others, whose figures lack its margin."""
        orders = [(not self._is_compared(one), *one.order()) for one in candidates]
        ranked = self.problem.request.objective.ranked(orders)
        return [candidates[number] for number in ranked]

    def _is_compared(self, one: Candidate) -> bool:
        """Whether a candidate was in the second comparison, in more deliveries than in the first."""
        return len(one.out_of_sample.weight) > 2 * self.parameters.screen_runs

    def _add_short_flights(
        self, found: dict[tuple[tuple[int, ...], ...], Candidate], allowed: NDArray[np.bool_]
    ) -> None:
        """Add a route of flights so short that hardly any wind makes them too long for the battery."""
        itinerary = self._composer.short_flights(allowed)
        if itinerary is not None:
            self._add(found, itinerary)

    def _add(self, found: dict[tuple[tuple[int, ...], ...], Candidate], itinerary: Itinerary) -> None:
        """Evaluate a route, and the same without the stops at which it does not charge, unless they are known."""
        while True:
            flights = tuple(leg.segments for leg in itinerary)
            if flights in found:
                return
            found[flights], charges = self._judged(
                itinerary, self.parameters.screen_runs, self.parameters.screen_members
            )
            if found[flights].outcome.p_arrive <= 0.0:  # it does not charge at a stop that it never reaches
                return
            itinerary = self._without_idle_stops(itinerary, charges)

    def _without_idle_stops(self, itinerary: Itinerary, charges: NDArray[np.float64]) -> Itinerary:
        """Remove the stops at which hardly any run charges, unless they are required."""
        legs = [itinerary[0]]
        for leg, share in zip(itinerary[1:], charges[1:], strict=True):
            required = self.problem.network.tail[leg.segments[0]] in self.problem.must_stop
            if share < self.parameters.idle_share and not required:
                legs[-1] = replace(legs[-1], segments=(*legs[-1].segments, *leg.segments))
            else:
                legs.append(leg)
        return tuple(legs)

    def judged(self, itinerary: Itinerary) -> Candidate:
        """Return the performance of a route in the deliveries of the first comparison."""
        return self._judged(itinerary, self.parameters.screen_runs, self.parameters.screen_members)[0]

    def _judged(
        self, itinerary: Itinerary, runs: int, realizations: int | None, before: Candidate | None = None
    ) -> tuple[Candidate, NDArray[np.float64]]:
        """Return the performance of a route, and the share of runs that charge at each stop; computed once, with the tables of `before`."""
        key = itinerary, runs, realizations
        if key not in self._known:
            self._known[key] = self._judged_now(itinerary, runs, realizations, before)
        return self._known[key]

    def _judged_now(
        self, itinerary: Itinerary, runs: int, realizations: int | None, before: Candidate | None
    ) -> tuple[Candidate, NDArray[np.float64]]:
        p = self.problem
        flights = len(itinerary) + p.needs_escape  # the way on counts as one leg
        known = known_at(p, self.errors, measured=True, epsilon=self.parameters.required_share * p.epsilon / flights)
        policy = ChargePolicy(p, itinerary, known, self.parameters.full_share * p.epsilon)
        known_before = None if before is None else before.out_of_sample
        simulated = policy.simulate(self.errors, runs, max_realizations=realizations, before=known_before)
        found = self._candidate(policy, simulated)
        for most_full in self.parameters.fuller:
            if found.outcome.p_arrive >= self.parameters.min_arrival or not found.out_of_sample.waits_for_room:
                break
            policy = replace(policy, most_full=most_full)
            again = policy.simulate(self.errors, runs, max_realizations=realizations, before=found.out_of_sample)
            found = self._candidate(policy, again)
        return found, found.out_of_sample.charging

    def _candidate(self, policy: ChargePolicy, out_of_sample: OutOfSample) -> Candidate:
        p = self.problem
        self._simulated += len(out_of_sample.weight)
        outcome = out_of_sample.outcome(p, policy.itinerary)
        unsafe = 1.0 - outcome.p_success > p.epsilon + self.parameters.chance_runs / len(out_of_sample.weight)
        return Candidate(policy, outcome, unsafe, p.request.objective.loss(outcome), out_of_sample)


def _flying(found: dict[tuple[tuple[int, ...], ...], Candidate]) -> list[Candidate]:
    """Return the candidates that arrive in any realization."""
    return [one for one in found.values() if one.outcome.p_arrive > 0.0]
