"""The vehicles of the independent worlds: flight, energy and battery."""
