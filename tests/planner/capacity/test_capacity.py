"""Studies of what a network carries: days are drawn and simulated the same way everywhere, and figures are what they say."""

from dataclasses import replace
from datetime import date, datetime
from functools import partial
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.cli.commands.fleet.capacity_view import print_capacity
from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import coarse_distance_m
from skyway.models.compute.spreading import spread
from skyway.models.orders.files import order_of
from skyway.planner.capacity.changes import PADS_OF_NEW, Change, changed
from skyway.planner.capacity.day import Case, DayDone, Piece, Study, simulate
from skyway.planner.capacity.demand import Demand, drones_of, orders_of, pattern_of
from skyway.planner.capacity.execution import carry_out
from skyway.planner.capacity.study import APART_M, candidates, document_of, find_capacity
from skyway.scenarios import load_scenario

ZONE = ZoneInfo("America/New_York")
BEGIN = datetime(2013, 7, 10, 14, tzinfo=ZONE)
DAYS = (date(2013, 7, 4), date(2013, 7, 19), date(2013, 8, 1))


@pytest.fixture(scope="module")
def scenario():
    return load_scenario(None)


@pytest.fixture(scope="module")
def study(scenario):
    demand = Demand(most_per_h=30.0, hours=1.0)
    return Study(scenario=None, digest=scenario.sha256, begin=BEGIN, days=DAYS, demand=demand, drone="m200", seed=7)


def day_done(orders, on_time, missed=()):
    return DayDone(
        orders=orders, promised=orders, delivered=on_time, on_time=on_time, stated=float(on_time), waited_s=0.0, delivery_s=0.0, landings=1, below=0, missed=missed
    )  # fmt: skip


def test_a_pattern_of_orders_that_the_drone_does_not_carry_is_refused(scenario):
    values = {"id": "a", "from": "bellevue", "to": "jacobi", "mass_kg": 3, "ready": "2013-07-10T14:00Z", "due": "2013-07-10T16:00Z"}  # fmt: skip
    with pytest.raises(InputError, match="mass_kg: is heavier than m200 carries") as caught:
        pattern_of(scenario, [order_of(values, "the order")], scenario.drone("m200"))
    assert "up to 1.45 kg" in str(caught.value)


def test_more_orders_and_one_drone_more_leave_the_others_as_they_are(scenario):
    demand = Demand(most_per_h=100.0, hours=2.0)
    few, many = (orders_of(scenario, demand, rate, 3600.0, BEGIN, 1, 0, 0.8) for rate in (20.0, 80.0))
    assert {one.id for one in few} < {one.id for one in many}
    same = {one.id: one for one in many}
    assert all(same[one.id] == one for one in few)
    assert 100 < len(many) < 220
    assert all((one.due - one.ready).total_seconds() == 3600.0 for one in many)
    stations = {one.id: one for one in scenario.network.stations}
    for one in many:
        a, b = stations[one.origin], stations[one.destination]
        far_m = float(coarse_distance_m(a.lat, a.lon, b.lat, b.lon))
        assert 0.0 < far_m <= 20_000.0 or far_m <= 60_000.0  # the nearest, where none is within
    fleet = drones_of(scenario, "m200", 30, 1, 0)
    assert drones_of(scenario, "m200", 30, 1, 0, ("bellevue",))[:30] == fleet
    assert drones_of(scenario, "m200", 30, 1, 1) != fleet


def test_a_day_is_the_same_each_time_and_its_counts_fit_together(study):
    piece = Piece(study=study, case=Case(rate_per_h=30.0, promise_s=5400.0, drones=20), day=1)
    done = simulate(piece, load_scenario)
    assert simulate(piece, load_scenario) == done
    assert 0 < done.on_time <= done.delivered <= done.promised <= done.orders
    assert len(done.missed) == done.orders - done.on_time
    assert done.below <= done.landings
    assert done.delivery_s / done.delivered < 5400.0 + 3600.0
    nobody = replace(piece, case=replace(piece.case, promise_s=60.0))
    assert simulate(nobody, load_scenario).promised == 0, "nothing is there within a minute"
    with pytest.raises(InputError, match="other files of the scenario"):
        simulate(replace(piece, study=replace(study, digest="another")), load_scenario)


def test_what_is_added_is_there(scenario):
    change = Change(pads=("bellevue", "bellevue"), stations=(("new-1", 40.72, -73.82),), drones=("jacobi",))
    after = changed(scenario, change)
    pads = {one.id: one.pads for one in after.network.stations}
    before = {one.id: one.pads for one in scenario.network.stations}
    assert pads == {**before, "bellevue": before["bellevue"] + 2, "new-1": PADS_OF_NEW}
    node = after.network.index["new-1"]
    assert (after.network.tail == node).any()
    assert after.load.arrivals_per_s[node].sum() == 0.0
    assert changed(scenario, Change()) is scenario


def fake(share):
    """A run whose days have 100 orders, of which a share by the rate is on time; a pad more at jacobi helps."""

    def run(pieces):
        return [
            day_done(100, min(100, round(100 * share(one.case.rate_per_h)) + 7 * (one.case.change.pads == ("jacobi",))))
            for one in pieces
        ]

    return run


