"""Terrain: heights of the ground and of obstacles, from the files in which they come."""
