"""Counting what was promised and kept, and going on where a run was stopped."""

import json
import math
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.independent import screening, study, worlds
from benchmarks.independent.__main__ import main
from benchmarks.independent.delivery import DELIVERED
from benchmarks.independent.statistics import wilson
from benchmarks.independent.told_arrivals import TOLD, told_arrivals
from benchmarks.independent.verdict import told_and_met, verdict

STUDY = study.Study("new-york", "robust", 2, 2, 2, 1)


def document(number, landings, delivery_s, day=(1, 1, 2, 2)):
    return {
        "world": "ours", "order": {"seed": number}, "planned": True, "promised_mean_s": 600.0,
        "promised_quantile_s": [500.0, 700.0, 900.0], "promised": [0.5, 0.8, 0.95], "promised_reserve": 0.999,
        "day": list(day), "ending": ["delivered" if one is not None else "stranded" for one in delivery_s],
        "delivery_s": delivery_s, "landings": landings, "weight": [1.0] * len(day), "run": [0] * len(day),
    }  # fmt: skip


def test_a_verdict_counts_deliveries_landings_and_promises():
    found = verdict([
        document(0, [[0.3, 0.19], [0.2], [0.5], [-0.1]], [480.0, 600.0, 800.0, None]),
        document(1, [[0.3], [0.25], [0.5], [0.4]], [400.0, 400.0, 400.0, 1000.0]),
        {"world": "ours", "order": {"seed": 2}, "planned": False},
    ])  # fmt: skip
    assert (found.orders, found.unplanned, found.deliveries, found.landings) == (2, 1, 8, 9)
    assert (found.below_count, found.below_landings, found.stranded, found.not_delivered) == (2, 2, 1, 0)
    assert found.below == pytest.approx(0.25)
    assert found.lowest[0] == pytest.approx(-0.1)
    assert found.mean_min == pytest.approx(np.mean([480, 600, 800, 400, 400, 400, 1000]) / 60.0)
    assert [kept for _, _, kept, _ in found.on_time] == pytest.approx([4 / 8, 5 / 8, 6 / 8])
    assert found.promised_below == pytest.approx(0.001)
    assert "below 25.00" in found.line()
    assert not math.isnan(found.below_days[0])


def test_a_delivery_that_stands_for_others_counts_for_them():
    one = document(0, [[0.19], [0.3], [0.3], [0.3]], [400.0, 600.0, 600.0, 1000.0]) | {"weight": [1.0, 9.0, 5.0, 5.0]}
    found = verdict([one])
    assert (found.deliveries, found.stands_for, found.below_count) == (4, 20.0, 1)
    assert found.below == pytest.approx(1.0 / 20.0)
    assert found.mean_min * 60.0 == pytest.approx((400.0 + 14.0 * 600.0 + 5.0 * 1000.0) / 20.0)
    assert [kept for _, _, kept, _ in found.on_time] == pytest.approx([1 / 20, 15 / 20, 15 / 20])
    low, high = found.below_wilson
    assert low < 1.0 / 20.0 < high


def test_arrivals_told_on_the_way_are_counted_at_the_first_decision_and_at_all():
    told = [[[0.0, 390.0, 500.0], [300.0, 450.0, 460.0]], [[0.0, 700.0, 900.0]], [], [[0.0, 300.0, 400.0]]]
    one = document(0, [[0.3]] * 4, [400.0, 600.0, 600.0, None]) | {TOLD: told}
    first, every = told_arrivals([one, document(1, [[0.3]] * 4, [400.0] * 4)])
    assert (first.deliveries, first.told, every.told) == (3, 3, 4)
    assert (first.half[0], first.most[0]) == pytest.approx((1 / 3, 2 / 3))
    assert (every.half[0], every.most[0]) == pytest.approx((2 / 4, 3 / 4))
    assert told_arrivals([document(1, [[0.3]] * 4, [400.0] * 4)]) == []
    assert "50 % kept 33.33" in first.line()


def test_all_deliveries_near_the_reserve_are_flown_and_a_share_of_the_others_that_stands_for_them(monkeypatch):
    ends = [(DELIVERED, [0.5, 0.21]), ("stranded", [-1.0]), *[(DELIVERED, [0.3])] * 50]
    flown = [SimpleNamespace(ending=ending, landings=landings) for ending, landings in ends]
    monkeypatch.setattr(screening, "deliver", lambda *_: flown)
    seeds = [(1, number) for number in range(len(ends))]
    runs, weight, lowest = screening.chosen(None, None, None, 0.1, seeds)
    assert runs[:2].tolist() == [0, 1]
    assert weight.tolist() == [1.0, 1.0, *[10.0] * 5]
    assert weight.sum() == len(ends)
    assert lowest[:3].tolist() == [0.21, -1.0, 0.3]
    few, weight, _ = screening.chosen(None, None, None, 0.001, seeds)
    assert (len(few), weight.sum()) == (3, len(ends))


