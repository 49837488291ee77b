"""Recharge stops for any mission: `skyway recharge`."""
