"""The clock of a vehicle that lives at another speed: it follows, never goes back, and never stands still."""

import random
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from speeded import Speeded

from skyway.link.telemetry.timebase import VehicleClock
from skyway.link.telemetry.vehicle_time import VehicleTime
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.messages import Message


class Wall:
    def __init__(self):
        self.now = 0.0

    def now_s(self):
        return self.now

    def posix_s(self):
        return 1e9 + self.now


def vehicle_at(time_s):
    sample = SimpleNamespace(time_s=time_s)
    base = SimpleNamespace(absolute=True)
    return SimpleNamespace(live=SimpleNamespace(sample=sample, clock=SimpleNamespace(base=base)))


def test_it_follows_the_vehicle_and_goes_on_with_the_wall_between_samples():
    wall, vehicle = Wall(), vehicle_at(5000.0)
    time = VehicleTime(vehicle, wall)
    assert time.posix_s() == 5000.0
    wall.now += 2.0
    assert time.posix_s() == 5002.0
    vehicle.live.sample.time_s = 5100.0
    assert time.posix_s() == 5100.0


def test_where_it_was_ahead_it_goes_on_slowly_until_the_vehicle_has_caught_up():
    wall, vehicle = Wall(), vehicle_at(5000.0)
    time = VehicleTime(vehicle, wall)
    time.posix_s()
    vehicle.live.sample.time_s = 8600.0  # a guess made while the simulation ran two hundred times as fast
    ahead = time.posix_s()
    vehicle.live.sample.time_s = 5010.0
    told = []
    for _ in range(20):
        wall.now += 1.0
        vehicle.live.sample.time_s += 1.0
        told.append(time.posix_s())
    assert told == sorted(told)
    assert told[-1] - ahead >= 9.0  # what waits ten seconds gets on, though the vehicle's time is an hour behind
    vehicle.live.sample.time_s = 8700.0
    assert time.posix_s() == 8700.0


def elapsed(scene, craft, clock, wall_s):
    """(simulated, by telemetry, by the clock of the delivery) seconds that pass in some seconds of the wall."""
    before = scene.sim_s, craft.live.sample.time_s, clock.posix_s()
    end = scene.wall_s + wall_s
    while scene.wall_s < end:
        scene.connection.run_for(0.1)
        clock.posix_s()
    return scene.sim_s - before[0], craft.live.sample.time_s - before[1], clock.posix_s() - before[2]


def lives_at(family, speed, **how):
    scene = Speeded(family, speed, **how)
    craft = Vehicle(scene.connection)
    craft.request_telemetry()
    scene.connection.run_for(8.0)
    return scene, craft, VehicleTime(craft, scene)


SLOW = pytest.mark.slow


@pytest.mark.parametrize("begun_s", [0.0, pytest.param(200.0, marks=SLOW)], ids=["from the start", "met later"])
@pytest.mark.parametrize(
    "speed",
    [
        0.5,
        pytest.param(0.9, marks=SLOW),
        1.0,
        pytest.param(1.5, marks=SLOW),
        pytest.param(3.0, marks=SLOW),
        8.0,
        pytest.param(20.0, marks=SLOW),
    ],
)
@pytest.mark.parametrize("family", ["px4", "ardupilot"])
def test_the_vehicles_seconds_are_counted_at_any_speed(family, speed, begun_s):
    """PX4's simulator tells the time of day by the computer's clock: at speed 8 three minutes passed where 16 were flown."""
    scene, craft, clock = lives_at(family, speed, begun_s=begun_s)
    for wall_s in (1.0, 20.0):
        simulated, by_telemetry, by_clock = elapsed(scene, craft, clock, wall_s)
        assert by_telemetry == pytest.approx(simulated, abs=0.3 * speed + 0.1)
        assert by_clock == pytest.approx(simulated, abs=0.4 * speed + 0.1)
    simulates = abs(speed - 1.0) > 0.05
    assert craft.live.clock.simulated == simulates
    assert any("simulation" in doubt for doubt in craft.live.clock.base.doubts) == simulates


@pytest.mark.parametrize(
    "speeds",
    [
        (1.0, 8.0, 1.0),
        *(pytest.param(more, marks=SLOW) for more in ((8.0, 1.0, 20.0), (20.0, 0.5, 3.0), (1.0, 2.0, 4.0))),
    ],
)
@pytest.mark.parametrize("family", ["px4", "ardupilot"])
def test_the_speed_of_a_simulation_may_change(family, speeds):
    scene, craft, clock = lives_at(family, speeds[0])
    for speed in speeds:
        scene.speed = speed
        elapsed(scene, craft, clock, 6.0)  # so long it may take until it is known
        simulated, by_telemetry, by_clock = elapsed(scene, craft, clock, 20.0)
        assert by_telemetry == pytest.approx(simulated, abs=0.3 * speed + 0.1)
        assert by_clock == pytest.approx(simulated, abs=0.4 * speed + 0.1)


@pytest.mark.parametrize("family", ["px4", "ardupilot"])
def test_a_change_of_speed_loses_no_more_than_seconds(family):
    scene, craft, clock = lives_at(family, 1.0)
    elapsed(scene, craft, clock, 60.0)
    scene.speed = 8.0
    simulated, by_telemetry, _ = elapsed(scene, craft, clock, 20.0)
    assert by_telemetry == pytest.approx(simulated, abs=24.0)


@given(
    jumps=st.lists(st.tuples(st.integers(3, 40), st.floats(-1e4, 1e4)), min_size=1, max_size=4),
    jitter=st.floats(0.0, 0.02),
    seed=st.integers(0, 99),
)
def test_a_real_clock_that_is_set_now_and_then_is_followed(jumps, jitter, seed):
    generator, clock = random.Random(seed), VehicleClock()
    second, utc = 0, 1.5e9
    for lasting, jump in jumps:
        for _ in range(max(lasting, 4)):
            second, utc = second + 1, utc + 1.0
            told = int((utc + generator.uniform(-jitter, jitter)) * 1e6)
            clock.hear(
                Message("SYSTEM_TIME", 1, 1, {"time_unix_usec": told, "time_boot_ms": second * 1000}), 2e9 + second
            )
        found = clock.hear(Message("ATTITUDE", 1, 1, {"time_boot_ms": second * 1000 + 500}), 2e9 + second)
        assert abs(found - utc - 0.5) < 0.1
        assert not clock.simulated
        utc += jump
