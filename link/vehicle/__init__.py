"""Vehicles behind a link: one interface, two drivers."""
