"""A simulated day of two operators: their processes, the faults, and a network that can be cut."""
