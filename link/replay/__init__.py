"""Logged flights looked at again: estimates, predictions, as if live."""
