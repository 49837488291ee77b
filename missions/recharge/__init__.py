"""Recharge stops for any mission: what it does and holds at each point, and the missions that it is cut into."""
