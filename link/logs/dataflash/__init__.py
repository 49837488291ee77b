"""DataFlash, ArduPilot's log format."""
