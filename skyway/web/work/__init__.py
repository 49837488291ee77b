"""Calculations for the pages, in separate processes: no module here depends on NiceGUI."""
