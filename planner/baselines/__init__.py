"""Baseline planners: those of the paper, and the shortest route."""
