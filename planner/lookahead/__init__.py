"""Lower bounds of what is left to fly, over a forecast."""
