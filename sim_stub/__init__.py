"""Simulated vehicles that behave on the wire as PX4 and ArduPilot do, with pads and wind.

The other side of the wire: its drag, power and autopilots are its own and share no code with the planner or the link.
"""
