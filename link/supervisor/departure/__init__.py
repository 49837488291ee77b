"""On the ground: deciding, charging, checks, take-off."""
