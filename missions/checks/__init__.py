"""Checks of missions: one module per concern, combined in `missions.checks.report`."""
