"""The dispatcher of a fleet: what it knows, what has happened, what it plans and books, what orders are told, and which flights begin."""
