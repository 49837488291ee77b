"""A simulated vehicle that lives faster or slower than the ground station, in virtual time, at speeds that may change."""

from collections import deque

from skyway.link.protocol.connection import Connection
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.world import World

TURN_S = 0.02


class Speeded:
    """World, clock of the computer and transport in one: each turn lets both times pass."""

    def __init__(self, family, speed=1.0, *, begun_s=0.0, **config):
        self.world = World(wind=ConstantWind())
        self.vehicle = self.world.add(
            VehicleConfig(
                lat=40.7392, lon=-73.9756, ground_m=5.0, autopilot=family, warm=True, power_error=1.0, **config
            )
        )
        self.speed, self.wall_s = speed, 0.0
        self.inbox = deque()
        self.port = self.vehicle.radio.connect(self.inbox.append)
        self.connection = Connection(self, self)
        self.run(begun_s)

    @property
    def sim_s(self):
        return self.world.sim_s

    def run(self, duration_s):
        """Advance the time without anybody listening."""
        end = self.wall_s + duration_s
        while self.wall_s < end - 1e-9:
            self.turn()
        self.inbox.clear()

    def turn(self):
        self.wall_s += TURN_S
        self.world.advance(self.world.sim_s + TURN_S * self.speed, self.wall_s)

    # A clock

    def now_s(self):
        return self.wall_s

    def posix_s(self):
        return self.world.epoch_s + self.wall_s

    def sleep_until(self, instant_s):
        while self.wall_s < instant_s:
            self.turn()

    # A transport

    def write(self, data):
        self.vehicle.receive(self.port, data)

    def read(self, timeout_s=0.0):
        end = self.wall_s + timeout_s
        while not self.inbox and self.wall_s < end:
            self.turn()
        data = b"".join(self.inbox)
        self.inbox.clear()
        return data

    def close(self):
        self.vehicle.radio.disconnect(self.port)
