"""The link to vehicles: connections, verified upload, telemetry, recording, supervision."""
