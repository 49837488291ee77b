"""The planners of the paper and the shortest way."""
