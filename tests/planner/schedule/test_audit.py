"""Every planner's answer is flown once more before it is given, and a wrong figure is refused."""

import itertools
import time
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from referee_worlds import KINDS, SLOTS_MIN, instance
from worlds import DEPART, make_request, make_wind, make_world

from skyway.models.base.errors import AuditError, InfeasibleError
from skyway.models.composition.composition import Composition, State
from skyway.planner import answers as planning
from skyway.planner.plan import plan
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, PLANNERS

LATER = timedelta(seconds=3)


def delivery(planner, seed=5):
    """A delivery with stops that every planner has an answer to."""
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, 6, utilisation=0.4)
    members = 1 if planner in CLAIRVOYANT_PLANNERS else 5
    wind = make_wind(rng, members=members, mean_mps=2.0)
    request = replace(make_request(scenario, rng, payload_kg=0.5), seed=1)
    return scenario, replace(request, state=replace(request.state, soc=0.9)), wind


def leg(composition: Composition, number: int, **changes) -> Composition:
    services = list(composition.services)
    services[number] = replace(services[number], **changes)
    return replace(composition, services=tuple(services))


def stop(composition: Composition, number: int, **changes) -> Composition:
    stops = list(composition.stops)
    stops[number] = replace(stops[number], **changes)
    return replace(composition, stops=tuple(stops))


WRONG = {
    "arrives later": lambda c: leg(c, -1, arrive=c.services[-1].arrive + LATER),
    "a leg lands earlier": lambda c: leg(c, 0, arrive=c.services[0].arrive - LATER),
    "takes off earlier": lambda c: leg(c, -1, depart=c.services[-1].depart - LATER),
    "lands with more charge": lambda c: leg(c, -1, soc_arrive=c.services[-1].soc_arrive + 0.001),
    "lands with a charge that is not a number": lambda c: leg(c, 0, soc_arrive=float("nan")),
    "takes off with more charge": lambda c: leg(c, -1, soc_depart=c.services[-1].soc_depart + 0.001),
    "less energy": lambda c: leg(c, 0, energy_j=0.99 * c.services[0].energy_j),
    "faster over the ground": lambda c: leg(c, 0, ground_speed_mps=c.services[0].ground_speed_mps + 0.2),
    "a shorter way": lambda c: leg(c, 0, distance_m=c.services[0].distance_m - 5.0),
    "another station": lambda c: leg(c, 0, destination=c.origin),
    "more charge in the same time": lambda c: stop(c, -1, soc_to=c.stops[-1].soc_to + 0.001),
    "no wait": lambda c: stop(c, -1, wait_s=c.stops[-1].wait_s - 3.0, hold_s=c.stops[-1].hold_s + 3.0),
    "less time on the pad": lambda c: stop(c, -1, recharge_s=c.stops[-1].recharge_s - 3.0),
    "a leg less": lambda c: replace(c, services=c.services[:-1]),
}


@pytest.mark.parametrize("planner", PLANNERS)
def test_what_each_planner_answers_is_flown_and_a_wrong_claim_is_refused(planner, monkeypatch):
    scenario, request, wind = delivery(planner)
    honest, judged = planning.audit, []
    monkeypatch.setattr(planning, "audit", lambda *one: judged.append(one))
    result = plan(scenario, request, planner=planner, forecast=wind)
    assert len(result.composition.services) > 1
    (composition, *beside), legs = judged[-1], len(result.composition.services)
    honest(composition, *beside)
    for name, spoil in WRONG.items():
        with pytest.raises(AuditError, match=f"plan of {planner} failed its audit") as caught:
            honest(spoil(composition), *beside)
        assert caught.value.planner == planner, name
        assert caught.value.leg is None or 1 <= caught.value.leg <= legs, name
        assert caught.value.exit_code == 1


@pytest.mark.parametrize("planner", PLANNERS)
def test_no_planner_returns_a_wrong_answer(planner, monkeypatch):
    scenario, request, wind = delivery(planner)
    told = planning.compose
    monkeypatch.setattr(planning, "compose", lambda *a, **k: leg(told(*a, **k), 0, ground_speed_mps=31.0))
    with pytest.raises(AuditError, match="leg 1: ground speed, m/s: claimed 31, flown ") as caught:
        plan(scenario, request, planner=planner, forecast=wind)
    assert (caught.value.leg, caught.value.claimed) == (1, 31.0)
    assert 5.0 < caught.value.flown < 30.0


