"""The service of a fleet: a dispatcher that plans and books, and workers that supervise flights."""
