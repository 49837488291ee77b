"""The exchanges of MAVLink: commands, parameters, verified upload."""
