"""DataFlash, the log of ArduPilot."""
