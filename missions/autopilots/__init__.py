"""Autopilot families: one folder for each, with all its differences from the others.

A new family is a folder here and its name in `NAMES`; `family` defines the contents of the folder.
"""

NAMES = ("px4", "ardupilot")
"""Folders of the families, and their names in commands and files; the default one."""
