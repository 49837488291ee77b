"""Ways in and out of simulated vehicles: sockets at wall time, and in-process in lockstep."""
