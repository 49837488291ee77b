"""Flights through changing wind: rules and kernels."""
