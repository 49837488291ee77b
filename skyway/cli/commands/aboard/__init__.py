"""Commands for data on a vehicle: its parameters and its logs."""
