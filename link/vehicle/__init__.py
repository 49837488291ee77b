"""Vehicles behind a link: one class, and MAVSDK as a second driver of it."""