@pytest.mark.parametrize("planner", CLAIRVOYANT_PLANNERS)
def test_a_search_that_says_it_arrives_earlier_than_it_flies_is_refused(planner, monkeypatch):
    scenario, request, wind = delivery(planner)
    search = {"exact": planning.ExactSearch, "ies": planning.ExhaustiveSearch}[planner]

    class Boastful(search):
        def solve(self):
            found = super().solve()
            stop_labels = self._stop_labels if planner == "ies" else self
            stop_labels.best_s -= 1.0
            return found

    monkeypatch.setattr(planning, search.__name__, Boastful)
    with pytest.raises(AuditError, match="arrival of the search"):
        plan(scenario, request, planner=planner, forecast=wind)


@pytest.mark.parametrize("planner", CLAIRVOYANT_PLANNERS)
def test_a_landing_below_the_reserve_is_never_called_proved(planner, monkeypatch):
    scenario, request, wind = delivery(planner)
    search = {"exact": planning.ExactSearch, "ies": planning.ExhaustiveSearch}[planner]

    class Careless(search):
        def solve(self):
            kept, self.problem.reserve = self.problem.reserve, 0.02
            self.__init__(self.problem, self.problem.queue_paths(range(len(self.problem.network)), 0))
            found = super().solve()
            self.problem.reserve = kept
            return found

    monkeypatch.setattr(planning, search.__name__, Careless)
    with pytest.raises(AuditError, match="reserve"):
        plan(scenario, request, planner=planner, forecast=wind)


SOME = pytest.mark.parametrize(
    ("seeds", "slots_min"), [(range(1), (60,)), pytest.param(range(20, 40), SLOTS_MIN, marks=pytest.mark.slow)]
)


@SOME
def test_honest_answers_pass_in_any_wind(seeds, slots_min):
    given = dict.fromkeys(PLANNERS, 0)
    for seed, slot_min, kind in itertools.product(seeds, slots_min, KINDS):
        problem, _ = instance(seed, slot_min, kind)
        for planner in PLANNERS:
            try:
                plan(problem.scenario, problem.request, planner=planner, forecast=problem.ensemble)
                given[planner] += 1
            except InfeasibleError:
                continue
    assert min(given.values()) >= len(seeds), given
    print(given)


@pytest.mark.parametrize("planner", ["shortest", "pfs", "pfs-charge-aware", "pfs-strict"])
def test_a_drone_in_the_air_is_never_said_to_hold_for_the_wind(planner):
    scenario, request, wind = delivery(planner)
    a, b = scenario.network.stations[:2]
    here = State(DEPART, None, (0.5 * (a.lat + b.lat), 0.5 * (a.lon + b.lon)), 0.8)
    request = replace(request, state=here, payload_kg=0.3)
    north = wind.north.copy()
    north[:3, 0] = 14.0  # above the limit now, in most of the forecast
    result = plan(scenario, request, planner=planner, forecast=replace(wind, north=north))
    assert result.composition.services[0].depart == DEPART
    assert result.outcome.p_arrive == pytest.approx(0.4, abs=0.05)
    assert any("cannot hold" in note for note in result.composition.notes)
    north[:, 0] = 14.0
    with pytest.raises(InfeasibleError, match="no station in reach" if planner == "pfs-strict" else "cannot hold"):
        plan(scenario, request, planner=planner, forecast=replace(wind, north=north))


def test_who_leaves_before_a_pad_is_free_is_not_said_to_have_waited_for_it():
    problem, _ = instance(303, 10, "short")
    told = plan(problem.scenario, problem.request, forecast=problem.ensemble).composition
    assert told.delivery_time_s == pytest.approx((told.arrive - told.depart).total_seconds(), abs=0.1)


def test_an_audit_takes_no_more_than_milliseconds(monkeypatch):
    spent = []
    honest = planning.audit

    def timed(*one):
        begun = time.thread_time()
        honest(*one)
        spent.append(time.thread_time() - begun)

    monkeypatch.setattr(planning, "audit", timed)
    scenario, request, wind = delivery("robust")
    for planner in ("pfs", "pfs-charge-aware", "shortest", "robust"):
        plan(scenario, request, planner=planner, forecast=wind)
    assert min(spent) < 0.005
