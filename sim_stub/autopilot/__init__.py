"""Simulated autopilots: shared behaviour, and one folder per family."""
