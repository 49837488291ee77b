"""Commands for what a vehicle keeps: its parameters and its logs."""
