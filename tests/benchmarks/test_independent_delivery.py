"""Deliveries in the independent world: what a policy is told, what a flight costs, and how a delivery ends."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.independent import build, delivery, flight, ground, statistics, worlds
from benchmarks.independent.information import HERE, Leave, Order
from benchmarks.independent.pads import Stations
from benchmarks.independent.vehicle import battery, craft, energy
from benchmarks.independent.weather import profile, reports

SHEET = energy.DataSheet(4.69, 1.45, 349.3 * 3600.0, 2280.0, 1440.0, 8064.0, 20.0, 20.0)
HOW = craft.Flying(20.0, 20.0, 5.0, 3.0, 60.0)
DEPART_S = 1373_472_000.0  # 2013-07-10T16:00Z


def line_of_stations(busy_per_h=0.0, pads=2, spots=9):
    """Three stations 8 km apart from south to north."""
    rate = np.full((3, 168), busy_per_h / 3600.0)
    return ground.Ground(
        ids=("a", "b", "c"), plane=ground.Plane(40.7, -74.0), xy=np.array([[0.0, 0.0], [8000.0, 0.0], [16000.0, 0.0]]),
        pads=np.full(3, pads), spots=np.full(3, spots), tail=np.array([0, 1]), head=np.array([1, 2]),
        arrivals_per_s=rate, charging_s=np.full((3, 168), 3600.0), timezone="UTC",
    )  # fmt: skip


def city(area, sites=None):
    sites = reports.new_york() if sites is None else sites
    return build.City(
        "line", sites, area, SHEET, HOW, 0.2, lambda kg: energy.Flat(SHEET, kg), (12, 24)
    )  # fmt: skip


class Still:
    by_segment = False

    def at(self, xy, elapsed_s):
        return np.zeros((len(xy), 2))


class NoGusts:
    def step(self, path_m, mean_mps, dt_s):
        return np.zeros((len(path_m), 2))


def calm(world=worlds.OURS, runs=2, area=None):
    """A setting without wind, gusts and errors of energy."""
    order = Order("a", "c", DEPART_S, 0.8)
    made = build.setting_for(
        world, city(area or line_of_stations()), order, np.zeros(runs), [(1, k) for k in range(runs)]
    )
    air = craft.Air(Still(), profile.PowerLaw(0.2), 60.0)
    return replace(made, air=air, gusts=lambda _: NoGusts(), vehicle=np.ones(runs)), order


class Hops:
    """Leaves each stop with a charge, a segment or two at a time, and remembers what it saw."""

    def __init__(self, ways, charge=0.0, land=False, turns=None, again=None):
        self.ways, self.charge, self.land, self.seen, self.overs = ways, charge, land, [], []
        self.turns, self.again, self.looks = turns or {}, again or {}, []

    def leave(self, seen):
        self.seen.append(seen)
        way = self.ways[len(seen.flights)]
        return None if way is None else Leave(way, self.charge)

    def over(self, seen, rest):
        self.overs.append(seen)
        return () if self.land else rest

    watches = True

    def aloft(self, seen):
        self.looks.append(seen)
        station, after_m = self.turns.get(len(seen.flights), (None, math.inf))
        if seen.turned is not None:
            return self.again.get(seen.turned)
        return station if 8000.0 * (seen.segment + seen.share) >= after_m - 1e-6 else None


FLIGHT_S = 8000.0 / 20.0 + 12.0 + 20.0


def test_a_delivery_in_still_air_takes_its_closed_form_and_conserves_energy():
    setting, order = calm()
    share = SHEET.hover_w(0.8) * FLIGHT_S / SHEET.battery_j
    policy = Hops([(0,), (1,)], charge=1.0)
    for run in delivery.deliver(setting, order, policy):
        assert run.ending == delivery.DELIVERED
        assert run.landings == pytest.approx([1.0 - share, 1.0 - share])
        curve = setting.charging
        charging = curve.time_s(1.0) - curve.time_s(1.0 - share)
        assert run.time_s - DEPART_S == pytest.approx(2 * FLIGHT_S + charging, abs=1e-3)
        assert run.flights[0].told_off - run.flights[0].told_down == pytest.approx(share)


def test_a_station_may_be_overflown_or_landed_at():
    setting, order = calm()
    policy = Hops([(0, 1)])
    for run in delivery.deliver(setting, order, policy):
        assert run.time_s - DEPART_S == pytest.approx(16000.0 / 20.0 + 32.0)
    assert [seen.station for seen in policy.overs] == ["b", "b"]
    landing = Hops([(0, 1), (1,)], land=True)
    for run in delivery.deliver(setting, order, landing):
        assert [flight.segments for flight in run.flights] == [(0,), (1,)]


def test_a_drone_may_turn_back_and_try_again():
    setting, order = calm(runs=1)
    policy = Hops([(0, 1), (0, 1)], turns={0: (0, 3000.0)})
    (run,) = delivery.deliver(setting, order, policy)
    assert [(one.origin, one.end, one.segments) for one in run.flights] == [(0, 0, ()), (0, 2, (0, 1))]
    back_s = 2 * 3000.0 / 20.0 + 32.0
    assert run.flights[0].down_s - DEPART_S == pytest.approx(back_s)
    assert run.landings[0] == pytest.approx(1.0 - SHEET.hover_w(0.8) * back_s / SHEET.battery_j)
    assert run.ending == delivery.DELIVERED


def test_a_drone_may_turn_to_another_station_or_land_where_it_is():
    setting, order = calm(runs=1)
    policy = Hops([(0, 1), (1,)], turns={0: (1, 8900.0)})  # over b and 900 m on, back to b
    (run,) = delivery.deliver(setting, order, policy)
    assert [(one.origin, one.end, one.segments) for one in run.flights] == [(0, 1, (0,)), (1, 2, (1,))]
    assert run.flights[0].down_s - DEPART_S == pytest.approx((8900.0 + 900.0) / 20.0 + 32.0)
    (run,) = delivery.deliver(setting, order, Hops([(0, 1)], turns={0: (HERE, 3000.0)}))
    assert run.ending == delivery.STRANDED
    assert run.flights[0].down_s - DEPART_S == pytest.approx(3000.0 / 20.0 + 32.0)


def test_a_drone_is_asked_on_its_way_back_too_and_may_be_turned_again():
    setting, order = calm(runs=1)
    policy = Hops([(0, 1), None], turns={0: (0, 3000.0)})
    (run,) = delivery.deliver(setting, order, policy)
    plane = setting.ground.plane
    back = [one for one in policy.looks if one.turned == 0]
    north_m = [float(plane.xy(*one.place)[0]) for one in back]
    assert north_m == pytest.approx(np.arange(2700.0, 200.0, -300.0), abs=0.1)
    assert {one.segment for one in back} == {0}
    assert [one.share for one in back] == pytest.approx([3000.0 / 8000.0] * 9)
    assert [len(one.pieces) for one in back] == list(range(11, 20))
    again = Hops([(0, 1), None], turns={0: (0, 3000.0)}, again={0: 1})
    (run,) = delivery.deliver(setting, order, again)
    assert [(one.origin, one.end) for one in run.flights] == [(0, 1)]
    assert run.flights[0].down_s - DEPART_S == pytest.approx((3000.0 + 300.0 + 5300.0) / 20.0 + 32.0)


def test_a_drone_on_its_way_knows_what_it_measured_and_where_it_is():
    setting, order = calm(runs=1)
    policy = Hops([(0, 1)])
    delivery.deliver(setting, order, policy)
    way_m = [8000.0 * (one.segment + one.share) for one in policy.looks]
    assert np.diff(way_m) == pytest.approx(flight.LOOK_M, rel=0.5)
    assert {one.origin for one in policy.looks} == {0}
    for one in policy.looks:
        assert len(one.pieces) == policy.looks.index(one) + 1
        assert one.pieces[-1].wind == (0.0, 0.0)
        assert one.told_off - one.told == pytest.approx(
            SHEET.hover_w(0.8) * (one.time_s - one.off_s) / SHEET.battery_j, abs=1e-9
        )
    middles = [float(setting.ground.plane.xy(*piece.place)[0]) for piece in policy.looks[-1].pieces]
    assert middles[0] == pytest.approx(flight.LOOK_M / 2)
    assert np.all(np.diff(middles) > 0.0)


def test_who_flies_too_far_is_stranded_and_who_gives_up_has_given_up():
    setting, order = calm()
    setting = replace(setting, batteries=battery.new(2, 0.3 * SHEET.battery_j))
    assert {run.ending for run in delivery.deliver(setting, order, Hops([(0, 1)]))} == {delivery.STRANDED}
    assert {run.ending for run in delivery.deliver(setting, order, Hops([None]))} == {delivery.GAVE_UP}


def test_a_drone_hovers_while_pads_and_spots_are_taken():
    area = line_of_stations(busy_per_h=4.0, pads=2, spots=0)
    setting, order = calm(area=area, runs=20)
    runs = delivery.deliver(setting, order, Hops([(0,), (1,)]))
    hovered = [run.flights[0].hovered_s for run in runs]
    assert max(hovered) > 600.0
    for run, stations in zip(runs, setting.stations, strict=True):
        first = run.flights[0]
        came = first.down_s - first.hovered_s
        assert stations.line(1).before(came, first.down_s) <= 1  # as soon as one of two pads is left to it
        used = SHEET.hover_w(0.8) * (FLIGHT_S + first.hovered_s) / SHEET.battery_j
        assert run.landings[0] == pytest.approx(1.0 - used)


@pytest.mark.parametrize("name", ["ours", "observed-lines", "all"])
def test_a_drone_is_told_only_reports_that_are_out(name):
    world = worlds.worlds(("EWR", "JFK", "LGA"))[name]
    shift = np.array([0.0, 86_400.0])
    order = Order("a", "c", DEPART_S, 0.8)
    setting = build.setting_for(world, city(line_of_stations()), order, shift, [(1, 0), (1, 1)])
    policy = Hops([(0,), (1,)], charge=0.95)
    delivery.deliver(setting, order, policy)
    assert {seen.run for seen in policy.seen} == {0, 1}
    for seen in policy.seen:
        for site in setting.told:
            observed, north, east = seen.reports[site.id]
            k = int(np.searchsorted(site.time_s, observed + shift[seen.run]))
            assert site.time_s[k] == pytest.approx(observed + shift[seen.run])
            assert site.out_s[k] - shift[seen.run] <= seen.time_s
            assert (north, east) == pytest.approx(tuple(site.wind[k]))


def test_the_site_kept_back_blows_but_is_not_told():
    world = worlds.worlds(("EWR", "JFK", "LGA"))["without-JFK"]
    order = Order("a", "c", DEPART_S, 0.8)
    area = line_of_stations()
    jfk = reports.new_york()[1]
    area = replace(area, xy=area.plane.xy([jfk.lat, jfk.lat + 0.01, jfk.lat + 0.02], [jfk.lon] * 3))
    setting = build.setting_for(world, city(area), order, np.zeros(1), [(1, 0)])
    assert [site.id for site in setting.told] == ["EWR", "LGA"]
    k = jfk.latest(DEPART_S)
    assert setting.air.wind.at(area.xy[:1], np.zeros(1))[0] == pytest.approx(jfk.wind[k], abs=1e-3)


@pytest.mark.parametrize("name", sorted(worlds.worlds(("EWR", "JFK", "LGA"))))
def test_every_world_flies_and_the_same_seed_gives_the_same(name):
    world = worlds.worlds(("EWR", "JFK", "LGA"))[name]
    order = Order("a", "c", DEPART_S, 0.8)

    def once():
        seeds = [(1, k) for k in range(3)]
        setting = build.setting_for(world, city(line_of_stations(0.3)), order, np.array([0.0, 0.0, 864e3]), seeds)
        return [run.landings for run in delivery.deliver(setting, order, Hops([(0,), (1,)], charge=0.9))]

    first = once()
    assert first == once()
    assert all(len(one) == 2 for one in first)
    if name != "plant":  # as flat as ours in this test
        assert world.deviations or name == "ours"
    assert world.counted_on == (not world.deviations)


def test_a_pad_out_of_order_is_not_free():
    area = line_of_stations(1.0, pads=5)
    stations = [Stations(area, (3, k), DEPART_S, 10, broken=True) for k in range(300)]
    lines = [one.line(1) for one in stations]
    assert np.mean([one.out for one in lines]) == pytest.approx(0.5, abs=0.15)
    assert all(one.told(DEPART_S) == one.present(DEPART_S) + one.out and one.pads == 5 - one.out for one in lines)


def test_strangers_come_as_often_as_the_world_says():
    area = line_of_stations(1.0)
    for factor in ((1.0, 1.0), (0.5, 1.5)):
        lines = [Stations(area, (4, k), DEPART_S, 24, factor).line(0) for k in range(400)]
        counts = np.array([len(one.came_s) for one in lines])
        assert counts.mean() == pytest.approx(72.0, rel=0.05)  # two days of warm-up, and a day
        assert counts.std() == pytest.approx(math.sqrt(72.0 + (72.0 * (factor[1] - factor[0])) ** 2 / 12.0), rel=0.15)


def test_intervals_are_wilson_s_and_hold_over_days():
    assert statistics.wilson(0, 100) == pytest.approx((0.0, 0.0370), abs=1e-4)
    assert statistics.wilson(10, 100) == pytest.approx((0.0552, 0.1744), abs=1e-4)
    rng = np.random.default_rng(2)
    day = np.repeat(np.arange(40), 25)
    values = rng.normal(5.0, 2.0, 40)[day] + rng.normal(0.0, 0.1, 1000)
    low, high = statistics.over_days(values, day)
    assert high - low == pytest.approx(2 * 1.96 * 2.0 / math.sqrt(40.0), rel=0.3)  # days count, not runs
