"""PX4."""

from skyway.missions.autopilots.px4.family import Px4

FAMILY = Px4()
