"""From a composition to the mission of each leg."""
