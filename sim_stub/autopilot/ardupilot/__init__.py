"""Simulated ArduPilot."""
