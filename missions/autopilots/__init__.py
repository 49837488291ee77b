"""Autopilot families: one folder for each, with all its differences from the others.

A new family is a folder here and its name in `NAMES`; what the folder holds says `family`.
"""

NAMES = ("px4", "ardupilot")
"""Folders of the families, and what commands and files call them; the one that people get who name none first."""
