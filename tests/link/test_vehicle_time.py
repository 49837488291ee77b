"""The clock of a vehicle that lives at another speed: it follows, never goes back, and never stands still."""

from types import SimpleNamespace

from link.vehicle_time import VehicleTime


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
