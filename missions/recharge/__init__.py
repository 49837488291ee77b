"""Recharge stops for any mission: its actions and state at each point, and the missions into which it is cut."""
