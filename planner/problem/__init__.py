"""Requests, and one drone's problem as arrays."""
