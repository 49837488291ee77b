"""The storage of a simulated vehicle: its files, and the protocols to read them."""
