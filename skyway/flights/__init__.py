"""Flights in processes of their own: how they are started, and what they tell while they fly."""
