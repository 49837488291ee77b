"""Missions: what a vehicle flies, and the files operators keep it in."""
