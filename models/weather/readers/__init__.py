"""Readers of weather files, one for each format."""
