"""The service that flies a fleet: a dispatcher that plans and books, and workers that supervise flights."""
