"""Plans of a fleet carried out with shared pads: who comes first charges first, and the others wait."""

from datetime import UTC, datetime, timedelta

import pytest

from skyway.planner.capacity.execution import carry_out
from skyway.planner.dispatch.result import Route, Step

START = datetime(2026, 7, 10, 12, tzinfo=UTC)


def route(drone, order, charge_min, fly_min=10):
    def step(kind, phase, begin, length):
        first = START + timedelta(minutes=begin)
        end = first + timedelta(minutes=length)
        return Step(kind=kind, order=order, phase=phase, origin="a", destination="a" if kind == "charge" else "b", begin=first, end=end, soc_begin=0.5, soc_end=0.5)  # fmt: skip

    steps = (step("charge", "to the package", 0, charge_min), step("fly", "with the package", charge_min, fly_min))
    return Route(drone=drone, type="m200", orders=(order,), steps=steps)


def test_a_pad_is_shared_in_order_of_arrival():
    begin_s = START.timestamp()
    ready = {"one": begin_s, "two": begin_s + 3600.0}
    routes = [route("d1", "one", 20), route("d2", "two", 30)]
    done = carry_out(routes, ready, {"a": 1, "b": 1}, {"a": [(begin_s - 60.0, 660.0)]}, begin_s)
    assert done.waited_s == pytest.approx({"one": 600.0, "two": 1800.0})  # a stranger first, then each other
    assert done.delivered_s["one"] == pytest.approx(begin_s + 600.0 + 1200.0 + 600.0)
    assert done.delivered_s["two"] == pytest.approx(begin_s + 3600.0 + 600.0), "never before the package is ready"
    alone = carry_out(routes[:1], ready, {"a": 2, "b": 1}, {"a": [(begin_s - 60.0, 660.0)]}, begin_s)
    assert alone.waited_s["one"] == 0.0
