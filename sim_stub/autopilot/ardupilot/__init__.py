"""An ArduPilot as seen from outside."""
