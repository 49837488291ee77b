"""Checks of missions: one file per concern, put together in `missions.checks.report`."""
