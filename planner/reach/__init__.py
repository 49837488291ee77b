"""Reach of a drone from any point of a leg, and its divert stations."""
