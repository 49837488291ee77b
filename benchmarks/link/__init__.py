"""How fast links, logs, missions and the simulator are; supervised deliveries."""
