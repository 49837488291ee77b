"""Flights in separate processes: how they are started, and how they report."""
