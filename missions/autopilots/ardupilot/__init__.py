"""ArduPilot."""

from skyway.missions.autopilots.ardupilot.family import ArduPilot

FAMILY = ArduPilot()
