"""Schedules: itineraries flown through a forecast, their outcomes, audit, and reasons for no route."""
