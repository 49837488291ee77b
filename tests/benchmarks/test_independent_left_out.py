"""Promises as flown, judged by leaving days out: the arithmetic, the days, and who decides."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.independent import left_out, study
from benchmarks.independent.information import LEVELS
from benchmarks.independent.product import planning, policies, supervised
from skyway.planner.evaluation.evaluate import held_out_forecast
from skyway.planner.online.information import Decision

DAY = np.arange(100, 160, 3)


@dataclass
class Route:
    services: Any


def test_simulated_deliveries_keep_the_quantiles_of_the_others_as_often_as_they_say():
    drawn = np.random.default_rng(1).lognormal(7.0, 1.0, len(DAY))
    itself = left_out.kept(drawn, drawn, DAY)
    assert itself.mean(axis=0) == pytest.approx(LEVELS)  # exactly so, whatever the values
    later = left_out.kept(drawn, 1.5 * drawn, DAY)
    assert (later.mean(axis=0) < LEVELS).all()
    assert (later <= itself).all()


def test_a_neighbouring_day_promises_nothing():
    close = np.arange(100, 104)
    due = np.array([1.0, 5.0, 2.0, 3.0])
    # day 101 is promised 103 alone, day 100 the days 102 and 103
    assert left_out.kept(due, np.array([2.5, 2.9, 9.0, 9.0]), close)[:2, 0].tolist() == [0.0, 1.0]


def test_many_arrivals_at_one_moment_are_promised_with_more_than_the_level():
    same = np.full(len(DAY), 600.0)
    assert left_out.kept(same, same, DAY).min() == 1.0
    assert left_out.kept(same, 600.0 * 1.001 * np.ones(len(DAY)), DAY).min() == 1.0  # the same, on another plane
    assert left_out.kept(same, np.full(len(DAY), 603.0), DAY).max() == 0.0


def test_a_report_tells_what_the_world_keeps_less_and_counts_who_never_comes(tmp_path, capsys):
    drawn = np.random.default_rng(2).lognormal(7.0, 1.0, len(DAY))
    late = np.where(drawn >= np.sort(drawn)[-4], np.inf, drawn)
    one = {
        "world": "ours", "order": {"seed": 0}, "flown": True, "day": DAY.tolist(), "simulated_s": drawn.tolist(),
        "flown_s": late.tolist(), "lowest": [0.3] * 19 + [0.1],
    }  # fmt: skip
    path = tmp_path / "flown.jsonl"
    few = left_out.LeftOut("new-york", "fly", 1, 20, 1, 150)
    study.append_line(path, few, one)
    study.append_line(path, few, one | {"flown": False, "world": "field"})
    assert left_out.main(["--worlds", "ours", "--requests", "1", "--out", str(path)]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert "50 %: 50.0 -> 50.0, +0.0" in line
    assert "95 %: 95.0 -> 80.0, -15.0" in line
    assert "not delivered 0 -> 4; below the reserve 1" in line


def test_what_was_flown_with_another_seed_or_other_orders_is_not_mixed_in(tmp_path):
    path = tmp_path / "flown.jsonl"
    study.append_line(path, left_out.LeftOut("new-york", "fly", 1, 20, 1, 150), {"world": "ours", "order": {"seed": 0}})
    for other in (["--seed", "151"], ["--days", "19"], ["--longest", "90"]):
        with pytest.raises(SystemExit, match="another study"):
            left_out.main(["--worlds", "ours", "--requests", "1", "--out", str(path), *other])


def test_a_day_laid_onto_an_order_is_the_member_of_its_forecast_with_that_date():
    (order,) = study.orders(study.Study("new-york", "fly", 1, 1, 1, 3))
    scenario, request = planning.told_scenario("new-york", ""), planning.request_of("new-york", order)
    forecast = held_out_forecast(scenario, request, ())
    raw = planning.city("new-york").sites[0]
    column = [site.id for site in scenario.wind_sites].index(raw.id)
    for k in range(0, len(forecast), 13):
        day = planning.date.fromisoformat(forecast.labels[k])
        hour = raw.latest(order.depart_s + planning.shift_s("new-york", order, day))
        assert [forecast.north[k, 0, column], forecast.east[k, 0, column]] == pytest.approx(raw.wind[hour], abs=0.05)


def test_who_was_turned_takes_off_again_when_the_gate_of_a_departure_lets_it():
    policy = object.__new__(policies.TurningRobust)
    policy.ends = [4, 7]
    policy.kept = SimpleNamespace(
        leave=lambda seen: "by the gate", in_air=SimpleNamespace(turns=lambda seen, places: places)
    )
    policy.policy = []  # a route without flights: by the plan there is nothing more to fly

    def after(*ends):
        return SimpleNamespace(flights=tuple(SimpleNamespace(end=end) for end in ends), origin=1)

    found = [policy.leave(after(*ends)) for ends in ((), (4,), (4, 7), (1,), (4, 4), (1, 4))]
    assert found == [None, None, None, "by the gate", "by the gate", "by the gate"]
    assert policy.aloft(after()) == (1,)


def test_the_gate_is_asked_for_the_leg_that_was_not_flown_and_again_where_it_stops():
    asked = []

    def keep(info, **_):
        asked.append(info.plan.services[0].destination)
        return Decision("stop" if len(asked) == 1 else "continue", "")

    legs = [SimpleNamespace(origin=a, destination=b, via=()) for a, b in (("a", "b"), ("b", "c"))]
    policy = object.__new__(supervised.Kept)
    policy.plan = Route(legs)
    network = SimpleNamespace(index={"a": 0, "b": 1, "c": 2}, first=[0, 1, 2, 2], head=np.array([1, 2]))
    policy.start = SimpleNamespace(network=network)
    policy.in_air = SimpleNamespace(policy=SimpleNamespace(keep_to_plan=keep))
    policy._information = lambda seen: SimpleNamespace(plan=Route(legs[1:]))
    policy._stay, policy._plan, policy._diverts = {}, {}, {}
    turned = tuple(SimpleNamespace(end=end) for end in (1, 1))  # it flew to b, and was turned back to b
    seen = SimpleNamespace(run=0, node=1, time_s=50.0, told=0.5, reports={"site": ()}, flights=turned, station="b")
    first, second = policy.leave(seen), policy.leave(seen)
    assert asked == ["c", "c"]
    assert (first.segments, first.look_s) == ((), 50.0 + supervised.REDECIDE_S)
    assert second.segments == (1,)
