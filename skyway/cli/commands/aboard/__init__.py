"""What is done aboard a vehicle: its parameters, its logs, its health, and a flight under supervision."""