def test_the_capacity_is_where_the_share_falls_below_the_level(scenario, study):
    def find(share, **more):
        return find_capacity(study, [10, 20, 40], [3600.0], [20], days=3, level=0.9, run=fake(share), **more)

    found = find(lambda rate: 1.0 - 0.005 * rate, network=scenario.network)
    assert found.capacities[0].rate_per_h == pytest.approx(20.0)
    assert found.capacities[0].low_per_h == pytest.approx(10.0 + 10.0 * (0.9196 - 0.9) / (0.9196 - 0.8608), abs=0.1), (
        "Wilson: of 300 orders"
    )
    assert 20.0 < found.capacities[0].high_per_h < 40.0
    assert found.base.case.rate_per_h == 20
    assert str(found.effects[0].change) == "a pad more at jacobi"
    assert found.effects[0].per_h == pytest.approx(7.0)
    assert found.effects[0].sure
    assert not any(one.sure for one in found.effects[1:])
    assert found.days_simulated == 3 * (3 + len(found.effects))
    assert document_of(found)["capacities"][0]["orders_per_h"] == pytest.approx(20.0)
    assert np.isnan(find(lambda rate: 0.5, network=None).capacities[0].rate_per_h)
    beyond = find(lambda rate: 0.95, network=None).capacities[0]
    assert (beyond.rate_per_h, beyond.beyond) == (40.0, True)


def test_a_capacity_beyond_the_highest_rate_has_no_upper_end(study, capsys):
    def told(share, days=300):
        found = find_capacity(study, [10, 40], [3600.0], [1], days=days, level=0.9, network=None, run=fake(share))
        print_capacity(found, 1.0)
        return " ".join(capsys.readouterr().out.split())  # of terminals of any width

    whose = "1 drone, due 1 h after they are ready, 1 h of orders a day:"
    assert f"{whose} 40.0 orders an hour or more (95 %: at least 40.0)." in told(lambda rate: 0.95)
    assert "20.0 orders an hour (95 %: 19.4 to 20.6)." in told(lambda rate: 1.0 - 0.005 * rate)
    few = told(lambda rate: 1.0 - 0.005 * rate, days=3)
    assert "20.0 orders an hour (95 %: 13.4 to 26.3). 6 days of 1 h simulated in the wind of 3 days" in few
    assert "90 % as promised is not reached even at the lowest rate (95 %: at most 10.0)." in told(lambda rate: 0.5)
    assert "(95 %: too few days to tell)." in told(lambda rate: 0.92, days=2)


def scattered(shares):
    """A run whose days of 50 orders have other shares on time, one after another."""
    return lambda pieces: [day_done(50, round(50 * shares[one.day % len(shares)])) for one in pieces]


def test_shares_of_a_few_days_are_as_unsure_as_so_few_days_are(study):
    def served(shares, days):
        run = scattered(shares)
        return find_capacity(study, [10], [3600.0], [1], days=days, level=0.9, network=None, run=run).cases[0]

    two = served([0.8, 0.9], 2)
    assert two.served == pytest.approx(0.85)
    assert two.served_between == (pytest.approx(0.85 - 12.7062 * 0.05, abs=1e-5), 1.0), "Student's t of two days"
    alike = served([0.8], 2)
    assert alike.served_sd == 0.0
    assert alike.served_between == pytest.approx((0.7112, 0.8666), abs=1e-4), "Wilson's interval of 80 of 100"
    assert served([1.0], 2).served_between == (pytest.approx(0.963, abs=1e-3), 1.0)


def test_days_with_the_same_wind_count_as_one(study):
    few, many = (
        find_capacity(study, [10], [3600.0], [1], days=days, level=0.9, network=None, run=scattered([0.2, 0.5, 0.9]))
        for days in (3, 300)
    )
    assert (few.winds, many.winds) == (3, 3) == (len(DAYS), len(DAYS))
    assert many.cases[0].served_between == pytest.approx(few.cases[0].served_between)
    assert document_of(many)["winds"] == 3
    alone = replace(study, days=DAYS[:1])
    one = find_capacity(alone, [10], [3600.0], [1], days=9, level=0.9, network=None, run=scattered([0.2, 0.95]))
    assert np.isnan(one.cases[0].served_between).all()
    assert document_of(one)["cases"][0]["served_low"] is None


def test_a_gain_that_two_days_agree_on_by_chance_is_not_sure(scenario, study):
    def run(pieces):
        return [day_done(20, 10 + (one.case.change.pads == ("jacobi",))) for one in pieces]

    def best(days):
        many = replace(study, days=tuple(date.fromordinal(DAYS[0].toordinal() + one) for one in range(days)))
        return find_capacity(
            many, [10], [3600.0], [1], days=days, level=0.4, network=scenario.network, run=run
        ).effects[0]

    assert (best(2).per_h, best(2).sd_per_h, best(2).sure) == (1.0, 0.0, False)
    assert best(2).half_per_h == pytest.approx(12.706 / 2.0, rel=1e-3)
    assert best(20).sure


