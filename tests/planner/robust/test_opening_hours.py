"""Opening hours of pads in plans: schedules against the clock, routes against all routes."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from skyway.models.base.errors import InputError, NoRouteError
from skyway.models.composition.composition import State
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.schedule_kernels import PAD, SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN
from tests.planner.robust.test_loss_search import all_routes
from tests.planner.worlds import DEPART, make_request, make_wind, make_world


def with_hours(rng, scenario, hours=None):
    """The same whose pads open and close about the departure, at 09:20 UTC, some without holding spots."""

    def some():
        begin = int(rng.integers(9 * 60, 12 * 60))
        first = (begin - int(rng.integers(30, 180))) // 5 * 5
        last = (begin + int(rng.integers(20, 90))) // 5 * 5
        text = f"00:00-{first // 60:02d}:{first % 60:02d},{last // 60:02d}:{last % 60:02d}-24:00"
        return text if last > first else ""

    stations = tuple(
        replace(
            one, open_hours=some() if hours is None else hours.get(one.id, ""), holding_spots=int(rng.integers(0, 3))
        )
        for one in scenario.network.stations
    )
    return replace(scenario, network=replace(scenario.network, stations=stations))


def shut(station, time_s):
    """Whether it is closed, by the text of `with_hours`."""
    if not station.open_hours:
        return False
    clock = datetime.fromtimestamp(time_s, UTC).strftime("%H:%M:%S")
    spans = [span.split("-") for span in station.open_hours.split(",")]
    return not any(begin <= clock < end for begin, end in spans)


def found_in(number):
    rng = np.random.default_rng((0x30, number))
    scenario = with_hours(rng, make_world(rng, 5, utilisation=0.3))
    wind = make_wind(rng, members=4, mean_mps=4.0)
    request = make_request(scenario, rng)
    search = RobustSearch(Problem(scenario, request, scenario.drones[0], wind))
    try:
        return search, search.candidates()
    except NoRouteError:
        return search, []


@pytest.mark.slow
def test_nobody_charges_or_lands_while_it_is_closed():
    """Pads, charges and landings of simulated deliveries, second by second on the clock."""
    charges = waits = 0
    for number in range(8):
        search, candidates = found_in(number)
        p = search.problem
        for one in candidates[:3]:
            runs = one.out_of_sample.schedule
            stops = [p.network.stations[int(p.network.tail[leg.segments[0]])] for leg in one.policy.itinerary]
            ends = [p.network.stations[int(p.network.head[leg.segments[-1]])] for leg in one.policy.itinerary]
            for run in runs[:: max(1, len(runs) // 6)]:
                soc = p.soc
                for leg, (stop, end) in enumerate(zip(stops, ends, strict=True)):
                    if not np.isfinite(run[leg, TOUCH_DOWN]):
                        break
                    if run[leg, SOC_TAKE_OFF] > soc + 1e-9:
                        charges += 1
                        pad, off = run[leg, PAD], run[leg, TAKE_OFF]
                        assert not shut(stop, pad + 1e-3)
                        seconds = pad + 0.5 + np.arange(max(round(off - pad), 0))
                        on = sum(not shut(stop, second) for second in seconds)
                        waits += on < len(seconds)
                        curve_s, curve_soc = p.curve(p.network.index[stop.id])
                        level = np.interp(np.interp(soc, curve_soc, curve_s) + on, curve_s, curve_soc)
                        assert run[leg, SOC_TAKE_OFF] == pytest.approx(level, abs=2e-3)
                    if end.pads and not end.holding_spots:
                        assert not shut(end, run[leg, TOUCH_DOWN] + 1e-3)
                    soc = run[leg, SOC_LANDING]
    assert charges > 50
    assert waits > 3


@pytest.mark.slow
def test_route_is_the_best_of_all_simulated():
    """What `robust` chooses against every route, each simulated in the same deliveries."""
    excess = []
    for number in range(10):
        search, candidates = found_in(number)
        if not candidates:
            continue
        every = [search.judged(one) for one in all_routes(search.problem)]
        best = min(one.order() for one in every)
        assert candidates[0].order()[:2] <= best[:2]
        begin = search.problem.depart_s
        excess.append((candidates[0].loss[0] - begin) / (best[2] - begin) - 1.0)
    assert len(excess) >= 5
    assert np.median(excess) <= 1e-6
    assert (
        sum(one > 0.02 for one in excess) <= 1
    )  # a leg that is too long with every margin that routes are composed with


def test_plan_says_what_it_waits_for():
    """A station that opens later than the drone comes; flown again by the audit, told by the plan."""
    rng = np.random.default_rng(5)
    scenario = make_world(rng, 4, utilisation=0.0)
    hours = {one.id: "11:00-22:00" for one in scenario.network.stations}
    scenario = with_hours(rng, scenario, hours)
    wind = make_wind(rng, members=2, mean_mps=3.0)
    request = make_request(scenario, rng, payload_kg=1.0, state=State(DEPART, "s0", None, 0.95))
    open_ = replace(request, state=State(DEPART + timedelta(hours=2), "s0", None, 0.95))
    late, early = plan(scenario, request, forecast=wind), plan(scenario, open_, forecast=wind)
    assert any("to open at 11:00" in note for note in late.composition.notes), late.composition.notes
    assert not any("to open" in note for note in early.composition.notes)
    gained = late.composition.arrival.delivery_mean.value - early.composition.arrival.delivery_mean.value
    assert 0.0 < gained <= 100.0 * 60.0
    with pytest.raises(InputError, match="opening hours"):
        plan(scenario, request, planner="exact", forecast=wind, truth=replace(wind, north=wind.north[:1], east=wind.east[:1], probability=np.ones(1), labels=wind.labels[:1]))  # fmt: skip
    other = plan(scenario, request, planner="pfs", forecast=wind)
    assert other.composition.arrival.delivery_mean is not None
