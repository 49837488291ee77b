"""Replay of logged flights: estimates and predictions as if live."""
