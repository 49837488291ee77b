"""Tours: several packages aboard, recharging on the way, chargers that are few."""
