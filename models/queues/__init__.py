"""Queues at charging pads: other drones, transient M/M/c, sampled queues."""
