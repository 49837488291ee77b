"""Airspace: zones in three dimensions and in time, from the files in which authorities publish them."""
