"""Calculations for the pages, in separate processes: no module here knows NiceGUI."""
