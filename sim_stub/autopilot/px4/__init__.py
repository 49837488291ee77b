"""Simulated PX4."""

from skyway.sim_stub.autopilot.px4.px4 import Px4

FAMILY = Px4
