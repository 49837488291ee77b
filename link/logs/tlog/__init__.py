"""Telemetry logs (.tlog)."""
