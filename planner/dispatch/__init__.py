"""Dispatch: which drone takes which order when, over which pads."""
