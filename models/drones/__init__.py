"""Drones: energy, charging, drag, airspeed, telemetry."""
