"""What a drone can do, takes and tells: energy, charging, drag, airspeed, telemetry."""
