"""Transports of simulated vehicles: sockets in real time, and in-process in lockstep."""
