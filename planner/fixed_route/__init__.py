"""Charging stops on a route with a fixed order: where to leave the work, at which pad, and how much to charge."""
