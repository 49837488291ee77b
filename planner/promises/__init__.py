"""What a plan for a fleet promises: it is flown in many worlds, and each order has its probability."""
