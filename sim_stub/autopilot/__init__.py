"""Autopilots of both families: what they share, and one home for the quirks of each."""
