"""How many orders an hour a network carries: simulated days of a fleet, planned with a forecast and flown in a wind that it does not have."""
