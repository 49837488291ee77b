"""Simulated PX4."""
