"""Proof of delivery: evidence that the package has left the drone, and where."""
