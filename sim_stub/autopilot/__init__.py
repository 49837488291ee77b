"""Simulated autopilots: shared behaviour, and one folder per family.

A new family is a folder here and its name in `NAMES`; its `FAMILY` answers what `family.Family` asks.
"""

NAMES = ("px4", "ardupilot")
"""Folders of the families, and what commands call them."""
