"""Orders to be delivered and the drones that deliver them: their files and their checks."""
