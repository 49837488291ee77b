"""The physical vehicle: motion, power, battery, wind."""
