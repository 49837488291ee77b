"""Tours: several packages on board, recharging on the way, limited numbers of chargers."""
