"""Drag, energy and airspeed of a vehicle, fitted to its flights."""
