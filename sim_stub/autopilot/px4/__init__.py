"""A PX4 as seen from outside."""