def test_a_capacity_is_the_first_rate_below_the_level_also_if_a_later_one_is_above(study):
    share = {10: 0.95, 20: 0.85, 40: 0.95}
    found = find_capacity(study, [10, 20, 40], [3600.0], [1], days=3, level=0.9, network=None, run=fake(share.get))
    assert found.capacities[0].rate_per_h == pytest.approx(15.0)
    assert not found.capacities[0].beyond


def test_days_without_orders_tell_nothing_of_a_capacity(study, capsys):
    def none(pieces):
        return [day_done(0, 0) if one.case.rate_per_h < 20 else day_done(100, 95) for one in pieces]

    found = find_capacity(study, [10, 20], [3600.0], [1], days=3, level=0.9, network=None, run=none)
    assert (found.capacities[0].rate_per_h, found.capacities[0].beyond) == (20.0, True)
    nobody = find_capacity(study, [10], [3600.0], [1], days=3, level=0.9, network=None, run=none)
    assert np.isnan(nobody.capacities[0].rate_per_h)
    print_capacity(nobody, 1.0)
    assert "no orders came on these days" in " ".join(capsys.readouterr().out.split())
    case = document_of(nobody)["cases"][0]
    assert (case["orders"], case["served"], case["served_low"]) == (0, None, None)


def test_other_drones_come_until_the_last_order_is_due(study, monkeypatch):
    came = []

    def seen(routes, ready_s, pads, others, begin_s, *more):
        came.append(max(at_s for one in others.values() for at_s, _ in one) - begin_s)
        return carry_out(routes, ready_s, pads, others, begin_s, *more)

    monkeypatch.setattr("skyway.planner.capacity.day.carry_out", seen)
    long = replace(study, demand=Demand(most_per_h=2.0, hours=12.0))
    for promise_h in (1.5, 6.0):
        case = Case(rate_per_h=2.0, promise_s=3600.0 * promise_h, drones=20)
        simulate(Piece(study=long, case=case, day=1), load_scenario)
    assert came[0] == pytest.approx(15 * 3600.0, abs=600.0)
    assert came[1] == pytest.approx(19 * 3600.0, abs=600.0)


def test_a_day_without_promises_leaves_those_of_other_days_stated(study):
    piece = Piece(study=study, case=Case(rate_per_h=30.0, promise_s=60.0, drones=20), day=1)
    nobody = simulate(piece, load_scenario)
    assert (nobody.promised, nobody.stated) == (0, 0.0)


@settings(max_examples=25)
@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=6), st.floats(0.05, 0.95))
def test_whatever_the_shares_the_capacity_is_between_its_neighbours(shares, level):
    rates = [10.0 * (one + 1) for one in range(len(shares))]
    by_rate = dict(zip(rates, shares, strict=True))
    study = Study(scenario=None, digest="", begin=BEGIN, days=DAYS, demand=Demand(most_per_h=1.0), drone="m200")
    run = fake(lambda rate: by_rate[rate])
    one = find_capacity(study, rates, [3600.0], [1], days=2, level=level, network=None, run=run).capacities[0]
    counted = [round(100 * share) / 100 for share in shares]
    if counted[0] < level:
        assert np.isnan(one.rate_per_h)
        return
    first = next((number for number, share in enumerate(counted) if share < level), len(rates))
    assert rates[first - 1] <= one.rate_per_h <= rates[min(first, len(rates) - 1)]
    assert one.beyond == all(share >= level for share in counted)


def test_stations_are_tried_where_orders_were_missed_and_apart(scenario):
    days = [day_done(9, 0, (("bellevue", "jones-beach"), ("st-francis", "bayonne"), ("nowhere", "bellevue")) * 3)]
    ids = [one.id for one in scenario.network.stations]
    ways = tuple((a, b) for a in ids[:12] for b in ids[-12:] if a != b)
    found = candidates(scenario.network, [*days, day_done(9, 0, ways)])
    assert 1 <= len(found) <= 8
    lat, lon = scenario.network.lat, scenario.network.lon
    for number, (a, b) in enumerate(found):
        others = [one for other, one in enumerate(found) if other != number]
        far = coarse_distance_m(a, b, [*lat, *(one[0] for one in others)], [*lon, *(one[1] for one in others)])
        assert far.min() >= APART_M


@pytest.mark.slow
def test_processes_and_a_cluster_find_the_very_same_figures(study):
    distributed = pytest.importorskip("distributed", reason="Dask: pip install 'skyway-planner[cluster]'")
    work = partial(simulate, load=load_scenario)
    cases = [Case(rate_per_h=rate, promise_s=5400.0, drones=15) for rate in (10.0, 30.0)]
    pieces = [Piece(study=study, case=case, day=day) for case in cases for day in range(3)]
    alone = spread(work, pieces)
    backwards = spread(work, pieces[::-1], workers=2)
    assert backwards[::-1] == alone
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        lost = []

        def told(done, _total, _left_s):
            if not lost:  # one of the workers is killed in the middle of it
                lost.append(done)
                next(iter(cluster.workers.values())).process.process.kill()

        assert spread(work, pieces, cluster=cluster.scheduler_address, told=told) == alone
    assert lost
