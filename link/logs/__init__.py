"""Readers of flight logs: MAVLink ``.tlog``, ArduPilot ``.bin``, PX4 ``.ulg`` and CSV, all as telemetry."""
