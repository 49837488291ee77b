"""Terrain: heights of the ground and of obstacles, from published files."""
