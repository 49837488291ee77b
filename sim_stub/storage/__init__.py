"""The storage of a simulated vehicle: its files, and the protocols by which they are read."""
