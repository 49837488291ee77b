"""Telemetry of a vehicle on one time base, with data quality."""
