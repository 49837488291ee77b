"""In the air: turns, landing, events of the vehicle and its pilot."""
