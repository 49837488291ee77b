"""Observation of the vehicle by the supervisor: its state, its texts, its link."""
