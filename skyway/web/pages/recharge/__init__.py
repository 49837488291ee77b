"""The recharge page: a mission that is longer than a battery, cut at pads."""
