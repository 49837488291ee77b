"""MAVLink protocols: commands, parameters, verified upload."""
