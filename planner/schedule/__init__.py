"""Decisions flown through the forecast: times, charges, outcomes; audit and reasons."""
