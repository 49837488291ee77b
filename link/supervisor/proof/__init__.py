"""Proof of delivery: what shows that the package has left the drone, and where."""
