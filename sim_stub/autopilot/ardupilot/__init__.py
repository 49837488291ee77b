"""Simulated ArduPilot."""

from skyway.sim_stub.autopilot.ardupilot.ardupilot import ArduPilot

FAMILY = ArduPilot