def test_what_was_flown_is_read_again_but_not_that_of_another_study(tmp_path):
    path = tmp_path / "flown.jsonl"
    lines = [json.dumps(asdict(STUDY)), json.dumps(document(0, [[0.3]] * 4, [1.0] * 4)), '{"world": "ours", "or']
    path.write_text("\n".join(lines), encoding="utf-8")
    assert [one["order"]["seed"] for one in study.read_lines(path, STUDY)] == [0]
    other = study.Study("new-york", "robust", 3, 2, 2, 1)
    with pytest.raises(SystemExit, match="another study"):
        study.read_lines(path, other)
    assert study.read_lines(tmp_path / "none", STUDY) == []
    for number in (1, 2):
        study.append_line(path, STUDY, document(number, [[0.3]] * 4, [1.0] * 4))
    assert [one["order"]["seed"] for one in study.read_lines(path, STUDY)] == [0, 1, 2]


def test_orders_are_drawn_from_their_seed_within_the_record():
    first = list(study.orders(STUDY))
    assert first == list(study.orders(STUDY))
    more = list(study.orders(study.Study("new-york", "robust", 5, 2, 2, 1)))
    assert more[:2] == first
    written = study.Study("new-york", "robust", 1, 2, 2, 1, "bellevue,jacobi,2013-07-10T14:00-04:00,0.8")
    (one,) = study.orders(written)
    assert (one.origin, one.destination, one.depart_s, one.payload_kg) == ("bellevue", "jacobi", 1373479200.0, 0.8)
    assert all(one.origin != one.destination and one.depart_s % 3600.0 == 0.0 for one in more)


def test_an_unknown_world_is_refused_with_those_that_there_are(capsys):
    with pytest.raises(SystemExit):
        main(["--worlds", "ours,theirs"])
    told = capsys.readouterr().err
    assert "no such world: theirs" in told
    assert "without-JFK" in told


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--runs", "0", "--runs is 1 or more"),
        ("--flown-runs", "-1", "--flown-runs is 0 or more"),
        ("--requests", "many", "--requests: invalid int value: 'many'"),
        ("--share", "1.5", "--share is from 0 to 1"),
        ("--share", "nan", "--share is from 0 to 1"),
        ("--days", "13", "--days is 1 to 12"),
    ],
)
def test_a_number_out_of_its_range_is_refused_with_the_range(option, value, said, capsys):
    with pytest.raises(SystemExit):
        main([option, value])
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_planned_with_the_weather_of_now_each_day_has_a_promise_of_its_own_that_is_narrower():
    asked = "bellevue,jacobi,2013-07-10T14:00-04:00,0.8"
    usual = study.Study("new-york", "robust", 1, 2, 2, 1, asked)
    now = replace(usual, now=True)
    (order,) = study.orders(usual)
    (season,) = study.fly_order(usual, order, [worlds.OURS])
    days = list(study.fly_order(now, order, [worlds.OURS]))
    assert len(days) == now.documents == 2
    assert [one["day"] for one in days] == [season["day"][:2], season["day"][2:]]
    assert days[0]["promised_mean_s"] != days[1]["promised_mean_s"]

    def width(found):
        return found["promised_quantile_s"][-1] - found["promised_quantile_s"][0]

    assert min(map(width, days)) < width(season)


def test_what_fixed_routes_tell_is_put_beside_what_becomes_of_them_by_what_is_told():
    often = document(0, [[0.3]] * 4, [400.0] * 4) | {
        "told_below": 0.05, "route_day": [1, 1, 2, 2], "route_lowest": [0.19, 0.3, -0.2, None],
    }  # fmt: skip
    never = document(1, [[0.3]] * 4, [400.0] * 4) | {
        "told_below": 0.0, "route_day": [1, 1, 2, 2], "route_lowest": [0.5] * 4,
    }  # fmt: skip
    rare, found = told_and_met([often, never, {"world": "ours", "order": {"seed": 2}, "planned": False}])
    assert (rare.low, rare.high, rare.orders, rare.deliveries, rare.met) == (0.0, 0.001, 1, 4, 0.0)
    assert (found.low, found.high, found.orders, found.deliveries) == (0.03, 0.1, 1, 3)  # one was never delivered
    assert (found.told, found.met) == (pytest.approx(0.05), pytest.approx(2 / 3))
    assert "told 5.00 %, met 66.67" in found.line()


def test_an_interval_by_order_and_day_takes_deliveries_of_one_for_one_throw():
    alike = verdict([document(number, [[0.3]] * 4, [400.0] * 4) for number in range(10)])  # twenty orders and days
    assert alike.below_wilson[1] == pytest.approx(wilson(0, 40)[1])
    assert alike.below_blocks[1] == pytest.approx(wilson(0, 20)[1])


def test_files_of_several_seeds_are_summed_up_together(tmp_path, capsys):
    paths = []
    for seed in (1, 2):
        paths.append(tmp_path / f"flown{seed}.jsonl")
        one = document(0, [[0.3], [0.19], [0.3], [0.3]], [400.0] * 4)
        head = json.dumps(asdict(replace(STUDY, seed=seed)))
        paths[-1].write_text(f"{head}\n{json.dumps(one)}\n", encoding="utf-8")
    assert main(["--merge", *map(str, paths)]) == 0
    ours, together = capsys.readouterr().out.splitlines()
    assert ours.startswith("ours")
    assert together.startswith("all of these")
    assert "2 of 2 orders" in ours
    assert "2 below 25.00" in ours
