"""In the air: turns, landing, what the vehicle and its pilot do."""
