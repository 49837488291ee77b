"""Winds observed now: read as they are published or typed, and a forecast conditioned on them."""
