"""The state of charge: the reported value, the voltage, the estimate."""
