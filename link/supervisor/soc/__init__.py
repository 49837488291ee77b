"""The state of charge: what is reported, what the voltage says, what is believed."""
