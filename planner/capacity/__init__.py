"""Capacity of a network in orders per hour: simulated days of a fleet, planned with a forecast and flown in a wind that differs from it."""
