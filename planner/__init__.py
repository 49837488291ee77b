"""Planners: from a scenario and a request to a composition."""
