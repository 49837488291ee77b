"""Wind estimation from telemetry."""
