"""Lower bounds of the remaining flight, over a forecast."""
